"""Instants of a leg at which the states are decided anew, and the sets of states of each.

The states at the start of a leg and its events tell all; the solvers are not involved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.uniqueness.definite import Certificate
from receding_fenicsx.interface.uniqueness.sides import Sides, States, mask_of

Event = tuple[float, int, int, int]
"""Place s on the leg, node, old state, new state."""

Key = tuple[Sides, Sides]
"""States before and after the changes at an instant."""


@dataclass(frozen=True)
class Instant:
    """A rate problem on the path.

    Attributes:
        s: place on the leg.
        sides: states in which every node that may slip does so.
        touching: nodes with neither gap nor pressure.
        key: what tells it from others on legs in the same direction.
    """

    s: float
    sides: Sides
    touching: tuple[int, ...]
    key: Key

    def undecided(self, certificate: Certificate) -> Undecided:
        """Return the nodes that the rate problem decides."""
        touching = np.array(self.touching, dtype=np.intp)
        slips = certificate.frictional.copy()
        slips[touching] = False
        forward, backward, _ = (mask_of(bits, len(slips)) for bits in self.sides)
        smooth = certificate.smooth[touching]
        return Undecided(
            np.flatnonzero(slips & forward),
            np.flatnonzero(slips & backward),
            touching[~smooth],
            touching[smooth],
        )

    def sets(self, certificate: Certificate) -> Iterator[Sides]:
        """Yield the sets of states that have to be definite: all sides of the touching nodes."""
        base = self.sides.of_nodes(certificate.rubbing)
        for i in self.touching:
            base = base.put(1 << i, STICK)
        sides = [
            (STICK, SEPARATION) if certificate.smooth[i] else (SEPARATION, FORWARD, BACKWARD)
            for i in self.touching
        ]
        for chosen in product(*sides):
            one = base
            for i, side in zip(self.touching, chosen, strict=True):
                one = one.put(1 << i, side)
            yield one


class InstantsOfLegs:
    """Finds the instants of legs that were not met before."""

    def __init__(self) -> None:
        """Begin with none."""
        self._met: dict[bytes, set[Key]] = {}

    def new(
        self,
        direction: bytes,
        start: States,
        events: list[Event],
        touching: tuple[int, ...] = (),
        finite: Callable[[float], bool] = lambda s: False,
    ) -> list[Instant]:
        """Return the instants of a leg not met before: its start and where states change.

        A node that was slipping, or that begins to, may slip or stick; one that comes into contact
        or leaves it, or whose slip turns round at once, may do anything.

        Args:
            direction: of the leg.
            start: (N,) states at its start.
            events: its changes of state, in order.
            touching: nodes that touch without pressure at the start.
            finite: says of a place s whether the states there change by a load step or a jump: only
                the states after it are judged.
        """
        met = self._met.setdefault(direction, set())
        now = Sides.of(start)
        found: list[Instant] = []
        k, last = 0, len(events)
        if (not last or events[0][0] > 0.0) and ((now, now) not in met or touching):
            met.add((now, now))
            found.append(Instant(0.0, now, touching, (now, now)))
        while k < last:
            begin, before, s = k, now, events[k][0]
            while k < last and events[k][0] == s:
                k += 1
            _, i, old, new = events[begin]
            if k == begin + 1:
                now = before.put(1 << i, new)
            else:
                now = before.after(event[1:] for event in events[begin:k])
            key = before, now
            if k == begin + 1 and SEPARATION not in (old, new):
                # one node begins to slip, or stops: the larger set of slipping nodes counts
                key = (now, now) if old == STICK else (before, before)
            at_start = touching if s == 0.0 else ()
            if key in met and not at_start:
                continue
            met.add(key)
            if finite(s):
                found.append(Instant(s, now, (), key))
            else:
                sides, free = _loosest(before, events[begin:k])
                found.append(Instant(s, sides, tuple(sorted({*free, *at_start})), key))
        return found

    def forget(self, direction: bytes, instants: list[Instant]) -> None:
        """Let instants count as new where they are met again."""
        self._met[direction].difference_update(instant.key for instant in instants)


def _loosest(before: Sides, events: list[Event]) -> tuple[Sides, set[int]]:
    """Return the states in which all slip that may at simultaneous events, and who touch."""
    sides, slipped, free = before, dict[int, int](), set[int]()
    for _, i, old, new in events:
        turned = slipped.setdefault(i, max(old, new)) != max(old, new)
        if SEPARATION in (old, new) or STICK not in (old, new) or turned:
            free.add(i)
        elif new != STICK:
            sides = sides.put(1 << i, new)
    return sides, free
