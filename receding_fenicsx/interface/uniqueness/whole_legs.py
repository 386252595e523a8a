"""Whole legs certified at once.

All sets of states of a leg are in one pattern: the nodes that slip on it somewhere, each in one
direction, those that are open somewhere, and those that open, close or turn, one at a time, which
are judged with slip in either direction. A pattern that holds the legs of the
cycles before holds most of the next ones too, without a look at their single instants.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from receding_fenicsx.interface.exact.legs import Change
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


class Known(NamedTuple):
    """A pattern of legs.

    Attributes:
        extent: what the nodes do on these legs, or on more.
        pattern: their pattern.
        changes: changes of state that keep a leg within it.
    """

    extent: Extent
    pattern: Pattern
    changes: set[Change]

    def holds(self, judge: Certificate, state: States, events: list[Event], apart: bool) -> bool:
        """Return whether the pattern holds a leg, where that is seen from single changes.

        Args:
            judge: certificate of the contact.
            state: (N,) states after the start of the leg.
            events: its changes of state after the start, in order.
            apart: no two of them are at one place.
        """
        if not apart:
            together = {event[1:] for a, b in pairwise(events) if a[0] == b[0] for event in (a, b)}
            if any(map(turns, together)) or len({i for i, _, _ in together}) < len(together):
                return False
        forward, backward, open_ = Sides.of(state).of_nodes(judge.rubbing)
        at_start = Extent(forward, backward, 0, open_, open_)
        if not at_start.within(self.pattern):
            return False
        made = {event[1:] for event in events}
        made -= self.changes
        if not all(self._keeps(change, judge.rubbing) for change in made):
            return False
        self.changes.update(made)
        return True

    def _keeps(self, change: Change, rubbing: int) -> bool:
        """Return whether the pattern holds the states before, after and at a change."""
        (i, old, new), pattern = change, self.pattern
        node = 1 << i
        slips = node & rubbing
        return not (
            (FORWARD in (old, new) and slips & ~pattern.forward)
            or (BACKWARD in (old, new) and slips & ~pattern.backward)
            or (turns(change) and (slips & ~pattern.either or node & ~pattern.may_open))
            or (turns(change) and node & pattern.opened)
        )


def turns(change: Change) -> bool:
    """Return whether a node opens, closes or turns round its slip."""
    _, old, new = change
    return SEPARATION in (old, new) or STICK not in (old, new)


def extent(judge: Certificate, state: States, events: list[Event]) -> Extent | None:
    """Return what the nodes do on a leg, its start left out.

    None where it takes single instants to tell: several nodes open, close or turn at once, or one
    node changes twice at once or slips both ways.

    Args:
        judge: certificate of the contact.
        state: (N,) states after the start of the leg.
        events: its changes of state after the start, in order.
    """
    n = len(state)
    sides = np.zeros((5, n), dtype=bool)
    sides[state, np.arange(n)] = True
    touching = np.zeros(n, dtype=bool)
    if events:
        places, nodes, old, new = (np.array(part) for part in zip(*events, strict=True))
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

    def __init__(self, judge: Certificate, margin: float, patterns: list[Pattern]) -> None:
        """Begin with nothing known.

        Args:
            judge: certificate of the contact.
            margin: factor on friction with which a leg is to be definite.
            patterns: those of this margin, to which those of legs are added.
        """
        self._judge, self._margin, self._patterns = judge, margin, patterns
        self._known: dict[bytes, Known | None] = {}

    def hold(self, way: bytes, start: States, events: list[Event], first: int, apart: bool) -> bool:
        """Return whether all sets of states of a leg, but for its start, are definite.

        Args:
            way: tells legs of other directions apart.
            start: (N,) states at its start.
            events: its changes of state, in order.
            first: the first of them after the start.
            apart: no two from there on are at one place.
        """
        known, judge = self._known.get(way), self._judge
        if way in self._known and known is None:
            return False
        state, at_start, events = start.copy(), events[:first], events[first:]
        for _, i, _, new in at_start:
            state[i] = new
        if known and known.holds(judge, state, events, apart):
            return True
        leg = extent(judge, state, events)
        if leg is None:
            return False
        if known and leg.within(known.pattern):
            return True
        # a pattern of all legs so far is likely to hold the next one
        for nodes in (known.extent.united(leg), leg) if known else (leg,):
            pattern = self._certified(nodes)
            if pattern is not None:
                self._patterns.insert(0, pattern)
                self._known[way] = Known(nodes, pattern, set())
                return True
        self._known[way] = None
        return False

    def _certified(self, leg: Extent) -> Pattern | None:
        """Return the pattern of a leg, None where it is not definite as a whole."""
        if leg.forward & leg.backward:
            return None
        pattern = certify(self._judge, leg.sets(), self._margin)
        return pattern if pattern is not None and leg.within(pattern) else None
