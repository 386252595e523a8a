"""Whole legs certified at once.

All sets of states of a leg are in one pattern: the nodes that slip on it somewhere, each in one
direction, those that are open somewhere, and those that open, close or turn, one at a time, which
are judged with slip in either direction. A pattern that holds the legs of the
cycles before holds most of the next ones too, without a look at their single instants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.uniqueness.definite import Certificate
from receding_fenicsx.interface.uniqueness.instants import Event
from receding_fenicsx.interface.uniqueness.patterns import Pattern, certify
from receding_fenicsx.interface.uniqueness.sides import Sides, States, bits_of


class Extent(NamedTuple):
    """What the nodes do on a leg; sets of nodes are integers as in ``Sides``.

    Attributes:
        forward, backward: nodes that slip against friction somewhere, and where to.
        either: those of them that open, close or turn, or might.
        opened: nodes that are open everywhere.
        may_open: nodes that are open somewhere, or might.
    """

    forward: int
    backward: int
    either: int
    opened: int
    may_open: int

    def united(self, other: Extent) -> Extent:
        """Return what the nodes do on either of two legs."""
        return Extent(
            self.forward | other.forward,
            self.backward | other.backward,
            self.either | other.either,
            self.opened & other.opened,
            self.may_open | other.may_open,
        )

    def sets(self) -> list[Sides]:
        """Return two sets of states whose pattern is that of the leg."""
        turned = Sides(self.either & self.backward, self.either & self.forward, self.may_open)
        return [Sides(self.forward, self.backward, self.opened), turned]

    def within(self, pattern: Pattern) -> bool:
        """Return whether a pattern holds all sets of states of a leg."""
        return not (
            self.forward & ~pattern.forward
            or self.backward & ~pattern.backward
            or self.either & ~pattern.either
            or self.may_open & ~pattern.may_open
            or pattern.opened & ~self.opened
        )


def extent(judge: Certificate, start: States, events: list[Event], first: int) -> Extent | None:
    """Return what the nodes do on a leg, its start left out.

    None where it takes single instants to tell.

    These are legs on which several nodes open, close or turn at once, one node changes twice at
    once, or slips both ways.

    Args:
        judge: certificate of the contact.
        start: (N,) states at the start of the leg.
        events: its changes of state, in order.
        first: the first of them after the start.
    """
    n = len(start)
    state = start.copy()
    for _, i, _, new_state in events[:first]:
        state[i] = new_state
    sides = np.zeros((5, n), dtype=bool)
    sides[state, np.arange(n)] = True
    touching = np.zeros(n, dtype=bool)
    if len(events) > first:
        places, nodes, old, new = (np.array(part) for part in zip(*events[first:], strict=True))
        sides[old, nodes] = sides[new, nodes] = True
        turns = (old == SEPARATION) | (new == SEPARATION) | ((old != STICK) & (new != STICK))
        touching[nodes[turns]] = True
        instant = np.append(0, np.diff(places) > 0.0).cumsum()
        changes = instant * n + nodes
        if np.bincount(instant, turns).max() > 1 or len(np.unique(changes)) < len(changes):
            return None
    rubbing = judge.frictional
    forward, backward = sides[FORWARD] & rubbing, sides[BACKWARD] & rubbing
    if np.any(forward & backward):
        return None
    either = touching & rubbing
    forward |= either & ~backward
    opened, may_open = (state == SEPARATION) & ~touching, sides[SEPARATION] | touching
    return Extent(*map(bits_of, (forward, backward, either, opened, may_open)))


class WholeLegs:
    """Certifies whole legs; remembers one pattern for each direction of the loads."""

    def __init__(self, judge: Certificate, margin: float) -> None:
        """Begin with nothing known.

        Args:
            judge: certificate of the contact.
            margin: factor on friction with which a leg is to be definite.
        """
        self._judge, self._margin = judge, margin
        self._known: dict[bytes, tuple[Extent, Pattern] | None] = {}

    def hold(self, way: bytes, start: States, events: list[Event], first: int) -> bool:
        """Return whether all sets of states of a leg, but for its start, are definite.

        Args:
            way: tells legs of other directions apart.
            start: (N,) states at its start.
            events: its changes of state, in order.
            first: the first of them after the start.
        """
        known = self._known.get(way, ())
        leg = None if known is None else extent(self._judge, start, events, first)
        if leg is None:
            return False
        if known and leg.within(known[1]):
            return True
        # a pattern of all legs so far is likely to hold the next one
        wide = known[0].united(leg) if known else leg
        for nodes in (wide, leg) if known else (leg,):
            pattern = self._certified(nodes)
            if pattern is not None:
                self._known[way] = nodes, pattern
                return True
        self._known[way] = None
        return False

    def _certified(self, leg: Extent) -> Pattern | None:
        """Return the pattern of a leg, None where it is not definite as a whole."""
        if leg.forward & leg.backward:
            return None
        pattern = certify(self._judge, leg.sets(), self._margin)
        return pattern if pattern is not None and leg.within(pattern) else None
