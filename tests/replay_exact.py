"""Replay one leg of an exact record from event to event."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from equations import BACKWARD, EPS, FORWARD, OPEN, ROUNDINGS, STICK, Array, States
from replay import LAW, Jump, Leg, Replay, Totals

SAME_PLACE = 1e-13
"""Part of a leg within which events are one."""
PLACE = 1e-11
"""Error of an event's place, in parts of its leg, that is let pass."""
JUMP_STEP = 3e-7
"""Part of a leg within which the state that is jumped to may lie beyond the place of the jump."""
JUMP_LAW = 1e-6
"""Violation of friction's law by a jump, over the largest force: it lies that far off its place."""
DOUBTS = 16.0
"""Such uncertainties of displacements, as first-order estimates, that are let pass; in forces too,
where states change."""
TELLING = 0.01
"""Parts of a piece between its kept instants below which they do not tell its drift."""
KINK = 1e-10
"""Difference of the branches of a slipping node, over the largest force, that is none."""
APEX = 1e-8
"""Error, over the leg's forces, of a state that is set where complete unloading is reached."""


def follow(run: Replay, leg: Leg, totals: Totals) -> None:
    """Replay a leg from its start to its end; add up its energies."""
    record, body, n = run.record, run.body, run.body.n
    s_zero = _unloaded_at(leg)
    groups, changed, between = _groups(run, leg, s_zero)
    if not np.array_equal(groups[-1][1], record.turning_points.state[leg.row]):
        run.object(leg.place(1.0), "the events do not lead to the states at the leg's end")
    kept: list[tuple[float, Any, int] | None] = [
        (float(record.samples.s[j]), record.samples, int(j)) for j in leg.rows
    ]
    kept.append((1.0, record.turning_points, leg.row))
    unloads = not np.any(leg.ends[1]) and not np.any(body.g0)
    state, u = leg.state, leg.u
    doubt = EPS * np.abs(u).astype(float) + run.doubt / body.k
    # what an unloaded body that supports hold keeps of its displacements is round-off
    held = not (np.any(body.g0) or run.system.rigid.shape[1])
    s_unloaded = s_zero if held else np.inf
    s_apex = 1.0 if unloads else s_zero
    left = np.zeros(2 * n)
    s_held, size = 0.0, np.abs(body.K).astype(float)
    misplaced, spread = np.zeros((2, 2 * n))  # forces by places of events and by round-off
    for g, (s_a, now) in enumerate(groups):
        s_b, following = groups[g + 1] if g + 1 < len(groups) else (1.0, None)
        _choose_branches(run, leg, s_a, now, u)
        here = body.states(now)
        u_a = here.solve(leg.load(s_a), u[:n], u)
        doubt_a = _reach(leg, here, doubt)
        apart = bool(np.any(np.abs(u_a - u) > doubt + doubt_a))
        jumps_before = s_a - s_held > 0.1 * JUMP_STEP or _slips_at(s_a, state, now, between)
        if run.record.jumps and jumps_before:
            apart = True
        if s_held < s_a and not apart:
            run.object(leg.place(s_a), "an event lies beyond its place", s_a - s_held, PLACE)
        if apart and not _rolls(run, leg, (s_a, u), u_a - u, s_zero):
            before = (s_held, s_a), u, state
            after = _jump(run, leg, before, (groups[g:], changed[g:]), kept, totals)
            if after is None:
                totals.known = False
                return
            u_a, here = after, body.states(now)
        elif not apart:
            _look_for_hidden_jump(run, leg, (s_a, u), here, u_a - u, totals)
            _shift(run, leg.load(s_a), u, u_a - u, totals)
        u_b = u_a + here.rates(leg.load(s_b) - leg.load(s_a))
        s_kink = _kink(run, leg, (s_a, s_b), here, (u_a, u_b))
        off = False
        if s_a < s_kink < s_b:
            u_b = u_a + (s_kink - s_a) / (s_b - s_a) * (u_b - u_a)
            # the states stay, an equation changes; or none leads on, and the body jumps
            off = bool(run.record.jumps) and s_b - s_kink <= JUMP_STEP
            if not off:
                groups.insert(g + 1, (s_kink, now))
                changed.insert(g + 1, set())
                following = None
            s_b = s_kink
        drifts = _drifts(run, here, now, (s_a, s_b), (u_a, u_b), (kept, s_apex))
        lifts = np.any(np.abs(here.free[:, n:][:, now == OPEN]) > LAW)
        if lifts and (drifts is None or np.all(now == OPEN)):
            # how a body drifts that touches nowhere is not determined, between two events neither
            totals.known = False
            return
        if drifts is None:
            totals.adrift |= here.slides_freely
        else:
            u_a, u_b = u_a + drifts[0], u_b + drifts[1]
        doubt = _reach(leg, here, doubt)
        if following is not None:
            if not off:
                capped = body.capped.copy()
                _choose_branches(run, leg, s_b, following, u_b)
                next_ = body.states(following)
                body.capped = capped
                u_next = next_.solve(leg.load(s_b), u_b[:n], u_b)
                off = bool(np.any(np.abs(u_next - u_b) > doubt + _reach(leg, next_, doubt)))
            off = off or (run.record.jumps and _slips_at(s_b, now, following, between))
            of_places = float((misplaced + spread + PLACE * _moved(leg, here)).max())
            s_jump = _jump_place(run, leg, (s_a, s_b), now, (u_a, u_b))
            if abs(s_b - s_jump - 1e-7) > 1e-8:  # at 1e-7 a record passes a jump
                s_jump = _jump_place(run, leg, (s_a, s_b), now, (u_a, u_b), of_places)
            # in a limit of infinitely many cycles a jump may become too small to be seen
            if off or (run.record.jumps and s_b - s_jump > 0.1 * JUMP_STEP):
                u_b = u_a + (s_jump - s_a) / max(s_b - s_a, EPS) * (u_b - u_a)
                s_b = s_jump
        s_held = s_b
        misplaced = misplaced + PLACE * _moved(leg, here)
        for s, at in ((s_a, u_a), (s_b, u_b)):
            slack = misplaced + DOUBTS * spread + APEX * leg.force * (unloads and s == 1.0)
            _check_law(run, leg, (s, at), now, slack)
        # gaps and slips keep their round-off when states change
        rounded = here.reach(here.row_errors(leg.noise))
        spread = spread + size @ rounded
        run.doubt = np.maximum(run.doubt, body.k * rounded)
        _add_up(run, leg, (s_a, s_b), here, (u_a, u_b), totals)
        if s_a >= s_unloaded - PLACE and not np.any(left):
            left = np.maximum(np.abs(u), np.abs(u_a)).astype(float)
        allowed = DOUBTS * (doubt + doubt_a) + left
        if unloads and s_b == 1.0:
            allowed = allowed + here.reach(np.full(2 * n, APEX * leg.force))
        u = u_b + _check_kept(run, leg, (s_a, s_b), now, (u_a, u_b), (kept, allowed, s_apex))
        state = now
    end = np.concatenate([record.turning_points.v[leg.row], record.turning_points.w[leg.row]])
    _shift(run, leg.load(1.0), u, end - u, totals)
    for instant in kept:
        if instant is not None and not any(
            abs(s - instant[0]) <= SAME_PLACE and np.array_equal(now, instant[1].state[instant[2]])
            for s, now in between
        ):
            run.object(leg.place(instant[0]), "the states are not those that the events lead to")


