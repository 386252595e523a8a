"""Instants of a leg at which the states are decided anew, and what the nodes may do at each.

The states at the start of a leg, its events, and the ties of its path tell all: nodes that are on a
limit at an instant, whether they change their state there or not. The solvers are not involved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.interface.exact.legs import SIMULTANEOUS, Event
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.uniqueness.definite import Certificate
from receding_fenicsx.interface.uniqueness.sides import Sides, States, mask_of, nodes_of


@dataclass(frozen=True)
class Instant:
    """A rate problem on the path.

    Attributes:
        s: place on the leg.
        sides: states in which every node that may slip does so.
    """

    s: float
    sides: Sides

    def undecided(self, certificate: Certificate) -> Undecided:
        """Return the nodes that the rate problem decides."""
        touching = np.array(nodes_of(self.sides.touching), dtype=np.intp)
        n, rubs = certificate.system.n, certificate.frictional
        forward, backward = (np.flatnonzero(rubs & mask_of(bits, n)) for bits in self.sides[:2])
        smooth = certificate.smooth[touching]
        return Undecided(forward, backward, touching[~smooth], touching[smooth])


class InstantsOfLegs:
    """Finds the instants of legs that were not met before."""

    def __init__(self) -> None:
        """Begin with none."""
        self._met: dict[bytes, set[Sides]] = {}

    def new(
        self,
        direction: bytes,
        start: States,
        events: Sequence[Event],
        ties: Sequence[Event] = (),
        finite: Callable[[float], bool] = lambda s: False,
    ) -> list[Instant]:
        """Return the instants of a leg not met before: its start and where states change.

        A node that was slipping, or that begins to, may slip or stick; so may a stuck one on a
        limit. One that comes into contact or leaves it, or whose slip turns round at once, may do
        anything.

        Args:
            direction: of the leg.
            start: (N,) states at its start.
            events: its changes of state, in order.
            ties: nodes on limits, their states, and others that they may take there.
            finite: says of a place s whether the states there change by a load step or a jump: only
                the states after it are judged.
        """
        met = self._met.setdefault(direction, set())
        now = Sides.of(start)
        found: list[Instant] = []
        for group in together(events, ties):
            s = group[0][0][0] if group else 0.0
            before, changes = now, [event for event, is_tie in group if not is_tie]
            if changes:
                now = before.after(event[1:] for event in changes)
            if finite(s):
                sides = _loosest(now, [event for event, is_tie in group if is_tie])
            else:
                sides = _loosest(before, [event for event, _ in group])
            if sides not in met:
                met.add(sides)
                found.append(Instant(s, sides))
        return found

    def forget(self, direction: bytes, instants: list[Instant]) -> None:
        """Let instants count as new where they are met again."""
        self._met[direction].difference_update(instant.sides for instant in instants)


def together(events: Sequence[Event], ties: Sequence[Event]) -> list[list[tuple[Event, bool]]]:
    """Sort events and ties into those that are simultaneous; say of each whether it is a tie.

    The first are those at the start, if there are any.
    """
    every = [(event, False) for event in events]
    if ties:
        every = sorted([(tie, True) for tie in ties] + every, key=lambda one: one[0][0])
    groups, last = [list[tuple[Event, bool]]()], 0.0
    for one in every:
        s = one[0][0]
        if s - last > SIMULTANEOUS:
            groups.append([])
        groups[-1].append(one)
        last = s
    return groups


def _loosest(before: Sides, events: list[Event]) -> Sides:
    """Return the states in which all slip that may at simultaneous events, and who touch."""
    sides, slipped = before, dict[int, int]()
    for _, i, old, new in events:
        if max(old, new) == STICK:
            continue
        turned = slipped.setdefault(i, max(old, new)) != max(old, new)
        if SEPARATION in (old, new) or STICK not in (old, new) or turned:
            slipped[i] = 0
            sides = sides.put(1 << i, 0)
        elif slipped[i] and new != STICK:
            sides = sides.put(1 << i, new)
    return sides
