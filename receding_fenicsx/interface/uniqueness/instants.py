"""Instants of a leg at which the states are decided anew, and what the nodes may do at each.

The states at the start of a leg, its events, and the ties of its path tell all: nodes that are on a
limit at an instant, whether they change their state there or not. The solvers are not involved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.law import SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import Undecided
from receding_fenicsx.interface.tolerances import SIMULTANEOUS
from receding_fenicsx.interface.uniqueness.definite import Certificate
from receding_fenicsx.interface.uniqueness.sides import Change, Sides, States, mask_of, nodes_of


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
        events: Changes,
        ties: Changes,
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
            ties: nodes on limits, as changes to other states that they may take there.
            finite: says of a place s whether the states there change by a load step or a jump: only
                the states after it are judged.
        """
        met = self._met.setdefault(direction, set())
        now = Sides.of(start)
        found: list[Instant] = []
        for s, group in together(events, ties):
            before, made = now, [change for change, is_tie in group if not is_tie]
            if made:
                now = before.after(made)
            if finite(s):
                sides = _loosest(now, [change for change, is_tie in group if is_tie])
            else:
                sides = _loosest(before, [change for change, _ in group])
            if sides not in met:
                met.add(sides)
                found.append(Instant(s, sides))
        return found

    def forget(self, direction: bytes, instants: list[Instant]) -> None:
        """Let instants count as new where they are met again."""
        self._met[direction].difference_update(instant.sides for instant in instants)


def in_order(events: Changes, ties: Changes) -> tuple[Changes, NDArray[np.bool_]]:
    """Return ties and events in order of place, and which of them are ties."""
    every, is_tie = Changes.joined(ties, events), np.arange(len(ties) + len(events)) < len(ties)
    if not len(ties):
        return events, is_tie
    order = every.s.argsort(kind="stable")
    return every.select(order), is_tie[order]


def together(events: Changes, ties: Changes) -> list[tuple[float, list[tuple[Change, bool]]]]:
    """Sort events and ties into those that are simultaneous; say of each whether it is a tie.

    Returns:
        The place of the first of each group, and the group. The first are those at the start, if
        there are any.
    """
    every, is_tie = in_order(events, ties)
    groups, last = [(0.0, list[tuple[Change, bool]]())], 0.0
    for (s, i, old, new), tie in zip(every, is_tie.tolist(), strict=True):
        if s - last > SIMULTANEOUS:
            groups.append((s, []))
        groups[-1][1].append(((i, old, new), tie))
        last = s
    return groups


def _loosest(before: Sides, changes: list[Change]) -> Sides:
    """Return the states in which all slip that may at simultaneous changes, and who touch."""
    sides, slipped = before, dict[int, int]()
    for i, old, new in changes:
        if max(old, new) == STICK:
            continue
        turned = slipped.setdefault(i, max(old, new)) != max(old, new)
        if SEPARATION in (old, new) or STICK not in (old, new) or turned:
            slipped[i] = 0
            sides = sides.put(1 << i, 0)
        elif slipped[i] and new != STICK:
            sides = sides.put(1 << i, new)
    return sides