def _shift(run: Replay, load: Array, u: Array, change: Array, totals: Totals) -> None:
    """Add up the work of the loads on a change of u that is round-off of the record."""
    totals.work += float(load @ run.body.r_star @ change)
    totals.misfit += float(np.abs(run.body.reactions(load, u) * change).sum())


def _choose_branches(run: Replay, leg: Leg, s: float, now: Array, u: Array) -> None:
    """Choose the branch of every slipping node from its pressure, where both hold from its rate."""
    body, n = run.body, run.body.n
    if not body.branched:
        return
    slip = np.where(now == FORWARD, 1.0, 0.0) - np.where(now == BACKWARD, 1.0, 0.0)
    above = body.above_kink(body.reactions(leg.load(s), u)[n:], slip).astype(float)
    close = KINK * leg.force + leg.noise[n:]
    tied = np.flatnonzero(np.abs(above) <= close)
    way = np.array(leg.ends[1] - leg.ends[0], np.longdouble)
    for choice in product((False, True), repeat=min(len(tied), 8)):
        body.capped = above > 0.0
        body.capped[tied] = np.resize(choice, len(tied))  # equal nodes take equal branches
        du = body.states(now).rates(way)
        slope = np.where(slip > 0.0, body.f, body.f_backward)[tied]
        rate = slope * (way @ body.r_star + body.K @ du)[n:][tied].astype(float)
        if np.all(
            np.where(body.capped[tied], rate, -rate) >= -KINK * np.abs(rate).max(initial=0.0)
        ):
            return
    run.object(leg.place(s), "no branch of a slipping node leads on")


