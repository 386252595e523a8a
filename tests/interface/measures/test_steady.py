from dataclasses import replace

import numpy as np
import pytest
from small import small_system, table

import receding_fenicsx as rf
from receding_fenicsx.interface.law import Friction
from receding_fenicsx.interface.measures.steady import (
    CycleEnd,
    SteadyWatch,
    fit_power_law,
    limit_of_decay,
)


def test_a_power_law_is_fitted_to_three_non_zero_values_at_least() -> None:
    N = np.arange(2.0, 60.0)
    for exponent in (-3.1, -1.0, 0.5):
        for y in (-7.0 * N**exponent, np.where(N % 2 == 0, 0.0, N**exponent)):
            fit = fit_power_law(N, y)
            assert fit.exponent == pytest.approx(exponent, abs=1e-12) and fit.uncertainty < 1e-12
    # residuals -.1, .2, -.1 of log y over log N = -1, 0, 1
    fit = fit_power_law(np.exp([-1.0, 0.0, 1.0]), np.exp([0.0, 0.3, 0.0]))
    assert fit.uncertainty == pytest.approx(0.1 * np.sqrt(3.0), rel=1e-9)
    with pytest.raises(ValueError, match="at least three non-zero values"):
        fit_power_law(N, np.where(N < 4, 1.0, 0.0))


@pytest.mark.parametrize(
    ("values", "name", "number", "limit"),
    [
        *((4.0 + 3.0 * q ** np.arange(30), "rate", q, 4.0) for q in (0.5, 0.9)),
        # sum of N^-2 to pi^2/6, of N^-3 to zeta(3)
        (np.cumsum(np.arange(1.0, 400.0) ** -2), "power", -2.0, np.pi**2 / 6),
        (np.cumsum(np.arange(1.0, 400.0) ** -3), "power", -3.0, 1.2020569031595942),
        (np.cumsum(np.arange(1.0, 100.0) ** -0.5), "power", -0.5, np.nan),
        (1.1 ** np.arange(40.0), "rate", 1.1, np.nan),
        (np.full(20, 2.5), "rate", 0.0, 2.5),
    ],
)
def test_a_decay_is_summed_to_its_limit(
    values: np.ndarray, name: str, number: float, limit: float
) -> None:
    found = limit_of_decay(values)
    exact = name == "rate"
    assert found[:2] == (name, pytest.approx(number, rel=1e-6))
    # far closer than the last term of the sequence itself
    off = max(1e-6 if exact else 0.0, 0.02 * abs(values[-1] - limit))
    assert found[2] == pytest.approx(limit, abs=off, rel=0.0, nan_ok=True)


R = np.array([3.0, -1.0, 2.0, 5.0])
V = np.array([0.4, -0.2])


def watch(
    ends: list[tuple[np.ndarray, np.ndarray]], D: np.ndarray | float, residual: float = 0.0
) -> SteadyWatch:
    """Return a watch that has seen ends of cycles; under P = 1 and f = 1 a node slips by D.

    The terms of its force K u are 2 times 2.5.
    """
    watching = SteadyWatch(1e-8, K=2.0 * np.eye(2, 4), friction=Friction(*np.ones((2, 2))))
    for (r, v), d in zip(ends, np.broadcast_to(np.asarray(D), len(ends)), strict=True):
        watching.add(CycleEnd(r, v, np.array([d, 0.0]), np.ones(2), np.full(4, 2.5), 5.0, residual))
    return watching


NUMBERS = np.arange(140)
QUIET = [(R, V)] * 45
TURNS = [(R * (1.0 + 0.1 * (n % 2)), V) for n in range(12)]


