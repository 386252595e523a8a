"""An exact path written plainly: one dense system of equations for each set of states.

It shares with the package the contact law's margins, and nothing of its tableau, memory and loop.
"""

from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.system import Changes, ContactState, Leg, reactions

ON_LIMIT, TURNS = 1e-12, 1e-10
"""Distance from a limit over the force scale, and rate over the largest one, that are none."""


class PlainPath(EventPath):
    """Follows legs on which forces act without the package's loop."""

    def _walk(self, problem: LegProblem) -> Leg:
        system, (a, b), scale = self.system, problem.ends, problem.force_scale
        n, friction, k = system.n, system.friction, system.diagonal
        frictional, smooth = self.segments.frictional, self.segments.smooth
        state, u = problem.start.state.copy(), problem.start.u.copy()
        s, slip, places = 0.0, 0.0, list(problem.samples)
        D, work, events, samples = np.zeros(n), 0.0, list[tuple[float, int, int, int]](), []

        def rates(state: Any) -> tuple[Array, Array]:
            """Return the rates of displacements and reactions."""
            M, dr = np.eye(2 * n), (b - a) @ system.r_star
            wanted = np.zeros(2 * n)
            for i in range(n):
                slips = frictional[i] and state[i] != STICK
                if slips or (not frictional[i] and not system.held[i]):
                    c = friction.at_slip(state)[i] if frictional[i] else 0.0
                    M[i] = system.K[i] + c * system.K[n + i]
                    wanted[i] = -dr[i] - c * dr[n + i]
                if state[i] == SEPARATION and not system.held[n + i]:
                    M[n + i], wanted[n + i] = system.K[n + i], -dr[n + i]
            du = np.linalg.solve(M, wanted)
            return du, dr + system.K @ du

        def margins(u: Array, r: Array, gap: Array) -> Array:
            """Return [v, gap, A, B] as forces."""
            A, B = friction.margins(r[:n], r[n:])
            A, B = np.where(smooth, r[n:], A), np.where(frictional, B, np.inf)
            none = ~(frictional | smooth)
            A[none] = B[none] = gap[none] = np.inf
            return np.concatenate([k[:n] * u[:n], k[n:] * (gap + u[n:]), A, B]).reshape(4, n)

        def kinds(state: Any, dy: Array, on: Any) -> list[set[int]]:
            """Return the kinds of quantities that are violated at each node."""
            least, found = TURNS * np.abs(dy[np.isfinite(dy)]).max(), [set[int]() for _ in state]
            for i in range(n):
                sign = {FORWARD: 1.0, BACKWARD: -1.0}.get(state[i], 0.0)
                if sign * dy[0, i] < -least:
                    found[i].add(0)
                bounded = [1] if state[i] == SEPARATION else [2, 3]
                found[i] |= {q for q in bounded if on[q, i] and dy[q, i] < -least}
            return found

        def after(i: int, old: int, which: set[int], slip: float) -> int:
            if not frictional[i]:
                return SEPARATION if old == STICK else STICK
            if old == SEPARATION:
                return STICK if slip == 0.0 else FORWARD if slip > 0.0 else BACKWARD
            if old in (FORWARD, BACKWARD):
                return STICK if 0 in which else SEPARATION
            return {2: FORWARD, 3: BACKWARD}[min(which)] if len(which) == 1 else SEPARATION

        hit: tuple[int, int] | None = None
        while True:
            before, load = state.copy(), (1.0 - s) * a + s * b
            y = margins(u, reactions(system, load, u), system.g0.copy())
            on = y <= ON_LIMIT * scale
            if hit is not None:
                q, i = hit
                on[q, i] = True
                state[i] = after(i, int(state[i]), {q}, slip)
            for round_ in range(n + 4):
                du, dr = rates(state)
                dy = margins(du, dr, np.zeros(n))
                found = kinds(state, dy, on)
                wrong = [i for i in range(n) if found[i]]
                if not wrong:
                    break
                if round_ > 2:
                    wrong = [max(wrong, key=lambda i: max(abs(dy[q, i]) for q in found[i]))]
                for i in wrong:
                    state[i] = after(i, int(state[i]), found[i], 0.0)
            else:
                raise AssertionError("this plain path knows no continuation here")
            turned = np.flatnonzero(before != state)
            events += [(s, int(i), int(before[i]), int(state[i])) for i in turned]
            # what the states fix is on its limit all along
            fixed = np.zeros((4, n), dtype=bool)
            fixed[0] = True
            fixed[1], fixed[2:] = state != SEPARATION, state == SEPARATION
            fixed[2] |= state == FORWARD
            fixed[3] |= state == BACKWARD
            falls = ~fixed & (dy < -TURNS * np.abs(dy[np.isfinite(dy)]).max())
            time = np.where(falls, np.maximum(y, 0.0) / np.where(falls, -dy, 1.0), np.inf)
            q, i = divmod(int(time.argmin()), n)
            ds = min(float(time[q, i]), 1.0 - s)
            while places and places[0] <= s + ds:
                at = places.pop(0)
                here = u + (at - s) * du
                r = reactions(system, (1.0 - at) * a + at * b, here)
                samples.append((at, ContactState(here, r, state.copy())))
            new, middle = u + ds * du, (1.0 - s - 0.5 * ds) * a + (s + 0.5 * ds) * b
            Q = reactions(system, middle, 0.5 * (u + new))[:n]
            D -= np.where(frictional, Q, 0.0) * (new - u)[:n]
            work += float(middle @ system.r_star @ (new - u))
            u, s = new, s + ds
            if s >= 1.0 - 1e-13:
                break
            hit, slip = (q, i), float(du[i])
        end = ContactState(u, reactions(system, b, u), state)
        return Leg(
            end=end,
            dissipation=D,
            work=work,
            force_scale=max(scale, float(np.abs(end.r).max())),
            samples=samples,
            events=Changes.of(events),
        )