def _kink(
    run: Replay, leg: Leg, at: tuple[float, float], here: States, ends: tuple[Array, Array]
) -> float:
    """Return the first place on a piece where a slipping node passes to its other branch."""
    body, n = run.body, run.body.n
    above = [
        body.above_kink(body.reactions(leg.load(s), u)[n:], here.sign).astype(float)
        for s, u in zip(at, ends, strict=True)
    ]
    sign = np.where(body.capped, -1.0, 1.0)
    close = KINK * leg.force + leg.noise[n:]
    passes = body.rubs & (here.sign != 0.0) & (sign * above[1] > close)
    passes &= np.isfinite(body.t)
    before = np.minimum(sign * above[0], 0.0)[passes]
    parts = before / (before - (sign * above[1])[passes])
    return float(at[0] + parts.min(initial=1.0) * (at[1] - at[0])) if len(parts) else at[1]


def _groups(
    run: Replay, leg: Leg, s_zero: float
) -> tuple[list[tuple[float, Array]], list[set[int]], list[tuple[float, Array]]]:
    """Return the states from each place of the leg on, and the nodes with events at each place.

    Events must follow from each other. A place where all loads vanish, ``s_zero``, is one without.
    The third value holds the states between events at one place.
    """
    events = run.record.events
    groups: list[tuple[float, Array]] = [(0.0, leg.state.copy())]
    changed: list[set[int]] = [set()]
    between: list[tuple[float, Array]] = []
    for j in np.flatnonzero((events.cycle == leg.cycle) & (events.leg == leg.number)):
        s, i, now = float(events.s[j]), int(events.node[j]), groups[-1][1].copy()
        if s < groups[-1][0] - SAME_PLACE:
            run.object(leg.place(s), "an event stands after a later one")
        if now[i] != events.old[j] or events.old[j] == events.new[j]:
            what = f"an event begins in state {events.old[j]}, the node is in {now[i]} (node {i})"
            run.object(leg.place(s), what)
        now[i] = events.new[j]
        if s - groups[-1][0] <= SAME_PLACE:
            between.append(groups[-1])
            groups[-1] = groups[-1][0], now
        else:
            groups.append((s, now))
            changed.append(set())
        changed[-1].add(i)
    places = [s for s, _ in groups]
    if s_zero < 1.0 and np.abs(np.array(places) - s_zero).min() > SAME_PLACE:
        g = int(np.searchsorted(places, s_zero))
        groups.insert(g, (s_zero, groups[g - 1][1]))
        changed.insert(g, set())
    return groups, changed, between


def _unloaded_at(leg: Leg) -> float:
    """Return the place of a leg at which all loads vanish together, infinite where they do not."""
    a, b = leg.ends
    s = float(a @ (a - b)) / (float((a - b) @ (a - b)) or 1.0)
    vanish = np.abs((1.0 - s) * a + s * b).max() <= PLACE * max(np.abs(a).max(), np.abs(b).max())
    return s if vanish and 0.0 <= s < 1.0 else np.inf


def _reach(leg: Leg, states: States, doubt: Array) -> Array:
    """Return (2N,) how far displacements may be off; ``doubt`` is that of the stuck nodes."""
    body, n = states.body, states.body.n
    rows = states.row_errors(LAW * leg.force + leg.noise)
    rows[:n] += np.where(states.stuck, body.k[:n] * doubt[:n], 0.0)
    return states.reach(rows) + LAW * leg.force / body.k


def _slips_at(s: float, before: Array, after: Array, between: list[tuple[float, Array]]) -> bool:
    """Return whether a node begins to slip and sticks at one place: then it has jumped."""
    return any(
        np.any((now >= FORWARD) & (now != before) & (after == STICK))
        for at, now in between
        if abs(at - s) <= SAME_PLACE
    )


