"""Whole legs certified at once.

All sets of states of a leg are in one pattern: the nodes that slip on it somewhere, or sit on a
limit, each in one direction, those that are open somewhere, and those that open, close or turn,
which are judged with slip in either direction. A pattern that holds the legs of the cycles before
holds most of the next ones too, without a look at their single instants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.interface.changes import Changes
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.uniqueness.definite import Certificate
from receding_fenicsx.interface.uniqueness.patterns import Pattern, certify
from receding_fenicsx.interface.uniqueness.sides import Sides, States, bits_of

MOST_SEARCHED = 16
"""Patterns, the last used first, in which a leg is looked for before it gets one of its own."""


class Extent(NamedTuple):
    """What the nodes do on a leg; sets of nodes are integers as in ``Sides``.

    Attributes:
        forward, backward: nodes that slip against friction somewhere, or might, and where to.
        opened: nodes that are open everywhere.
        may_open: nodes that are open somewhere, or might.
        touching: nodes that open, close or turn, or might.
        together: sets of several of them that do so at one instant.
    """

    forward: int
    backward: int
    opened: int
    may_open: int
    touching: int
    together: frozenset[int]

    def united(self, other: Extent) -> Extent:
        """Return what the nodes do on either of two legs."""
        return Extent(
            self.forward | other.forward,
            self.backward | other.backward,
            self.opened & other.opened,
            self.may_open | other.may_open,
            self.touching | other.touching,
            self.together | other.together,
        )

    def sets(self) -> list[Sides]:
        """Return two sets of sides whose pattern is that of the leg."""
        on_path = Sides(self.forward, self.backward, self.opened)
        return [on_path, Sides(0, 0, self.opened, self.touching)]

    def within(self, pattern: Pattern) -> bool:
        """Return whether a pattern holds all sets of states of a leg."""
        return not (
            self.forward & ~pattern.forward
            or self.backward & ~pattern.backward
            or self.may_open & ~pattern.may_open
            or self.touching & pattern.rubbing & ~pattern.either
            or pattern.opened & ~self.opened
        ) and all(pattern.turns(nodes & pattern.rubbing) for nodes in self.together)


def turning(changes: Changes) -> NDArray[np.bool_]:
    """Return at which changes a node opens, closes or turns round its slip."""
    old, new = changes.old, changes.new
    turns: NDArray[np.bool_] = (old == SEPARATION) | (new == SEPARATION)
    return turns | ((old != STICK) & (new != STICK))


def turning_together(events: Changes, later: NDArray[np.bool_]) -> frozenset[int]:
    """Return the sets of several nodes that open, close or turn at one instant.

    Args:
        events: changes of state and ties.
        later: whether each of them is later than the one before.
    """
    turns, groups = turning(events), dict[int, int]()
    instant, nodes = later.cumsum()[turns], events.node[turns]
    several = np.bincount(instant)[instant] > 1
    for at, i in zip(instant[several].tolist(), nodes[several].tolist(), strict=True):
        groups[at] = groups.get(at, 0) | 1 << i
    return frozenset(group for group in groups.values() if group & (group - 1))


def extent(
    judge: Certificate, state: States, events: Changes, together: frozenset[int]
) -> Extent | None:
    """Return what the nodes do on a leg, its start left out.

    None where it takes single instants to tell: a node slips both ways.

    Args:
        judge: certificate of the contact.
        state: (N,) states after the start of the leg.
        events: its changes of state after the start, and its ties, in order.
        together: sets of several nodes that open, close or turn at one instant.
    """
    n = len(state)
    sides = np.zeros((5, n), dtype=bool)
    sides[state, np.arange(n)] = True
    touching = np.zeros(n, dtype=bool)
    sides[events.old, events.node] = sides[events.new, events.node] = True
    touching[events.node[turning(events)]] = True
    rubbing = judge.frictional
    forward, backward = sides[FORWARD] & rubbing, sides[BACKWARD] & rubbing
    if np.any(forward & backward):
        return None
    forward |= touching & rubbing & ~backward
    opened, may_open = (state == SEPARATION) & ~touching, sides[SEPARATION] | touching
    path = bits_of(forward), bits_of(backward), bits_of(opened), bits_of(may_open)
    return Extent(*path, bits_of(touching), together)


class WholeLegs:
    """Certifies whole legs."""

    def __init__(self, judge: Certificate, margin: float, patterns: list[Pattern]) -> None:
        """Begin with nothing known.

        Args:
            judge: certificate of the contact.
            margin: factor on friction with which a leg is to be definite.
            patterns: those of this margin, to which those of legs are added.
        """
        self._judge, self._margin, self._patterns = judge, margin, patterns
        self._latest: Extent | None = None
        self._indefinite: set[bytes] = set()

    def hold(self, way: bytes, state: States, events: Changes, later: NDArray[np.bool_]) -> bool:
        """Return whether all sets of states of a leg, but for its start, are definite.

        Args:
            way: tells legs of other directions apart.
            state: (N,) states after its start.
            events: its changes of state after that, and its ties, in order.
            later: whether each of them is later than the one before.
        """
        judge, latest = self._judge, self._latest
        if way in self._indefinite:
            return False
        leg = extent(judge, state, events, turning_together(events, later))
        if leg is None:
            return False
        # a pattern holds for all directions of the loads; it is likely to hold the next leg too
        for k, pattern in enumerate(self._patterns[:MOST_SEARCHED]):
            if leg.within(pattern):
                self._patterns.insert(0, self._patterns.pop(k))
                return True
        for nodes in (latest.united(leg), leg) if latest else (leg,):
            made = None
            if not nodes.forward & nodes.backward:
                made = certify(judge, nodes.sets(), self._margin)
            if made is not None and leg.within(made):
                self._patterns.insert(0, made)
                self._latest = nodes
                return True
        self._indefinite.add(way)
        return False
