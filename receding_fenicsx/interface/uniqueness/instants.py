"""Instants of a leg at which the states are decided anew, and the sets of states of each.

The states at the start of a leg and its events tell all; the solvers are not involved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import product
from operator import xor

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.uniqueness.definite import Certificate, States

Event = tuple[float, int, int, int]
"""Place s on the leg, node, old state, new state."""

HASH_BYTES = 16
"""Length of the hash of a set of states: no two of a run are alike."""


@dataclass(frozen=True)
class Instant:
    """A rate problem on the path.

    Attributes:
        s: place on the leg.
        state: (N,) states in which every node that may slip does so.
        touching: nodes with neither gap nor pressure.
        key: what tells it from others on legs in the same direction.
    """

    s: float
    state: States
    touching: NDArray[np.intp]
    key: tuple[int, int]

    def undecided(self, certificate: Certificate) -> Undecided:
        """Return the nodes that the rate problem decides."""
        slips = certificate.frictional.copy()
        slips[self.touching] = False
        smooth = certificate.smooth[self.touching]
        return Undecided(
            np.flatnonzero(slips & (self.state == FORWARD)),
            np.flatnonzero(slips & (self.state == BACKWARD)),
            self.touching[~smooth],
            self.touching[smooth],
        )

    def sets(self, certificate: Certificate) -> Iterator[States]:
        """Yield the sets of states that have to be definite: all sides of the touching nodes."""
        sides = [
            (STICK, SEPARATION) if certificate.smooth[i] else (SEPARATION, FORWARD, BACKWARD)
            for i in self.touching
        ]
        for chosen in product(*sides):
            state = self.state.copy()
            state[self.touching] = chosen
            yield state


class InstantsOfLegs:
    """Finds the instants of legs that were not met before."""

    def __init__(self, certificate: Certificate) -> None:
        """Prepare for a contact."""
        self.certificate = certificate
        random = np.random.default_rng(0)
        # the hash of a set of states is the exclusive or of one number for each node and state
        self._number = [
            [int.from_bytes(random.bytes(HASH_BYTES), "little") for _ in range(5)]
            for _ in range(certificate.system.n)
        ]
        self._met: dict[bytes, set[tuple[int, int]]] = {}

    def new(
        self,
        direction: bytes,
        start: States,
        events: list[Event],
        touching: NDArray[np.intp] = np.zeros(0, dtype=np.intp),
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
        number, met = self._number, self._met.setdefault(direction, set())
        now = reduce(xor, (row[i] for row, i in zip(number, start.tolist(), strict=True)), 0)
        found: list[Instant] = []
        k, last = 0, len(events)
        if (not last or events[0][0] > 0.0) and ((now, now) not in met or len(touching)):
            met.add((now, now))
            found.append(Instant(0.0, start.copy(), touching, (now, now)))
        while k < last:
            begin, before, s = k, now, events[k][0]
            while k < last and events[k][0] == s:
                _, i, old, new = events[k]
                now ^= number[i][old] ^ number[i][new]
                k += 1
            key = before, now
            if k == begin + 1 and SEPARATION not in (old, new):
                # one node begins to slip, or stops: the larger set of slipping nodes counts
                key = (now, now) if old == STICK else (before, before)
            at_start = touching if s == 0.0 else touching[:0]
            if key in met and not len(at_start):
                continue
            met.add(key)
            if finite(s):
                found.append(Instant(s, _after(start, events[:k]), touching[:0], key))
            else:
                state, free = self._loosest(start, events, (begin, k))
                free = np.union1d(free, at_start)
                found.append(Instant(s, state, free, key))
        return found

    def forget(self, direction: bytes, instants: list[Instant]) -> None:
        """Let instants count as new where they are met again."""
        self._met[direction].difference_update(instant.key for instant in instants)

    def _loosest(
        self, start: States, events: list[Event], group: tuple[int, int]
    ) -> tuple[States, NDArray[np.intp]]:
        """Return the states in which all slip that may at simultaneous events, and who touch."""
        begin, end = group
        state, slipped, free = _after(start, events[:begin]), dict[int, int](), set[int]()
        for _, i, old, new in events[begin:end]:
            turned = slipped.setdefault(i, max(old, new)) != max(old, new)
            if SEPARATION in (old, new) or STICK not in (old, new) or turned:
                free.add(i)
            elif new != STICK:
                state[i] = new
        return state, np.array(sorted(free), dtype=np.intp)


def _after(start: States, events: list[Event]) -> States:
    """Return the states after some events."""
    state = start.copy()
    for _, i, _, new in events:
        state[i] = new
    return state