def _look_for_hidden_jump(
    run: Replay, leg: Leg, before: tuple[float, Array], here: States, change: Array, totals: Totals
) -> None:
    """Note a change of u that may be a jump: more than its own round-off, less than that so far."""
    (s, u), body = before, run.body
    load = leg.load(s)
    if np.any(np.abs(change) > DOUBTS * _own_round_off(run, leg, here, load, u)):
        energy = 0.5 * float(change @ body.K @ (2.0 * u + change))
        totals.hidden += 1
        totals.unsure += abs(energy + float(load @ body.r_star @ change))


def _own_round_off(run: Replay, leg: Leg, here: States, load: Array, u: Array) -> Array:
    """Return the round-off (2N,) of displacements u that are solved for in some states."""
    rows = here.row_errors(LAW * leg.force + run.body.round_off(load, u))
    own: Array = here.reach(rows) + LAW * leg.force / run.body.k
    return own


def _rolls(
    run: Replay, leg: Leg, before: tuple[float, Array], change: Array, s_zero: float
) -> bool:
    """Return whether a body without contact forces moves as a rigid one, which costs nothing."""
    s, u = before
    if s > 0.0 and not abs(s - s_zero) <= PLACE:
        return False
    forces = np.abs([run.body.reactions(leg.load(s), u), run.body.K @ change])
    return bool(forces[:, ~run.system.held].max(initial=0.0) <= LAW * leg.force)


def _moved(leg: Leg, here: States) -> Array:
    """Return (2N,) by how much reactions and displacements, as forces, change along a leg."""
    way = np.array(leg.ends[1] - leg.ends[0], np.longdouble)
    rate, body = here.rates(way), here.body
    return (np.abs(way @ body.r_star + body.K @ rate) + body.k * np.abs(rate)).astype(float)


def _check_law(run: Replay, leg: Leg, at: tuple[float, Array], now: Array, slack: Array) -> None:
    """Check the inequalities of the states at one end of a piece."""
    body, n, here = run.body, run.body.n, run.body.states(now)
    s, u = at
    r, k = body.reactions(leg.load(s), u), body.k
    error = LAW * leg.force + leg.noise + slack + here.reach_of_forces(here.row_errors(leg.noise))
    e_n = error[n:]
    Q, P, gap = r[:n], r[n:], (body.g0 + u[n:]) * k[n:]
    e_gap = e_n + k[n:] * here.reach(here.row_errors(leg.noise))[n:]
    touches, law = now != OPEN, ~body.carried
    stuck, place = body.rubs & (now == STICK), leg.place(s)
    run.check(place, "a touching node is pulled", (-P, e_n, law & touches))
    run.check(place, "an open node penetrates", (-gap, e_gap, law & ~touches))
    over = (body.beyond(Q, P), body.cone_error(error), stuck)
    run.check(place, "a stuck node passes friction's limit", over)


def _add_up(
    run: Replay,
    leg: Leg,
    at: tuple[float, float],
    here: States,
    ends: tuple[Array, Array],
    totals: Totals,
) -> None:
    """Check the slip of a piece, add up its dissipation -integral Q dv and work."""
    body, n, loads = run.body, run.body.n, [leg.load(s) for s in at]
    du = ends[1] - ends[0]
    ways = (body.k * np.abs(du)).astype(float)
    allowed = LAW * leg.force + (LAW + ROUNDINGS * EPS * here.condition) * ways.max()
    allowed = allowed + body.k[:n] * here.reach(here.row_errors(leg.noise))[:n]
    against = -here.sign * du[:n] * body.k[:n]
    what = f"up to s = {at[1]:.9g} a node slips against its direction"
    run.check(leg.place(at[0]), what, (against, allowed, True))
    mean = 0.5 * (body.reactions(loads[0], ends[0]) + body.reactions(loads[1], ends[1]))
    D = np.where(body.rubs & here.touches, -mean[:n] * du[:n], 0.0).astype(float)
    work = (0.5 * (loads[0] + loads[1]) @ body.r_star) * du
    totals.dissipation += D
    totals.work += float(work.sum())
    totals.moved += float(np.abs(D).sum() + np.abs(work).sum() + np.abs(mean @ du))
    totals.rounded += run.rounded(leg, here, mean, du)
    totals.largest = max(totals.largest, float(np.abs(np.array(ends)).max()))


