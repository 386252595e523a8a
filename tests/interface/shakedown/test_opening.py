"""Load ranges round which nodes open and close without slip: all sets tried, and exact cycles."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from shakedown_cases import Case, coupled_case

import receding_fenicsx as rf
from receding_fenicsx.interface.shakedown.margins import load_range
from receding_fenicsx.interface.shakedown.opening import largest_opening
from receding_fenicsx.studies.shakedown.exact_cycles import limit_by_cycles, shakes_down


def rocked(seed: int, n: int, corners: int = 2) -> Case:
    """Return a coupled system that is pressed, and pressed and pulled in turn by the range."""
    mean, change = ((-0.1, 0.1), (0.5, 1.3)), ((-0.2, 0.2), (-1.0, 1.0))
    rng = np.random.default_rng([seed, 71])
    return coupled_case(rng, n, corners, mean, change, (0.4, 0.9))


def all_sets(case: Case, intervals: int, top: float) -> float:
    """Return the largest range of two corners by a linear program for each sequence of sets.

    Unscaled unknowns lambda, and u and the place of each point; no binaries, no bounds of numbers.
    """
    system, loads = case[0], load_range(*case)
    n, K, f = system.n, system.K, system.f
    mean, ends = loads.mean @ system.r_star, loads.vertices @ system.r_star
    width, points = 2 * n + 1, intervals + 1
    size = 1 + points * width

    def at(p: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows of u, r and tau of a point."""
        unit = np.eye(size)
        own = unit[1 + p * width : 1 + (p + 1) * width]
        return (
            own[:-1],
            K @ own[:-1] + np.outer(ends[0], unit[0]) + np.outer(ends[1] - ends[0], own[-1]),
            own[-1],
        )

    laws, constants, equal = [], [], []
    rows = [at(p) for p in range(points)]
    for u, r, _ in rows:
        for i in range(n):
            for sign in (1.0, -1.0):
                laws.append(sign * r[i] + f[i] * r[n + i])
                constants.append(sign * mean[i] + f[i] * mean[n + i])
            laws.append(u[n + i])
            constants.append(0.0)
    for (*_, a), (*_, b) in itertools.pairwise(rows):
        laws.append(b - a)
        constants.append(0.0)
    unit = np.eye(size)
    equal = [(rows[0][2], 0.0), (rows[-1][2] - unit[0], 0.0)]
    best = -np.inf
    for sets in itertools.product(itertools.product((0, 1), repeat=n), repeat=intervals):
        own = list(equal)
        for k, closed in enumerate(sets):
            (u, r, _), (u2, r2, _) = rows[k : k + 2]
            for i in range(n):
                if closed[i]:
                    own += [(u[n + i], 0.0), (u2[n + i], 0.0), (u2[i] - u[i], 0.0)]
                else:
                    own += [(r[j], -mean[j]) for j in (i, n + i)]
                    own += [(r2[j], -mean[j]) for j in (i, n + i)]
        found = scipy.optimize.linprog(
            -unit[0],
            -np.array(laws),
            np.array(constants),
            np.array([row for row, _ in own]),
            np.array([value for _, value in own]),
            bounds=[(0.0, top)] + [(None, None)] * (size - 1),
        )
        if found.status == 0:
            best = max(best, -found.fun)
    return float(best)


@pytest.mark.parametrize("seed", [10, 13, 26, 27])
def test_program_finds_the_best_of_all_sets_of_two_nodes(seed: int) -> None:
    case = rocked(seed, 2)
    limits = rf.shakedown_limits(*case)
    assert limits.opens
    top = 4.0 * limits.upper
    found = largest_opening(case[0], load_range(*case), np.ones(2, dtype=bool), top)
    assert found.best
    assert found.residual < 1e-10
    assert 1.05 * limits.upper < found.value < top
    assert found.value == pytest.approx(all_sets(case, 3, top), rel=1e-6)


@pytest.mark.parametrize(("seed", "n"), [(14, 3), (28, 3), (6, 4)])
def test_exact_cycles_end_without_slip_up_to_the_range_found_and_not_above(
    seed: int, n: int
) -> None:
    case = rocked(seed, n)
    limits = rf.shakedown_limits(*case)
    found = rf.opening_limit(*case, limits)
    assert found.dissipation <= 1e-12
    assert not found.closed.all()
    low, high = limit_by_cycles(*case, limits.upper, limits.safe_slip_modelled)
    assert low * (1.0 - 1e-9) <= found.value <= high
    assert found.value < found.top
    assert not shakes_down(case[0], rf.range_history(*case, 1.001 * found.value), found.slip)


@pytest.mark.parametrize("seed", [0, 13])
def test_loop_of_three_corners_ends_where_the_closed_contact_does(seed: int) -> None:
    # a node with friction would have to lose both reactions at once at two places of the loop; at
    # seed 13 cycles dissipate 1e-6 of the first one, and go on slipping
    case = rocked(seed, 2 + seed % 2, corners=3)
    limits = rf.shakedown_limits(*case)
    assert limits.opens
    found = rf.opening_limit(*case, limits)
    assert found.value == pytest.approx(limits.upper, rel=1e-6)
    low, high = limit_by_cycles(*case, limits.upper, limits.safe_slip_modelled)
    assert low * (1.0 - 1e-9) <= found.value <= high


@pytest.mark.parametrize("seed", range(3))
def test_closed_contacts_have_the_limit_of_the_linear_program(seed: int) -> None:
    case = rocked(seed, 5, corners=2 + seed % 3)
    limits = rf.shakedown_limits(*case)
    found = largest_opening(case[0], load_range(*case), np.zeros(5, dtype=bool), 4.0 * limits.upper)
    assert found.value == pytest.approx(limits.upper, rel=1e-6)
    assert found.closed.all()


def test_what_has_no_range_with_opening_nodes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    case = rocked(20, 3)
    limits = rf.shakedown_limits(*case)
    gaps = replace(case[0], g0=np.array([0.0, 0.1, 0.0]))
    with pytest.raises(rf.InputError, match="no initial gaps"):
        rf.opening_limit(gaps, *case[1:], limits)
    with pytest.raises(rf.InputError, match="positive, finite upper limit"):
        rf.opening_limit(*case, replace(limits, upper=np.inf))
    monkeypatch.setattr("receding_fenicsx.studies.shakedown.exact_cycles.MOST_NODES", 1)
    monkeypatch.setattr("receding_fenicsx.studies.shakedown.exact_cycles.ALL_NODES", 1)
    with pytest.raises(rf.InputError, match=r"[23] nodes open, 1 at most are tried"):
        rf.opening_limit(*case, limits)
