"""Shakedown limits against closed forms, plain programs over all pairs, and exact cycles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from shakedown_cases import LOWER, TO_AND_FRO, UPPER, Case, Loads, coupled_case, two_nodes
from small import small_system

import receding_fenicsx as rf

pytestmark = pytest.mark.once(False)  # by solvers of SciPy


def random_case(seed: int) -> Case:
    """Return a coupled system of 2 to 8 nodes, its mean loads and a range of 2 to 4 corners."""
    rng = np.random.default_rng([seed, 17])
    n, corners = int(rng.integers(2, 9)), int(rng.integers(2, 5))
    mean, change = ((-0.3, 0.3), (0.7, 1.3)), ((-1.0, 1.0), (-0.4, 0.4))
    return coupled_case(rng, n, corners, mean, change, (0.2, 0.6))


def all_pairs(system: rf.ContactSystem, mean: Loads, corners: list[Loads]) -> tuple[float, float]:
    """Return both limits by the 1 + N V^2 programs of their definition, unscaled."""
    n, f = system.n, system.friction
    rows: dict[tuple[str, int, int], np.ndarray] = {}
    K_t, K_n = system.K[:n, :n], system.K[n:, :n]

    def held(loads: Loads) -> np.ndarray:
        return np.array([loads.get(name, 0.0) for name in system.load_names]) @ system.r_star

    m = held(mean)
    for k, corner in enumerate(corners):
        q = held(corner)
        for i in range(n):
            for name, sign, c in (("A", 1.0, f.forward[i]), ("B", -1.0, f.backward[i])):
                slope = sign * K_t[i] + c * K_n[i]
                constant, change = (sign * r[i] + c * r[n + i] for r in (m, q))
                rows[name, i, k] = np.array([*slope, change, constant])
    table = np.array(list(rows.values()))
    bounds = [(None, None)] * n + [(0.0, None)]
    cost = np.append(np.zeros(n), 1.0)
    upper = scipy.optimize.linprog(-cost, -table[:, :-1], table[:, -1], bounds=bounds).x[-1]
    lower = upper
    for i in range(n):
        for k in range(len(corners)):
            for j in range(len(corners)):
                pair = np.array([rows["A", i, k], rows["B", i, j]])
                found = scipy.optimize.linprog(
                    cost, -table[:, :-1], table[:, -1], pair[:, :-1], -pair[:, -1], bounds=bounds
                )
                lower = min(lower, found.x[-1]) if found.status == 0 else lower
    return float(lower), float(upper)


def played(case: Case, factor: float, start: np.ndarray) -> rf.Record:
    """Return exact cycles round a range from an initial slip."""
    history = rf.range_history(*case, factor, 300)
    return rf.evolve(case[0], history, output=rf.OutputOptions(1, ()), initial_slip=start)


def test_limits_of_two_nodes_are_the_exact_fractions() -> None:
    limits = rf.shakedown_limits(two_nodes(), {"mean": 1.0}, TO_AND_FRO)
    assert limits.lower == pytest.approx(LOWER, abs=1e-12)
    assert limits.upper == pytest.approx(UPPER, abs=1e-12)
    assert limits.lower_is == "proved"
    assert not limits.opens
    assert limits.residual < 1e-14


@pytest.mark.parametrize(("rubbing", "n", "words"), [(2, 2, "proved"), (2, 3, "c"), (3, 3, "c")])
def test_the_lower_limit_is_proved_for_two_nodes_and_no_others(
    rubbing: int, n: int, words: str
) -> None:
    system, mean, corners = coupled_case(
        np.random.default_rng(4),
        n,
        2,
        ((-0.1, 0.1), (0.9, 1.1)),
        ((-1, 1), (-0.1, 0.1)),
        (0.3, 0.5),
    )
    system = replace(system, f=np.where(np.arange(n) < rubbing, system.f, 0.0))
    assert rf.shakedown_limits(system, mean, corners).lower_is.startswith(words)
    # slip that changes the pressure of a node without friction is coupled too
    loads = {"mean": [0.0, 0, 1, 1], "range": [1.0, 0, 0, 0]}
    for c, known in ((0.0, "proved"), (0.3, "conjecture")):
        pair = small_system(np.eye(4) + c * (np.eye(4, k=3) + np.eye(4, k=-3)), loads, [0.4, 0.0])
        assert rf.shakedown_limits(pair, {"mean": 1.0}, TO_AND_FRO).lower_is == known


@pytest.mark.parametrize("seed", range(8))
def test_limits_are_those_of_all_pairs_of_corners(seed: int) -> None:
    system, mean, corners = random_case(seed)
    rng = np.random.default_rng(seed)
    n, gap = system.n, rng.uniform(0.0, 0.2, system.n)
    directed = replace(system, f_backward=system.f * rng.uniform(0.6, 1.4, n))
    # gaps that the mean loads close
    shut = system.r_star + np.outer(np.eye(3)[0], system.K[:, n:] @ gap)
    for case, same in (
        (system,) * 2,
        (directed,) * 2,
        (replace(system, g0=gap, r_star=shut), system),
    ):
        limits = rf.shakedown_limits(case, mean, corners)
        expected = all_pairs(same, mean, corners)
        assert (limits.lower, limits.upper) == pytest.approx(expected, rel=1e-6)
        for key in ("lower", "upper"):
            x = [each.x for each in limits.active if each.limit == key]
            assert x == [system.x[each.node] for each in limits.active if each.limit == key]
            told = limits.binding(key)
            assert told.endswith(f" from x = {min(x):.6g} to {max(x):.6g}") and told in repr(limits)
        for active in [each for each in limits.active if each.limit == "upper"]:
            # what binds vanishes at its corner
            change = [corners[active.vertex].get(name, 0.0) for name in same.load_names]
            load = np.eye(3)[0] + limits.upper * np.array(change)
            Q, P = np.split(load @ same.r_star + same.K[:, :n] @ limits.safe_slip_modelled, 2)
            limit = same.friction.limits(P)[int(active.kind == "backward slip")]
            assert (limit - Q)[active.node] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 7])
def test_exact_cycles_agree_with_the_limits(seed: int) -> None:
    case = random_case(seed)
    limits = rf.shakedown_limits(*case)
    safe = limits.safe_slip_modelled
    record = played(case, 0.999 * limits.upper, safe)
    assert np.all(record.cycles.dissipation == 0.0)
    assert record.dissipation_first_loading == 0.0
    random = np.random.default_rng(seed).uniform(-3.0, 3.0, case[0].n)
    for start in (safe, np.zeros(case[0].n), random):
        assert played(case, 1.005 * limits.upper, start).steady.kind == "cyclic slip"
        assert played(case, 0.995 * limits.lower, start).steady.kind == "shakedown"


@pytest.mark.parametrize("factor", [2.0**30, 2.0**-30, 1e9, 1e-9])
def test_limits_do_not_depend_on_units(factor: float) -> None:
    system, mean, corners = random_case(1)
    expected = rf.shakedown_limits(system, mean, corners)
    known = pytest.approx((expected.lower, expected.upper), rel=1e-9)
    for name in ("K", "r_star"):
        larger = replace(system, **{name: factor * getattr(system, name)})
        found = rf.shakedown_limits(larger, mean, corners)
        assert (found.lower, found.upper) == known, name
    scaled = [{name: factor * value for name, value in corner.items()} for corner in corners]
    found = rf.shakedown_limits(system, mean, scaled)
    assert found.upper * factor == pytest.approx(expected.upper, rel=1e-9)


def without_friction_or_held(seed: int) -> Case:
    """Return a random case with one node without friction, one held, one held normally too."""
    system, mean, corners = random_case(seed)
    f, held = system.f.copy(), system.held.copy()
    f[0] = 0.0
    held[1] = True
    held[-1], f[-1] = True, 0.0
    r_star = np.where(held, 0.0, system.r_star)
    return replace(system, f=f, held=held, r_star=r_star), mean, corners


@pytest.mark.parametrize("seed", [s for s in range(30) if random_case(s)[0].n >= 5][:6])
def test_nodes_held_or_without_friction_keep_the_limits_right(seed: int) -> None:
    case = without_friction_or_held(seed)
    limits = rf.shakedown_limits(*case)
    safe = limits.safe_slip_modelled
    assert safe[0] == safe[1] == safe[-1] == 0.0
    # a coefficient where the gap is held says nothing
    n, f = case[0].n, case[0].f
    rough = replace(case[0], f=np.where(case[0].held[n:], 0.5, f))
    assert rf.shakedown_limits(rough, *case[1:]).upper == pytest.approx(limits.upper, rel=1e-12)
    assert np.all(played(case, 0.999 * limits.upper, safe).cycles.dissipation == 0.0)
    if not limits.opens:
        assert played(case, 1.005 * limits.upper, safe).steady.kind == "cyclic slip"


def test_nodes_separated_throughout_are_as_good_as_not_there() -> None:
    system, mean, corners = random_case(9)
    n, K, r = system.n, system.K, system.r_star
    away = replace(system, g0=50.0 * (np.arange(n) == 0))
    limits = rf.shakedown_limits(away, mean, corners, separated="stay")
    assert limits.separated.tolist() == [True] + [False] * (n - 1)
    gone, kept = np.array([0, n]), np.setdiff1d(np.arange(2 * n), [0, n])
    C = np.linalg.solve(K[np.ix_(gone, gone)], K[np.ix_(gone, kept)])
    loads = dict(zip(system.load_names, r[:, kept] - r[:, gone] @ C, strict=True))
    bare = small_system(K[np.ix_(kept, kept)] - K[np.ix_(kept, gone)] @ C, loads, system.f[1:])
    expected = rf.shakedown_limits(bare, mean, corners)
    assert (limits.lower, limits.upper) == pytest.approx((expected.lower, expected.upper), rel=1e-8)


def test_bounded_slips_raise_a_lower_limit_of_zero() -> None:
    # much friction: some slip unloads a node without any range
    system = replace(two_nodes(), f=np.full(2, 3.0))
    mean, corners = {"mean": 1.0}, TO_AND_FRO
    assert rf.shakedown_limits(system, mean, corners).lower == pytest.approx(0.0)
    lower = [
        rf.shakedown_limits(system, mean, corners, largest_slip=bound).lower
        for bound in (1.0, 0.5, 0.3)
    ]
    assert 0.0 < lower[0] < lower[1] < lower[2]


@pytest.mark.parametrize("f", [0.0, 0.5])
def test_a_node_that_loses_its_pressure_opens(f: float) -> None:
    K, lifts = np.diag([2.0, 2.0, 3.0, 3.0]), [0.1, 0.0, 0.0, 1.0]
    system = small_system(K, {"mean": [0, 0, 1, 1], "range": lifts}, [0.5, f])
    limits = rf.shakedown_limits(system, {"mean": 1.0}, TO_AND_FRO)
    assert limits.upper == pytest.approx(1.0) and limits.opens


def test_a_node_pulled_off_by_the_mean_loads_may_stay_so() -> None:
    loads = {"mean": [0, 0, 1, -1], "range": [1, 1, 0, 0]}
    system = small_system(np.diag([2.0, 2.0, 3.0, 3.0]), loads, 0.5)
    limits = rf.shakedown_limits(system, {"mean": 1.0}, TO_AND_FRO, separated="stay")
    assert (limits.lower, limits.upper) == pytest.approx((0.5, 0.5)) and not limits.opens