def _drifts(
    run: Replay,
    here: States,
    now: Array,
    at: tuple[float, float],
    ends: tuple[Array, Array],
    kept: tuple[list[tuple[float, Any, int] | None], float],
) -> Array | None:
    """Return (2, 2N) drift at both ends of a piece along motions that its states leave free.

    It costs nothing, so that the record is believed; its kept instants on the piece have to lie on
    one line, those where all loads vanish excepted. None where too few tell.
    """
    if not len(here.free):
        return np.zeros((2, 2 * here.body.n))
    parts, drifts = [], []
    for _, instant in _on_piece(at, now, kept[0]):
        if abs(instant[0] - kept[1]) <= SAME_PLACE:
            continue
        part, there = _instant(at, instant)
        parts.append(part)
        drifts.append(here.free @ (there - (ends[0] + part * (ends[1] - ends[0]))).astype(float))
    lines = np.array([[1.0 - part, part] for part in parts]).reshape(-1, 2)
    if len(parts) == 1:  # a drift that begins with the piece
        lines[:, 0], run.guessed = 0.0, True
    if np.linalg.matrix_rank(lines, tol=TELLING) < min(len(parts), 2) or not parts:
        return None
    return np.linalg.lstsq(lines, np.array(drifts), rcond=None)[0] @ here.free


def _on_piece(
    at: tuple[float, float], now: Array, kept: list[tuple[float, Any, int] | None]
) -> list[tuple[int, tuple[float, Any, int]]]:
    """Return the kept instants on a piece, in its states, with their number."""
    return [
        (j, instant)
        for j, instant in enumerate(kept)
        if instant is not None
        and at[0] - SAME_PLACE <= instant[0] <= at[1] + SAME_PLACE
        and np.array_equal(instant[1].state[instant[2]], now)
    ]


def _instant(at: tuple[float, float], instant: tuple[float, Any, int]) -> tuple[float, Array]:
    """Return the part of a piece at which a kept instant is, and its displacements."""
    s, table, row = instant
    part = (s - at[0]) / (at[1] - at[0]) if at[1] > at[0] else 1.0
    return part, np.concatenate([table.v[row], table.w[row]])


def _check_kept(
    run: Replay,
    leg: Leg,
    at: tuple[float, float],
    now: Array,
    ends: tuple[Array, Array],
    kept: tuple[list[tuple[float, Any, int] | None], Array, float],
) -> Array:
    """Compare kept instants with the piece they are on, and cross them out.

    Returns:
        (2N,) by how much the record lays the body elsewhere where all loads vanish, along motions
        that the states leave free.
    """
    free, laid = run.body.states(now).free, np.zeros(2 * run.body.n)
    for j, instant in _on_piece(at, now, kept[0]):
        kept[0][j] = None
        part, there = _instant(at, instant)
        apart = (there - (ends[0] + part * (ends[1] - ends[0]))).astype(float)
        if abs(instant[0] - kept[2]) <= SAME_PLACE:
            laid = (free @ apart) @ free
            apart = apart - laid
        over = (np.abs(apart), kept[1], True)
        run.check(leg.place(instant[0]), "u is not what states and events lead to", over)
    return laid


def _jump_place(
    run: Replay,
    leg: Leg,
    at: tuple[float, float],
    now: Array,
    ends: tuple[Array, Array],
    slack: float = 0.0,
) -> float:
    """Return the place on a piece before a jump up to which its laws hold, but for a slack."""
    body, n, here = run.body, run.body.n, run.body.states(now)
    margins = [_margins(run, leg.load(s), now, u) for s, u in zip(at, ends, strict=True)]
    crossed = (margins[1] < -slack) & (margins[1] < margins[0])
    parts = margins[0][crossed] / (margins[0] - margins[1])[crossed]
    part = max(0.0, float(parts.min(initial=1.0)))
    if np.any(-here.sign * (ends[1] - ends[0])[:n] * body.k[:n] > LAW * leg.force):
        part = 0.0
    s = at[0] + part * (at[1] - at[0])
    return s if at[1] - s <= JUMP_STEP else at[1]


