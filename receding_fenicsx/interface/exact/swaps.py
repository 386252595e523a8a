"""Rates in new sets of states from those in three neighbouring ones.

From cycle to cycle the order of events changes a little, so that most new sets of states lie among
known ones. Let a and b be changes of state of two nodes, each by one exchange of an output of the
rates with an input (see :mod:`receding_fenicsx.interface.exact.tableau`). Each exchange adds a
multiple of one column, and S, S + a, S + b, S + a + b differ by the same two. So

    q(S + b) = q(S) + x (q(S + a) - q(S)) + y (q(S + a + b) - q(S)),

where x and y follow from two entries that vanish, the input of a and the output of b. Such rates
are used where they balance; if not, they are left to the tableau.
"""

from __future__ import annotations

from scipy.linalg.blas import daxpy

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.legs import Change
from receding_fenicsx.interface.exact.segments import Following, Segment, Segments, States
from receding_fenicsx.interface.exact.tableau import EXCHANGES, SMOOTH_EXCHANGES

MOST_OVERTAKEN = 16
"""Events that one is taken to overtake at most."""

CANCELLED = 1e-8
"""Sum of two terms over their sizes, up to which it is taken for round-off. Where S + b is singular
it has been found below 1e-12, elsewhere above 1e-4."""


def overtaking(
    segments: Segments, segment: Segment, state: States, label: int, direction: Array
) -> Following | None:
    """Return what comes of an event that overtakes those which came before it last time.

    Let a_1, ..., a_k and then b be the events that came last from a set of states S_0, through S_1,
    ..., S_k. Rates in S_k + b are known; those in S_k-1 + b, ..., S_0 + b follow one from another.

    Args:
        segments: rates in known sets of states; takes the new ones.
        segment: rates at the present point.
        state: (N,) states there.
        label: the quantity that has reached its limit.
        direction: (n_loads,) change of the load factors along the leg.

    Returns:
        What comes of it; None where that takes the tableau, or more than one change of state.
    """
    steps, i = _overtaken(segment, label), label % len(state)
    if len(steps) < 2:
        return None
    *chain, last = steps
    b = next((change for change in last.changes if change[0] == i), None)
    if b is None or any(len(step.changes) > 1 or step.changes[0][0] == i for step in chain):
        return None
    after = changed(chain[-1].state, b)
    later = segments.known(after, direction)
    if later is None or len(later.reversed_nodes):
        return None
    for k, step in reversed(list(enumerate(chain))):
        at, now = (chain[k - 1].state, chain[k - 1].segment) if k else (state, segment)
        with_b, (a,) = changed(at, b), step.changes
        found = segments.known(with_b, direction)
        if found is None:
            found = _fourth(segments, (now, step.segment, later), (a, b), with_b, direction)
        if found is None or len(found.reversed_nodes):
            return None
        next_ = Following(step.label, after, later, step.changes)
        found.last = found.next.setdefault(step.label, next_)
        after, later = with_b, found
    segment.next[label] = following = Following(label, after, later, [b])
    return following


def beside(segments: Segments, state: States, b: Change, a: Change, direction: Array) -> bool:
    """Make the rates after a change of state known from those with another one.

    Args:
        segments: rates in known sets of states; takes the new ones.
        state: (N,) states S.
        b: the change.
        a: the other one.
        direction: (n_loads,) change of the load factors along the leg.

    Returns:
        Whether rates in S, S + a and S + a + b were known, and those in S + b are now.
    """
    if a[0] == b[0] or state.item(a[0]) != a[1]:
        return False
    with_a = changed(state, a)
    both = segments.known(changed(with_a, b), direction)
    there, now = segments.known(with_a, direction), segments.known(state, direction)
    if both is None or there is None or now is None:
        return False
    with_b = changed(state, b)
    return _fourth(segments, (now, there, both), (a, b), with_b, direction) is not None


def changed(state: States, change: Change) -> States:
    """Return states after a change."""
    after = state.copy()
    after[change[0]] = change[2]
    return after


def _overtaken(segment: Segment, label: int) -> list[Following]:
    """Return the events that came last from here up to that of a quantity; none without it."""
    chain, step = list[Following](), segment.last
    while step is not None and len(chain) <= MOST_OVERTAKEN:
        chain.append(step)
        if step.label == label:
            return chain
        step = step.segment.last
    return []


def _fourth(
    segments: Segments,
    known: tuple[Segment, Segment, Segment],
    changes: tuple[Change, Change],
    with_b: States,
    direction: Array,
) -> Segment | None:
    """Return the rates in S + b, and remember them.

    Args:
        segments: rates in known sets of states.
        known: those in S, S + a and S + a + b.
        changes: a and b.
        with_b: (N,) states S + b.
        direction: (n_loads,) change of the load factors along the leg.

    Returns:
        The rates; None where an event is not one exchange, or they do not balance.
    """
    a, b = (_exchange(segments, change) for change in changes)
    if a is None or b is None or segments.is_special:
        return None
    into, out = a[1], b[0]
    q0, q1, q2 = (segment.q for segment in known)
    moved, fallen = q1.item(into), q0.item(out)
    if moved == 0.0:  # where it is round-off, what follows does not balance
        return None
    ratio = q2.item(into) / moved
    change = ratio * (q1.item(out) - fallen)
    rest = fallen + change
    # where S + b leaves a motion of the body free, round-off remains, and no balance tells it
    if abs(rest) <= CANCELLED * (abs(fallen) + abs(change)):
        return None
    y = fallen / rest
    x = -ratio * y
    q = (1.0 - x - y) * q0
    daxpy(q1, q, a=x)  # in place, as q is contiguous
    daxpy(q2, q, a=y)
    q[into] = q[out] = 0.0
    found = segments.balanced(with_b, q, direction)
    if found is not None:
        segments.keep(with_b, direction, found)
    return found


def _exchange(segments: Segments, change: Change) -> tuple[int, int] | None:
    """Return the output and the input that a change of state exchanges; None if there are more."""
    i, old, new = change
    pairs = (EXCHANGES if segments.frictional.item(i) else SMOOTH_EXCHANGES).get((old, new), ())
    n = len(segments.frictional)
    return (pairs[0][0] * n + i, pairs[0][1] * n + i) if len(pairs) == 1 else None
