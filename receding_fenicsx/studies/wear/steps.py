"""Wear steps on the condensed system: limit cycle, implicit increments, control of the step."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import continue_history
from receding_fenicsx.evolution.instants import FinishedCycle, Instant, Totals, instant
from receding_fenicsx.evolution.journal import Journal
from receding_fenicsx.evolution.problem import Problem
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.run_state import RunState
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState
from receding_fenicsx.scene.model import OutputOptions

Row = Any
"""One row of an array of :func:`row_type`."""


def row_type(n: int) -> np.dtype[np.void]:
    """Return the type of the rows of a wear record: the contact after a number of cycles.

    Numbers: ``cycles``, ``step`` (cycles that the next step tries), largest nodal ``force`` so far,
    ``dissipated`` energy so far, ``corner`` of the loop with the largest pressure. At the n nodes
    of the model: ``depth`` worn off, its estimated error ``estimate``; ``energy`` and slip ``path``
    of the limit cycle, ``P`` and ``v`` at that corner, ``zone``: separated throughout the cycle,
    stuck or slipping; ``u``, ``r``, ``state`` at its end; ``worn``: depth of each body if carried.
    """
    numbers = [(name, "<f8") for name in ("cycles", "step", "force", "dissipated")]
    names = ("depth", "estimate", "energy", "path", "P", "v")
    nodal = [(name, "<f8", (n,)) for name in names]
    states = [(name, "i1", (n,)) for name in ("zone", "state")]
    both = [(name, "<f8", (2, n)) for name in ("u", "r", "worn")]
    return np.dtype([*numbers, *nodal, *both, *states, ("corner", "<i4")])


class _SmallTail(Exception):
    """What is still to come of a tail of cycles is small."""


class NodePairs:
    """Wear of node pairs that stay opposite each other.

    Attributes:
        whole: the contact without wear, its history and solver.
        problem: the same without probes, to be played until cycles repeat.
        rate: (N,) depth per dissipation of a node, c / m; 0 where nothing wears.
        carried: whether the profiles are carried along by the stroke.
        slip_at_corners: mean slips at the corners of the unworn contact's loop.
    """

    carried = False

    def __init__(self, problem: Problem, coefficient: float | Array) -> None:
        """Prepare; ``coefficient`` is the depth per density of dissipated energy."""
        history, self.whole = problem.history, problem
        self.problem = replace(
            problem,
            system=replace(problem.system, probes=None),
            history=replace(history, cycles=60, until_steady=False, until_limit=True),
            output=OutputOptions(samples_per_leg=1, cycles=()),
            judged=False,
        )
        self.slip_at_corners = np.zeros(0)
        weight = problem.system.weight
        self.rate = coefficient / np.where(weight > 0.0, weight, np.inf)

    def begin(self) -> Row:
        """Return the row of the unworn contact."""
        row, ends = self._repeated(np.zeros((), row_type(self.problem.system.n)), self.problem)
        on = row["P"] > 0.0
        self.slip_at_corners = np.array([end.v[on].mean() for end in ends])
        return row

    def settled(self, row: Row, worn: Array) -> Row:
        """Grow the gap along a leg of its own, and play cycles until they repeat."""
        system, history = self.problem.system, self.problem.history
        n, loop = system.n, history.loop
        # in terms of w + growth, a growing gap is a load: r = ... + K [v; w]
        grown = replace(
            system,
            g0=system.g0 + row["depth"],
            r_star=np.vstack([system.r_star, -system.K[:, n:] @ worn]),
            load_names=(*system.load_names, "wear"),
            load_compliance=np.zeros((0, 0)),
        )
        legs = replace(
            history,
            load_names=grown.load_names,
            path=np.column_stack([loop[[0, 0]], [0.0, 1.0]]),
            loop=np.pad(loop, ((0, 0), (0, 1)), constant_values=1.0),
        )
        problem = replace(self.problem, system=grown, history=legs, initial_slip=np.zeros(n))
        found, _ = self._repeated(row, problem)
        found["depth"] += worn
        found["u"][1] -= worn
        return found

    def _repeated(self, row: Row, problem: Problem) -> tuple[Row, list[Instant]]:
        """Play a path from a row, or from rest, and cycles until they repeat.

        Return the row of the last one, and its corners.
        """
        journal = Journal()
        cycles, run = journal.cycles, RunState(problem, [])
        if row["force"] > 0.0:
            totals = Totals(force_scale=float(row["force"]))
            run.position = run.position._replace(state=_state(row), totals=totals)
        stiffness = np.concatenate(problem.system.local_stiffness)
        repeats = False
        # four plain ones, before the limit is searched for
        while not repeats and len(cycles) <= 4:
            cycles.append(run.trace_cycle(len(cycles)))
            if len(cycles) > 1:
                before, after = (cycle.corners[-1].state.u for cycle in cycles[-2:])
                moved = np.abs(stiffness * (after - before)).max()
                repeats = moved <= 1e-9 * cycles[-1].totals.force_scale
        if not repeats:

            def to_come() -> float:
                """Return what is to come of a tail that falls with the cycles cubed."""
                before, after = cycles[-2].dissipation, cycles[-1].dissipation
                return float(len(cycles) * np.abs(after - before).max() / (after.max() or np.inf))

            def stop_at_small_tail(*_: Any) -> None:
                # its exact limit may take a thousand cycles more
                if len(cycles) > 32 and 0.0 < to_come() <= 1e-5:
                    raise _SmallTail

            known = True
            with suppress(_SmallTail):
                record = continue_history(problem, journal, stop_at_small_tail)
                known = record.steady.reached or (record.limit is not None and record.limit.reached)
            if not known and to_come() > 1e-3:
                raise SolveError("wear: no limit cycle was found in 60 cycles")
        last, corners = cycles[-1], [cycles[-2].corners[-1], *cycles[-1].corners]
        v, P = (np.array([getattr(each.state, key) for each in corners]) for key in "vP")
        row = row.copy()
        row["corner"] = most = 1 + int(np.argmax(P[1:].sum(axis=1)))
        path = np.abs(np.diff(v, axis=0)).sum(axis=0)
        # less is round-off of a cycle without slip
        least = 1e-12 * last.totals.force_scale * path.max(initial=0.0)
        E = np.where(last.dissipation > least, last.dissipation, 0.0)
        slips = E > 1e-9 * E.max(initial=0.0)
        away = np.array([each.state.state == State.SEPARATION for each in corners])
        row["energy"], row["path"], row["v"] = E, path, v[most]
        row["P"] = np.where(away[most], 0.0, np.maximum(P[most], 0.0))
        stays = np.where(away[1:].all(axis=0), State.SEPARATION, State.STICK)
        row["zone"] = np.where(slips, State.FORWARD_SLIP, stays)
        end = corners[-1].state
        row["u"], row["r"], row["state"] = end.u.reshape(2, -1), end.r.reshape(2, -1), end.state
        row["force"] = last.totals.force_scale
        return row, corners

    def record(self, row: Row) -> Record:
        """Return the record of the cycle of a row, with samples, events and probes."""
        system, history = self.whole.system, self.whole.history
        worn = replace(system, g0=system.g0 + row["depth"])
        once = replace(history, cycles=1, until_steady=False, until_limit=False)
        problem = replace(self.whole, system=worn, history=once, judged=False)
        journal, none = Journal(), np.zeros(system.n)
        corner = instant(worn, (0, 0, 1.0), history.loop[0], _state(row))
        totals = Totals(force_scale=float(row["force"]))
        journal.add(FinishedCycle([corner], none, none, totals))
        return continue_history(problem, journal)

    def increments(self, row: Row, cycles: float) -> Array:
        """Return depths by implicit Euler with the slips of the row's cycle.

        At the turning point with the largest pressure, the tangential displacements kept,
        w + g0 + depth + D P >= 0, P >= 0 with the added compliance D = cycles c E / (m P). The part
        of E that a cohesion or a shear limit dissipates does not change with P.
        """
        system, n = self.problem.system, self.problem.system.n
        E, P, law = row["energy"], row["P"], system.law
        slides, limit = law.largest * row["path"], law.largest_limit(P)
        # a node that opens in the cycle may have little pressure where that is largest in all
        steady = (E > 0.0) & (P > 0.0) & (E <= 4.0 * row["path"] * limit)
        grows = np.where(steady, E, 0.0)
        grows[law.largest * P + law.cohesion > law.shear_limit] = 0.0
        grows *= np.divide(law.largest * P, limit, out=np.zeros(n), where=limit > 0.0)
        new = (E == 0.0) & (P == 0.0)
        slip = np.where(new, slides, np.divide(grows, P, out=np.zeros(n), where=steady))
        added, fixed = cycles * self.rate * slip, cycles * self.rate * (E - grows)
        gap = system.g0 + row["depth"] + fixed
        K, held = system.K[n:, n:], system.held[n:]
        load = self.problem.history.loop[int(row["corner"])] @ system.r_star[:, n:]
        load = load + system.K[n:, :n] @ row["v"]
        return np.asarray(added * pressures(K, load, gap, added, P > 0.0, held) + fixed)


def _state(row: Row) -> ContactState:
    """Return the state at the end of the cycle of a row."""
    return ContactState(row["u"].ravel(), row["r"].ravel(), row["state"].copy())


def pressures(
    K: Array, load: Array, gap: Array, added: Array, closed: NDArray[np.bool_], held: Any
) -> Array:
    """Return P = load + K w >= 0 with w + gap + added P >= 0 and one of both zero at each node.

    By semismooth Newton's method (the primal-dual active set strategy) from a set of closed nodes.
    SolveError: the sets of closed nodes cycle.
    """
    unit = np.eye(len(gap))
    seen = set()
    while closed.tobytes() not in seen:
        seen.add(closed.tobytes())
        matrix = np.where((closed & ~held)[:, None], unit + added[:, None] * K, K)
        right = np.where(closed, -gap - added * load, -load)
        matrix[held], right[held] = unit[held], 0.0
        try:
            w = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            break
        P = load + K @ w
        g = gap + w + added * P
        after = np.where(closed, P > 0.0, g < 0.0) & ~held
        if np.array_equal(after, closed):
            return np.where(closed, np.maximum(P, 0.0), 0.0)
        closed = after
    raise SolveError("wear: the normal contact problem of an implicit step was not solved")


class Convected(NodePairs):
    r"""Wear under a given stroke s of the first body, in gross slip without coupling.

    With the depths $h_1$, $h_2$ of the bodies the gap of the node at x is
    $g_0(x) + h_1(x) + h_2(x + s)$, and each position s a normal contact problem with the same
    stiffness, as half-planes look the same everywhere. The rates

    $$\dot h_1 = \alpha c f \int p\, |ds| ,\qquad \dot h_2 = (1-\alpha) c f \int p(x - s)\, |ds|$$

    are integrated by linearly implicit Euler steps: $(1 - \Delta N\, J) \Delta h = \Delta N \dot h$
    with $J = \partial \dot h / \partial h$ from the closed nodes of all positions. The profile
    $g_0$ is that of the first body; the second one is flat.

    Attributes:
        positions: (load factors, s, sliding distance a cycle) along the stroke.
    """

    carried = True

    def __init__(self, pairs: NodePairs, share: float, half_width: float) -> None:
        """Place positions along the loop of load factors.

        ``share`` is the part of the wear that the first body takes, ``half_width`` the contact's.
        """
        self.whole, self.problem = pairs.whole, pairs.problem
        self.rate, self.share = pairs.rate, share
        self.system = system = pairs.problem.system
        self._known: tuple[bytes, Any] = (b"", None)
        loop, found = pairs.problem.history.loop, dict[tuple[bytes, int], list[Any]]()
        for k, (a, b) in enumerate(pairwise(pairs.slip_at_corners)):
            # ten positions along the stroke on half the width
            count = int(np.ceil(10.0 * abs(b - a) / half_width))
            for part in (np.arange(count) + 0.5) / max(count, 1):
                normal = (1.0 - part) * loop[k] + part * loop[k + 1]
                s = (1.0 - part) * a + part * b
                pressed = normal @ system.r_star[:, system.n :]
                pressed = np.round(pressed / (np.abs(pressed).max() or 1.0), 9)
                # there and back alike
                key = pressed.tobytes(), round(s / half_width * 1e9)
                found.setdefault(key, [normal, s, 0.0])[2] += abs(b - a) / count
        self.positions = [(normal, s, way) for normal, s, way in found.values()]

    def increments(self, row: Row, cycles: float) -> Array:
        """Return the depths (2N,) worn off each body by one linearly implicit step."""
        rate, jacobian, _ = self._linearised(row)
        matrix = np.eye(len(rate)) + cycles * jacobian
        return np.asarray(np.linalg.solve(matrix, cycles * rate))

    def settled(self, row: Row, worn: Array) -> Row:
        """Return the row with more worn off."""
        found = row.copy()
        found["worn"] += worn.reshape(2, -1)
        found["depth"] += worn.reshape(2, -1).sum(axis=0)
        _, _, values = self._linearised(found)
        P, ways = np.array([p for p, _ in values]), np.array([way for *_, way in self.positions])
        friction = self.system.friction.mean
        found["energy"], found["path"] = friction * (ways @ P), ways.sum()
        found["P"] = P[int(np.argmin([abs(s) for _, s, _ in self.positions]))]
        slips = found["energy"] > 1e-9 * found["energy"].max()
        found["zone"] = np.where(slips, State.FORWARD_SLIP, State.SEPARATION)
        return found

    def _linearised(self, row: Row) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Return rates (2N,), minus their derivatives, and pressures with theirs by position."""
        key = row["worn"].tobytes()
        if self._known[0] == key:
            return self._known[1]
        system, n = self.system, self.system.n
        K, shares = system.K[n:, n:], (self.share, 1.0 - self.share)
        rate, jacobian, values = np.zeros(2 * n), np.zeros((2 * n, 2 * n)), []
        closed, x, none = row["P"] > 0.0, system.x, np.zeros(n)
        for load, s, way in self.positions:
            # interpolation of values on the second body at the nodes moved by s
            carried = np.array([np.interp(x + s, x, unit) for unit in np.eye(n)]).T
            gap = system.g0 + row["worn"][0] + carried @ row["worn"][1]
            P = pressures(K, load @ system.r_star[:, n:], gap, none, closed, none > 0.0)
            closed = P > 0.0
            stiff = np.zeros((n, n))
            on, off = np.flatnonzero(closed), np.flatnonzero(~closed)
            to_open = np.linalg.solve(K[np.ix_(off, off)], K[np.ix_(off, on)])
            stiff[np.ix_(on, on)] = K[np.ix_(on, on)] - K[np.ix_(on, off)] @ to_open
            # what wears off, and by its transpose where the gap grows
            factor = way * system.friction.mean[:, None]
            grows = np.vstack(
                [shares[0] * np.diag(self.rate), shares[1] * self.rate[:, None] * carried.T]
            )
            opens = np.hstack([np.eye(n), carried])
            rate += grows @ (factor[:, 0] * P)
            jacobian += (grows * factor[:, 0]) @ (stiff @ opens)
            values.append((P, stiff))
        self._known = key, (rate, jacobian, values)
        return rate, jacobian, values


