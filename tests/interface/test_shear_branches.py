"""Shear limit and cohesion against closed forms, on both methods."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from replay import objections
from small import named_loads, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.evolution.problem import problem_of_history, with_profiles
from receding_fenicsx.interface.gauss_seidel.compliance_form import step_problem
from receding_fenicsx.studies.wear.steps import NodePairs, advance

pytestmark = pytest.mark.one_rank

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
ONE = small_system(np.eye(2), {"press": [0.0, 1.0], "pull": [1.0, 0.0]}, 0.5)


def branched(
    system: rf.ContactSystem, cohesion: float | None, limit: float | None
) -> rf.ContactSystem:
    c, t = (None if part is None else np.full(system.n, part) for part in (cohesion, limit))
    return replace(system, cohesion=c, shear_limit=t)


def evolve(
    system: rf.ContactSystem, history: rf.History, method: str = "events", on_jump: str = "stop"
) -> rf.Record:
    solver = rf.SolverOptions(method=method, steps_per_leg=40, on_jump=on_jump)
    record = rf.evolve(system, history, solver, rf.OutputOptions(40, "all"))
    assert objections(system, history, record) == []
    return record


@pytest.mark.parametrize(
    ("f", "cohesion", "limit"),
    [(1.0, None, 1.0), (0.0, 1.0, None), (0.0, 2.0, 1.0), (0.2, 0.5, 1.0)],
)
def test_shear_lag_with_constant_shear(
    f: float, cohesion: float | None, limit: float | None
) -> None:
    """A bar of springs c = 1, node j slips by sum (F - i t) over i = j + 1 .. k (t = 1).

    First loading dissipates t sum v_j, a full reversal twice the slip both ways: 4 times as much.
    """
    n, F, k = 8, 5.5, 5
    K_t = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K_t[0, 0] = 1.0
    K = np.block([[K_t, np.zeros((n, n))], [np.zeros((n, n)), np.eye(n)]])
    zero, one = np.zeros(n), np.ones(n)
    pull = np.concatenate([np.eye(n)[0], zero])
    system = small_system(K, {"press": np.concatenate([zero, 4.0 * one]), "pull": pull}, f)
    system = branched(system, cohesion, limit)
    loop = [[1, F], [1, -F], [1, F]]
    history = table(system, [[0, 0], [1, 0], [1, F]], loop, 2)
    record = evolve(system, history)
    slips = np.array([sum(F - i for i in range(j + 1, k + 1)) for j in range(n)])
    slip = slips.sum()
    assert record.dissipation_first_loading == pytest.approx(slip, rel=1e-12)
    assert record.cycles.dissipation == pytest.approx([4.0 * slip] * 2, rel=1e-12)
    # the law of a node alone is that of all
    limits = record.friction.limits(np.full(n, 0.7))
    assert record.friction[3].limits(np.array(0.7)) == tuple(part[3] for part in limits)
    half = record.traction_law(2.0).limits(np.full(n, 0.35))
    assert np.array_equal(2.0 * np.array(half), limits)
    # nodes that cohesion alone holds stick
    assert "stick" in [zone for zone, *_ in record.at().zones]
    found = rf.evolve(system, replace(history, cycles=8), until="limit").limit
    assert found is not None and found.reached and found.unique == -1
    # it was played, not searched for
    assert not found.jumped and np.isnan(found.residual)
    assert found.cycle == found.cycles_played > 0
    # what wears off does not depend on the pressure, which falls as the gap grows
    pairs = NodePairs(problem_of_history(system, history), np.full(n, 1e-3))
    row = pairs.begin()
    row["step"] = 10.0
    row = advance(pairs, row, 1e-9, 10.0)
    assert row["cycles"] == 10.0
    assert row["depth"] == pytest.approx(10.0 * 1e-3 * 4.0 * slips, rel=1e-9, abs=1e-12)
    assert row["P"] == pytest.approx(4.0 - row["depth"], rel=1e-9)


@pytest.mark.parametrize("short", [5e-13, 5e-12, 5e-10])
def test_sliding_that_begins_just_before_the_end_of_a_leg_is_told_as_for_friction(
    short: float,
) -> None:
    """A free node, pressed by 2, is pushed back by 1, a little more than its limit."""
    K, loads = np.diag([0.0, 1.0]), {"press": [0.0, 1.0], "pull": [-1.0, 0.0]}
    cone = small_system(K, loads, 0.5 * (1.0 - short), rigid=[[1.0, 0.0]])
    for system in (cone, branched(replace(cone, f=np.full(1, 3.0)), None, 1.0 - short)):
        with pytest.raises(rf.NoEquilibrium, match="gross sliding"):
            rf.evolve(system, table(system, [[0, 0], [2, 0], [2, 1]]))


def test_a_bond_forms_in_contact_and_breaks_without_shear_alone() -> None:
    """Gap 1, K = 1, c = 1/2: opened under Q = 0.3 the node springs back, 0.3^2 / 2 is released."""
    system = replace(ONE, f=np.zeros(1), g0=np.ones(1), cohesion=np.array([0.5]))
    to_and_fro = table(system, [[0, 0], [2, 0], [2, 0.3], [2, 0], [0, 0], [2, 0], [2, 1]])
    record = evolve(system, to_and_fro)
    assert record.turning_points.Q[[1, 5], 0] == pytest.approx([0.3, 0.5])
    assert record.dissipation_first_loading == pytest.approx(0.25)
    sheared = table(system, [[0, 0], [2, 0], [2, 0.3], [0, 0.3]])
    with pytest.raises(rf.NoQuasiStaticContinuation, match="shear force of its cohesion") as error:
        evolve(system, sheared)
    assert named_loads(error.value, "press") == pytest.approx([1.0])
    for method in ("events", "gauss-seidel"):
        record = evolve(system, sheared, method, "static")
        assert record.jumps == 1
        assert record.turning_points.v[-1, 0] == pytest.approx(-0.3)
        assert record.released == pytest.approx(0.045, rel=1e-6)


@pytest.mark.parametrize("number", [1, 4])
@pytest.mark.parametrize(("cohesion", "D"), [(None, 0.125), (0.25, 0.15625)])
def test_the_slip_of_a_load_step_counts_from_where_a_node_lands(
    number: int, cohesion: float | None, D: float
) -> None:
    """Landed at v = -1, lambda = 1; it slips back to v = (lambda - 1) / 2 + c - lambda."""
    system = branched(replace(ONE, g0=np.ones(1)), cohesion, None)
    solver = rf.SolverOptions(method="gauss-seidel", steps_per_leg=number)
    record = rf.evolve(system, table(system, [[0, 0], [2, 2]]), solver)
    assert record.turning_points.v[-1, 0] == pytest.approx(-1.5 + (cohesion or 0.0), rel=1e-12)
    assert record.dissipation_first_loading == pytest.approx(D, rel=1e-12)


def test_tractions_of_a_block_keep_the_shear_limit_and_zones_end_at_nodes() -> None:
    changes = ["mesh.contact_elements=24", "history.cycles=2", "output.samples_per_leg=3"]
    half = rf.given(rf.run(rf.read_scene(BLOCK, [*changes, "contact.shear_limit=0.2 - 0.02*x**2"])))
    limit = 0.2 - 0.02 * half.x**2
    q = np.abs(half.turning_points.q)
    assert np.all(q <= limit * (1.0 + 1e-9)) and np.any(q >= limit * (1.0 - 1e-9))
    # zone ends and tractions are those of the nodes: laws of the ends are known for cones only
    p, shear = rf.recovered_tractions(half, half.at(1))
    assert np.array_equal(p, half.at(1).p) and np.array_equal(shear, half.at(1).q)
    assert not rf.half_width_estimates(half, 0)["stick_half_width_estimate"]["fitted"]


def test_a_support_that_carries_a_node_leaves_it_no_limit() -> None:
    held = np.array([False, False, False, True])
    system = replace(small_system(np.eye(4), {"a": np.ones(4)}, 0.3), held=held)
    scene = rf.Scene(contacts=(rf.Contact(friction=0.3, cohesion=0.2),))
    law = with_profiles(scene, system).law
    assert law.limits(np.ones(2))[1] == pytest.approx([0.5, 0.0])


def test_what_knows_cones_only_refuses_in_one_line() -> None:
    system = replace(ONE, shear_limit=np.ones(1))
    with pytest.raises(rf.InputError, match="shear limit or cohesion"):
        step_problem(system, np.ones(2))