@pytest.mark.parametrize(
    ("ends", "D", "expected"),
    [
        # A_n = 9 10^-n /(1 + 10^-n): below 1e-8 at n = 9 and 10
        ([(R * (1 + 10.0**-n), V) for n in range(12)], 0.1, (10, 1, "cyclic slip")),
        # no slip but round-off, 1e-11 of 2.5
        *((QUIET[:4], D, (2, 1, "shakedown")) for D in (0.0, 2e-11)),
        (QUIET[:4], 3e-11, (2, 1, "cyclic slip")),
        # gained every cycle, more than a millionth of the slip
        ([(R, V + 0.9e-7 * n) for n in range(5)], 0.1, (2, 1, "cyclic slip")),
        ([(R, V + 1.1e-7 * n) for n in range(5)], 0.1, (2, 1, "ratchetting")),
        # the same without dissipation, and a gain of 0.5^n, below 2.5e-11 from n = 36
        ([(R, V + 0.1 * n) for n in range(5)], 0.0, (2, 1, "ratchetting")),
        ([(R, V - 0.5**n) for n in range(45)], 0.0, (37, 1, "shakedown")),
        # dissipation 0.5^n is below 2.5e-11 from n = 36, for two cycles
        (QUIET, 0.5 ** NUMBERS[:45], (37, 1, "shakedown")),
        (QUIET[:37], 0.5 ** NUMBERS[:37], None),
        # cycle n gains 0.1 * 0.9^(n-1): below 1e-6 of the slip 0.1 from n = 133
        ([(R, V - 0.9**n) for n in NUMBERS], 0.1, (134, 1, "cyclic slip")),
        ([(R, V - 0.9**n) for n in NUMBERS[:134]], 0.1, None),
        # two cycles in turn: change over two is known from cycle 2 on, two periods are four cycles
        ([(R + n % 2, V + 0.01 * (n % 2)) for n in range(8)], 0.1, (5, 2, "cyclic slip")),
        ([(R + n % 2, V + 0.03 * n) for n in range(8)], 0.1, (5, 2, "ratchetting")),
        (TURNS, np.where(NUMBERS[:12] % 2, 0.5, 0.1), (5, 2, "cyclic slip")),
        (TURNS, np.where(NUMBERS[:12] % 2, 0.5, 0.1 * 0.9 ** NUMBERS[:12]), None),
        # one quiet cycle is not two
        ([(R * (1 + 1e-6 * n), V) for n in range(30)], 0.1, None),
        ([(R * (1 + 1e-6 * (n // 2)), V) for n in range(30)], 0.1, None),
        # cycles that end without force are measured by the force within
        ([(1e-13 * R * (-1) ** n, V) for n in range(5)], 0.3, (2, 1, "cyclic slip")),
        ([(0.0 * R, V)] * 3, 1e-15, (2, 1, "shakedown")),
    ],
)
def test_a_cycle_is_steady_once_it_has_been_repeated(
    ends: list[tuple[np.ndarray, np.ndarray]],
    D: np.ndarray | float,
    expected: tuple[int, int, str] | None,
) -> None:
    found = watch(ends, D)
    if expected is None:
        assert (found.cycle, found.kind) == (-1, "not reached")
    else:
        assert (found.period, found.kind) == expected[1:]
        assert found.cycle == expected[0]


def test_what_the_residual_may_move_under_forces_of_5_is_no_slip() -> None:
    for residual, kind in ((1e-11, "cyclic slip"), (1.3e-11, "shakedown")):
        assert watch(QUIET[:4], 3e-11, residual).kind == kind


def beside(contraction: float, pull: float, stiffness: float, moved: float) -> rf.ContactSystem:
    """Return four nodes: two that shake down, one without friction, and one pulled to and fro.

    The first two slip forward once a cycle, by ``contraction``^2 of the cycle before, until
    v_0 - c v_1 = v_1 - c v_0 = 0.001. The third moves by ``moved``. The last one has the stiffness
    k, f = 0.5 and P = 1: it slips for ever if ``pull`` > 0.5, and D = 4 f (pull - f) / k.
    """
    K = np.diag([1.0, 1.0, 1.0, stiffness] * 2)
    K[0, 1] = K[1, 0] = -contraction
    R = np.zeros((2, 8))
    R[:, 4:] = 1.0
    R[0, [0, 2, 3]] = -0.501, moved, -pull
    R[1, [1, 3]] = -0.501, pull
    return small_system(K, {"up": R[0], "down": R[1]}, [0.5, 0.5, 0.0, 0.5])


@pytest.mark.parametrize("until", ["steady", "limit"])
@pytest.mark.parametrize("seed", range(4))
def test_slips_are_judged_by_themselves(seed: int, until: str) -> None:
    # the loads cross over, so that P = 1 all the time
    rng = np.random.default_rng(seed)
    c, moved = rng.uniform(0.02, 0.97), 10.0 ** rng.uniform(-3.0, 4.0)
    stiffness, more = 10.0 ** rng.uniform(-4.0, 4.0), 10.0 ** rng.uniform(-6.0, -1.0)
    for pull, kind in ((0.4, "shakedown"), (0.5 + more, "cyclic slip")):
        system = beside(c, pull, stiffness, moved)
        D = 2.0 * max(pull - 0.5, 0.0) / stiffness
        seen = []
        # units of stiffness and force
        for K, F in ((1.0, 1.0), (2.0**30, 2.0**-30), (1e-9, 1e9)):
            other = replace(system, K=K * system.K, r_star=F * system.r_star)
            history = table(other, [[0, 0], [1, 0]], [[1, 0], [0, 1], [1, 0]], 600)
            record = rf.evolve(other, history, until=until)
            steady, last = record.steady, record.cycles.dissipation[record.steady.cycle - 1]
            assert steady.kind == kind
            assert last * K / F**2 == pytest.approx(D, rel=1e-5, abs=1e-11)
            seen.append(steady.cycle)
        assert seen[0] == seen[1] and abs(seen[2] - seen[0]) <= 1


@pytest.mark.parametrize("backward", [0.0, 1e-12, 0.1])
@pytest.mark.parametrize("until", [None, "limit"])
def test_a_body_walks_without_dissipation_where_a_direction_has_no_friction(
    backward: float, until: str | None
) -> None:
    # two feet pushed apart and pulled together: the one that moves backward slips
    body = small_system(
        np.kron(np.diag([1.0, 0.0]), [[2.0, -2.0], [-2.0, 2.0]]) + np.diag([0.0, 0.0, 1.0, 1.0]),
        {"weight": [0.0, 0.0, 1.0, 1.0], "spread": [1.0, -1.0, 0.0, 0.0]},
        0.5,
        rigid=[[1.0, 1.0, 0.0, 0.0]],
    )
    body = replace(body, f_backward=np.full(2, backward))
    history = table(body, [[0, 0], [1, 0], [1, 1]], [[1, 1], [1, -1], [1, 1]], 8)
    record = rf.evolve(body, history, until=until)
    assert record.steady.kind == "ratchetting"
    assert record.cycles.slip_increment[-1] == pytest.approx([backward - 1.0] * 2, rel=1e-12)
