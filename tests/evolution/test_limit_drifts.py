"""Drifts to a limit, cycle by cycle: against cycles that are played, and nodes that pass it."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from models import block_system, under_four_loads
from small import cyclic, table

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.limit import search
from receding_fenicsx.evolution.limit.drifts import Drifts
from receding_fenicsx.evolution.limit.foresight import Slips, cycles_to_come, expect
from receding_fenicsx.evolution.limit.frozen import Budget
from receding_fenicsx.evolution.limit.passing import clearance, is_robust
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.normal_form import frictional_form
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History

pytestmark = pytest.mark.one_rank


def paper_block(cycles: int) -> tuple[ContactSystem, History]:
    """Return half of the paper's block on a coarse mesh and its history."""
    return block_system(40, 20), cyclic(cycles)


def loaded_block(seed: int, cycles: int) -> tuple[ContactSystem, History]:
    """Return a random block under four loads and its history."""
    block, loop = under_four_loads(seed)
    return block, table(block, [[0.0] * 4, [1.0, 0.0, 0.0, 0.0], loop[0]], loop, cycles)


@pytest.mark.parametrize(
    ("seed", "before"), [(None, 16), (338, 10), (428, 10), (433, 16), (738, 16)]
)
def test_drifts_are_those_of_cycles_that_are_played(
    seed: int | None, before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # with seed 433 nodes open without slip before, where both margins vanish at once
    after = 6
    system, history = paper_block(30) if seed is None else loaded_block(seed, 30)
    record, shifted = evolve(system, history), list[int]()
    drifts_of = search.drifts_of

    def remembered(frozen, solution, *states):  # type: ignore[no-untyped-def]
        shifted[:] = frozen.shifted
        return drifts_of(frozen, solution, *states)

    monkeypatch.setattr(search, "drifts_of", remembered)
    model = frictional_form(system)
    rows = np.array([record.start_row(cycle) for cycle in range(1, 31)], dtype=int)
    start = turning_point(record, system, int(rows[before]))
    force = float(np.abs(record.turning_points.P).max())
    found = search.find_limit(model, EventPath(model), start, history.loop, force, Budget(50))
    drifts, k = found.drifts, len(shifted)
    assert drifts is not None
    half = record.turning_points.v.shape[1] - system.n
    played = record.turning_points.v[rows][:, half:][:, shifted]
    played = played[before + 2 : before + 2 + after] - played[before]
    # the arrays are changed in place from cycle to cycle
    foreseen = np.array([y[:k] - y[k:] for y, _ in islice(cycles_to_come(drifts), after)])
    size = np.abs(played[-1] - played[0]).max()
    assert size > 1e-8 * np.abs(record.turning_points.v).max()
    assert np.abs(foreseen - played).max() < 1e-7 * size


@pytest.mark.parametrize(("coupling", "passed"), [(-0.5, False), (0.0, False), (0.5, True)])
def test_a_slip_beyond_the_limit_is_told(coupling: float, passed: bool) -> None:
    # m = q + M y from q = -(1, 0.9). Node 1 slips by all that it lacks, 1, and node 2 by half of
    # it; with coupling 0.5 the limit of node 1 is 0.733. None drifts backward: m = 9 there
    M, q, none = np.array([[1.0, coupling], [coupling, 1.0]]), -np.array([1.0, 0.9]), np.zeros(2)
    both = np.block([[M, -M], [-M, M]])
    drifts = Drifts(
        limit=np.append(np.linalg.solve(M, -q), none),
        begun=np.zeros(4),
        margins=np.append(q, none + 9.0)[None],
        responses=np.array([np.diag([1.0, 2.0, 1.0, 1.0]), both]),
        towards=np.arange(2),
        stiffness=np.ones(2),
    )
    clear = clearance(drifts, force=1.0)
    assert clear == -1.0 if passed else clear > 0.1
    assert clearance(drifts, force=1.0, part=0.9) == 1.0


def test_a_node_that_lags_lets_another_slip_beyond_the_limit() -> None:
    # m = q + M y; in each cycle a node slips by a quarter of what it lacks of a zero margin alone.
    # On pace both come to their limits from below; if node 2 slips half as fast, node 1 passes
    M, q, none = np.array([[1.0, 0.05], [0.05, 1.0]]), -np.array([1.0, 0.9]), np.zeros(2)
    both = np.block([[M, -M], [-M, M]])
    before = Drifts(
        limit=np.append(np.linalg.solve(M, -q), none),
        begun=np.zeros(4),
        margins=np.append(q, none + 9.0)[None],
        responses=np.array([4.0 * np.eye(4), both]),
        towards=np.arange(2),
        stiffness=np.ones(2),
    )

    def after(*made: float) -> Drifts:
        begun = np.append(made, none)
        return replace(before, begun=begun, margins=before.margins + both @ begun)

    for now, robust in ((after(0.25, 0.225), True), (after(0.25, 0.1125), False)):
        assert clearance(now, force=1.0) == 1.0
        assert is_robust(expect(before), now, force=1.0, doubt=1.0) == robust


def test_drifts_that_are_not_decided_are_not_robust() -> None:
    # a slip does not change the margin of its own cycle: no slip brings -1 to zero
    lasting = np.array([[1.0, -1.0], [-1.0, 1.0]])
    before = Drifts(
        limit=np.array([1.0, 0.0]),
        begun=np.zeros(2),
        margins=np.array([[1.0, 9.0]]),
        responses=np.array([np.zeros((2, 2)), lasting]),
        towards=np.zeros(1, dtype=int),
        stiffness=np.ones(1),
    )
    now = replace(before, margins=np.array([[-1.0, 9.0]]))
    assert not is_robust(expect(before), now, force=1.0)


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
def test_slips_are_those_of_the_complementarity_problem(size: float) -> None:
    # positive definite, so that the slips are unique; the margins wander, few or all change sides
    rng = np.random.default_rng(16)
    half = rng.normal(size=(40, 40))
    R = size * (half @ half.T + np.triu(half, 1) - np.triu(half, 1).T + np.eye(40))
    slips, m = Slips(R, np.arange(40) < 20), rng.normal(size=40)
    for step in range(200):
        m += rng.normal(size=40) * (1.0 if step % 20 == 0 else 0.02)
        s = slips.of(m)
        assert np.abs(np.minimum(R @ s + m, size * s)).max() < 1e-9
    assert len(slips.among) > 20


def test_all_slips_may_cease_at_once() -> None:
    slips = Slips(np.eye(20), np.ones(20, dtype=bool))
    for m in (-1.0, 2.0, -3.0):
        assert np.array_equal(slips.of(np.full(20, m)), np.full(20, max(-m, 0.0)))


def test_slips_are_found_after_some_that_nothing_resists() -> None:
    # together two nodes slip as far as one of them: only their sum is determined
    slips = Slips(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.ones(3) > 0.0)
    assert abs(slips.of(np.array([-1.0, -1.0, -5.0]))[:2].sum() - 1.0) < 1e-12
    assert np.allclose(slips.of(np.array([-2.0, 3.0, -5.0])), [2.0, 0.0, 5.0], atol=1e-12)
    assert np.allclose(slips.of(np.array([4.0, -2.0, 1.0])), [0.0, 2.0, 0.0], atol=1e-12)


def test_slips_do_not_keep_the_round_off_of_many_exchanges() -> None:
    slips, m = Slips(np.eye(20), np.ones(20, dtype=bool)), np.linspace(-1.0, 1.0, 20)
    slips.of(m)
    slips._map.T *= 1.0 + 1e-9
    assert np.array_equal(slips.of(m), np.maximum(-m, 0.0))
