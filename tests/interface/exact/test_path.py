from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from models import block_system
from small import cyclic, random_system, small_system, table

from receding_fenicsx.errors import NoQuasiStaticContinuation, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.system import eliminate_tangential
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

ALL = OutputOptions(samples_per_leg=12, cycles="all")


def near(value: object) -> Any:
    return pytest.approx(value, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("locked", [-0.3, 0.0, 0.25])
def test_the_limit_cycle_of_a_coupled_pair_remembers_the_initial_slip(locked: float) -> None:
    # Node 1 always sticks where it was laid down, v1 = locked; K_tn couples that to the pressure of
    # node 0: P0 = 1 + c locked. Node 0 runs round the loop of a spring under that pressure.
    F, k, c, top = 0.4, 2.0, 0.5, 1.5
    K = np.diag([k, 0.5, 4.0, 4.0])
    K[1, 2] = K[2, 1] = c
    two = small_system(K, {"press": [0, 0, 1, 1], "push": [-1, 0, 0, 0]}, F)
    history = table(two, [[0, 0], [1, 0], [1, top]], [[1, top], [1, -top], [1, top]], 5)
    record = evolve(two, history, output=ALL, initial_slip=np.array([0.0, locked]))
    P0 = 1.0 + c * locked
    assert record.turning_points.v[:, 1] == near([locked] * 12)
    assert record.turning_points.P[0, 0] == near(P0)
    assert record.cycles.dissipation == near([4 * F * P0 * (top - F * P0) / k] * 5)


def test_a_thousand_cycles_keep_residual_and_energy() -> None:
    record = evolve(block_system(80, 40), cyclic(1000))
    assert 0.0 < record.residual_max <= 1e-10
    assert 0.0 < record.energy_error_max <= 1e-10
    assert record.steady.kind == "cyclic slip" and record.steady.period == 1
    D = record.cycles.dissipation
    # round-off neither drains nor feeds the steady cycle
    assert np.ptp(D[300:]) <= 1e-10 * D[0]
    assert np.all(np.diff(D[:60]) < 0.0)


@pytest.mark.parametrize(("top", "f"), [(0.5, 0.35), (-0.75, 0.1), (1.0, 0.6)])
def test_a_crowned_body_rolls_to_where_it_rests_under_its_load(top: float, f: float) -> None:
    # another top of the same parabola is the same gap, tilted: only rigid motions may differ
    body, bend = block_system(48, 12, half=False, f=f), 0.05
    tilted, level = (
        evolve(replace(body, g0=bend * (body.x - at) ** 2), cyclic(3, maximum=5.0), output=ALL)
        for at in (top, 0.0)
    )
    for field in ("P", "Q", "v"):
        x, y = (getattr(record.samples, field) for record in (tilted, level))
        assert np.abs(x - y).max() <= 1e-9 * np.abs(y).max(), field
    gaps = [
        record.samples.w[-1] + bend * (body.x - at) ** 2
        for record, at in ((tilted, top), (level, 0.0))
    ]
    assert np.abs(gaps[0] - gaps[1]).max() <= 1e-9 * bend
    # to neither side of its load's middle it leans further
    assert np.abs(level.samples.w - level.samples.w[:, ::-1]).max() <= 1e-9 * bend
    assert tilted.residual_max <= 1e-11 and tilted.energy_error_max <= 1e-10


def test_a_load_range_lost_in_round_off_is_refused() -> None:
    small = block_system(40, 20)
    fine = evolve(small, cyclic(3, 1.0 - 1e-6)).cycles.dissipation
    coarse = evolve(small, cyclic(3, 1.0 - 1e-4)).cycles.dissipation
    # the change of load alone decides: small ranges dissipate in proportion
    assert fine == pytest.approx(1e-2 * coarse, rel=1e-3)
    with pytest.raises(SolveError, match="enlarge the load range") as caught:
        evolve(small, cyclic(3, 1.0 - 1e-8))
    assert not len(caught.value.record.cycles.dissipation)  # type: ignore[attr-defined]
    with pytest.raises(SolveError, match="enlarge the load range"):
        evolve(eliminate_tangential(replace(small, f=np.zeros(small.n))), cyclic(3, 1.0 - 1e-8))


def test_jumps_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # a leg that jumps twice stands for one that jumps without end
    system = random_system(53, 2, 5.0)
    loop = [[1.0, 0.0], [0.1454, 0.1252], [0.7035, 0.7283], [1.3334, 0.2232], [1.0, 0.0]]
    history = table(system, [[0.0, 0.0], loop[0]], loop, 3)
    assert evolve(system, history, SolverOptions(on_jump="static")).jumps >= 2
    monkeypatch.setattr("receding_fenicsx.interface.exact.jumps.MAX_JUMPS", 1)
    said = (
        r"^cycle 2, leg 0: the contact has jumped 1 times on one leg and jumps again at "
        r"load0 = 0\.4425\d*, load1 = 0\.0816\d*; reduce the friction or the load range; "
    )
    with pytest.raises(NoQuasiStaticContinuation, match=said):
        evolve(system, history, SolverOptions(on_jump="static"))
