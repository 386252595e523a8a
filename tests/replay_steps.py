"""Check one leg of a record in load steps (section 2.2 of the paper), step by step."""

from __future__ import annotations

import numpy as np
from equations import BACKWARD, EPS, FORWARD, OPEN, Array
from replay import LAW, Leg, Replay, Step, Totals


def step(run: Replay, leg: Leg, totals: Totals) -> None:
    """Check the slip and the events of all steps of a leg, add up their dissipation.

    Every step has to be kept. A node that lands slips from the point of first contact on.
    """
    table, body, n = run.record.samples, run.body, run.body.n
    events, ends = run.record.events, run.record.turning_points
    mine = (events.cycle == leg.cycle) & (events.leg == leg.number)
    error = LAW * leg.force + leg.noise
    load, u, state, s_a = leg.load(0.0), leg.u, leg.state.copy(), -1.0
    Q, P = (ends.Q[leg.row - 1], ends.P[leg.row - 1]) if leg.row else np.zeros((2, n))
    listed = 0
    for j in leg.rows:
        place, k = leg.place(table.s[j]), body.k[:n]
        load_b, now = table.load[j].astype(np.longdouble), table.state[j].astype(int)
        u_b = np.concatenate([table.v[j], table.w[j]]).astype(np.longdouble)
        v_ref, landed = u[:n].copy(), (state == OPEN) & (now != OPEN)
        for i in np.flatnonzero(landed & body.rubs):
            v_ref[i] = _touch_down(run, int(i), load_b, u, u_b)
        slip = np.where(body.rubs & (now != OPEN), u_b[:n] - v_ref, 0.0)
        against = np.where(now == FORWARD, -slip, np.where(now == BACKWARD, slip, np.abs(slip)))
        # without pressure stick and slip are one
        rows = np.flatnonzero(mine & (events.s > s_a) & (events.s <= table.s[j]))
        # a step may have been divided: what its nodes did that changed state is not kept
        changed = np.isin(np.arange(n), events.node[rows])
        pressed = body.rubs & (table.P[j] > error[n:]) & ~changed
        run.check(place, "a node slips against its state", (against * k, error[:n], pressed))
        mean = 0.5 * (np.where(landed, 0.0, Q) + table.Q[j])
        D = (-mean * slip).astype(float)
        work = float(0.5 * (load + load_b) @ body.r_star @ (u_b - u))
        lost = -(float(D.sum()) + 0.5 * float((u_b - u) @ body.K @ (u_b + u)) + work)
        totals.dissipation += D
        r = body.reactions(0.5 * (load + load_b), 0.5 * (u + u_b))
        totals.rounded += run.rounded(leg, body.states(now), r, u_b - u)
        totals.moved += float(np.abs(D).sum()) + abs(work)
        run.steps.append(Step(leg, (load, load_b), (u, u_b), (state.copy(), now), lost))
        twice = np.bincount(events.node[rows], minlength=n) > 1
        if np.any(twice & (now == OPEN)):
            # it has slipped and come off in one step: how far is not kept
            totals.known = False
        # what a node dissipates on a way that is not straight, while its force changes
        bent = 0.5 * np.abs((table.Q[j] - Q) * slip).astype(float)
        if len(rows):
            way = float(np.abs((load_b - load) @ body.r_star @ (u_b - u)))
            totals.divided += 2.0 * abs(lost) + way + float(bent.sum())
        else:  # so is one that passes to its other branch
            kinks = body.above_kink(P, slip) * body.above_kink(table.P[j], slip) < 0.0
            totals.divided += float(bent[kinks].sum())
        if run.record.jumps and np.any(events.s[rows] < table.s[j]):
            # a jump inside the step dissipates nothing, and what it releases is of no node: what
            # does dissipate is between nothing and all the energy that is given up
            totals.divided += float(np.abs(D).sum()) + abs(float(D.sum()) + lost)
        for e in rows:
            if state[events.node[e]] != events.old[e]:
                run.object(place, f"an event does not begin in its node's state (event {e})")
            state[events.node[e]] = events.new[e]
        if not np.array_equal(state, now):
            run.object(place, "the events are not the changes of state of the step")
        load, u, state, listed = load_b, u_b, now.copy(), listed + len(rows)
        Q, P = table.Q[j], table.P[j]
        s_a = float(table.s[j])
    if listed != mine.sum():
        run.object(leg.place(1.0), "an event stands after the last step")
    if not np.array_equal(u[:n], ends.v[leg.row]) or not np.array_equal(state, ends.state[leg.row]):
        run.object(leg.place(1.0), "the last step is not the leg's end")


def _touch_down(run: Replay, i: int, load: Array, u: Array, u_b: Array) -> float:
    """Return where node i first touched, on the straight way to where it would hang free."""
    body, n = run.body, run.body.n
    pair = np.array([i, n + i])
    K = body.K[np.ix_(pair, pair)].astype(float)
    r = body.reactions(load, u_b)[pair].astype(float)
    if np.linalg.det(K) <= 4 * EPS * K[0, 0] * K[1, 1]:
        # nothing carries it: it falls to the plane, where it touches without tangential force
        fall = -float(body.g0[i] + u_b[n + i])
        return float(u_b[i]) - (r[0] + K[0, 1] * fall) / K[0, 0] if K[0, 0] else float(u[i])
    v, w = u_b[pair] - np.linalg.solve(K, r)
    gap, trial = max(float(body.g0[i] + u[n + i]), 0.0), float(body.g0[i] + w)
    return float(u[i] + (v - u[i]) * gap / (gap - trial)) if trial < 0.0 else float(u[i])