def _margins(run: Replay, load: Array, now: Array, u: Array) -> Array:
    """Return all forces and gaps that must not be negative in the states."""
    body, n = run.body, run.body.n
    r = body.reactions(load, u)
    touches, law = now != OPEN, ~body.carried
    stuck = body.rubs & (now == STICK)
    gap = (body.g0 + u[n:]) * body.k[n:]
    cone = [
        (limit + side * r[:n])[stuck & np.isfinite(limit)]
        for side, slope in ((-1.0, body.f_backward), (1.0, body.f))
        for limit in (slope * r[n:] + body.c, body.t)
    ]
    return np.concatenate([r[n:][law & touches], gap[law & ~touches], *cone]).astype(float)


def _jump(
    run: Replay,
    leg: Leg,
    before: tuple[tuple[float, float], Array, Array],
    following: tuple[list[tuple[float, Array]], list[set[int]]],
    kept: list[tuple[float, Any, int] | None],
    totals: Totals,
) -> Array | None:
    """Take a jump between two places (s, u, states); return u after it, None if that is not known.

    Where a node landed, or slipped before it stuck, is known from the next kept instant only.
    """
    body, n = run.body, run.body.n
    later, changed = following
    ((s_held, s), u, old), here = before, run.body.states(later[0][1])
    # a node that has slipped in the jump may stick where it comes to rest
    moved = np.isin(np.arange(n), list(changed[0]))
    if run.record.jumps == 0:
        run.object(leg.place(s), "displacements jump, no jump is counted")
    v_ref = u[:n].copy()
    for i in np.flatnonzero(here.stuck & ((old != STICK) | moved)):
        # it may also slip and stick again in the next jump
        ahead = zip(later[1:], changed[1:], strict=True)
        end = min((at for (at, now), nodes in ahead if now[i] != STICK or i in nodes), default=1.0)
        seen = [instant for instant in kept if instant is not None and s <= instant[0] <= end]
        if not seen:
            return None
        v_ref[i] = seen[0][1].v[seen[0][2]][i]
    load, way = leg.load(s), leg.ends[1] - leg.ends[0]
    if s_held == s:  # laws do not tell its place: slips go on up to there or not
        slip = body.states(old).rates(way.astype(np.longdouble))[:n]
        totals.misfit += JUMP_STEP * float(np.abs(body.reactions(load, u)[:n] * slip).sum())
    before_it, slipping = body.capped & (here.sign != 0.0), np.flatnonzero(here.sign)[:8]
    kept_or_other = product((False, True), repeat=len(slipping)) if body.branched else ()
    for choice in (before_it[slipping], *kept_or_other):  # the branches are those behind the jump
        body.capped = before_it.copy()
        body.capped[slipping] = choice
        here = body.states(later[0][1])
        after = here.solve(load, v_ref, u)
        change, r = after - u, body.reactions(load, after)
        dv = np.where(here.touches & (old != OPEN), change[:n], 0.0)
        slid = body.rubs & (np.abs(dv) * body.k[:n] > JUMP_LAW * leg.force) & ~(here.stuck & moved)
        off = body.off_limit(r[:n], r[n:], dv)
        above = body.above_kink(r[n:], here.sign) > 0.0
        worst = max(off[slid].max(initial=0.0), -_margins(run, load, later[0][1], after).min())
        if np.array_equal(above, body.capped) and worst <= JUMP_LAW * leg.force:
            break
    over = (off, np.full(n, JUMP_LAW * leg.force), slid)
    run.check(leg.place(s), "a node slips against friction in a jump", over)
    work = float(load @ body.r_star @ change)
    totals.released -= 0.5 * float(change @ body.K @ (after + u)) + work
    totals.work += work
    # it is solved for just beyond its place
    totals.unsure += JUMP_STEP * abs(float(way @ body.r_star @ change))
    totals.unsure += run.rounded(leg, here, body.reactions(load, u) + r, change)
    smooth = np.abs(change - here.rates(load - leg.load(s_held)))
    if not np.any(np.minimum(np.abs(change), smooth) > _own_round_off(run, leg, here, load, u)):
        # a node may reach its limit and stick where another one lands, or slip on from there
        totals.hidden += 1
        return after
    totals.jumps += 1
    run.jumps.append(Jump(leg, s_held, u.astype(float), old, float(run.doubt.max())))
    return after