def advance(model: NodePairs, row: Row, tolerance: float, last: float) -> Row:
    """Return the row after the next step, whose length one step against two halves accepts.

    With the depths h_1 of one step and h_2 of two halves the step is accepted where
    max |h_2 - h_1| <= tolerance max h_2, which is its estimated error; the depth is 2 h_2 - h_1.
    ``row["step"]`` is the length to try, up to ``last`` cycles in all. SolveError: steps of one
    cycle do not meet the tolerance, or have no solution.
    """
    step = min(float(row["step"]), last - float(row["cycles"]))
    while True:
        try:
            whole, half = model.increments(row, step), model.increments(row, 0.5 * step)
            middle = model.settled(row, half)
            halves = half + model.increments(middle, 0.5 * step)
            error = np.abs(halves - whole)
            # as much as the mean step so far has worn off, where this one wears off less
            share = step / (step + float(row["cycles"]))
            size = max(float(halves.max()), share * float(row["depth"].max()))
            ratio = float(error.max()) / (tolerance * size or np.inf)
            if ratio <= 1.0:
                worn = np.maximum(2.0 * halves - whole, 0.0)
                found = model.settled(middle, worn - half)
                break
            failure: SolveError | None = None
        except (SolveError, np.linalg.LinAlgError) as failed:
            singular = SolveError(f"wear: an implicit step has no solution ({failed})")
            failure, ratio = failed if isinstance(failed, SolveError) else singular, 4.0
        if step <= 1.0:
            raise failure or SolveError(
                f"[wear] tolerance: after {row['cycles']:g} cycles a step of one cycle has an "
                f"error of {ratio * tolerance:.2g} of its depth; raise the tolerance, the wear of "
                "single cycles changes the contact"
            )
        step = max(1.0, step * max(0.1, 0.8 / ratio))
    found["cycles"] = min(float(row["cycles"]) + step, last)
    # of both bodies, opposite each other at no slip
    depth, uncertain = (a.reshape(-1, len(model.rate)).sum(axis=0) for a in (worn, error))
    found["step"] = step * min(5.0, 0.8 / max(ratio, 1e-3))
    energy = np.divide(depth, model.rate, out=np.zeros(len(depth)), where=model.rate > 0.0)
    found["dissipated"] += energy.sum()
    found["estimate"] += uncertain
    return found
