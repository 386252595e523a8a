from dataclasses import replace

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system, table

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

HALF = block_system(20, 10)
STICK, OPEN, FORWARD, BACKWARD = (
    int(State.STICK),
    int(State.SEPARATION),
    int(State.FORWARD_SLIP),
    int(State.BACKWARD_SLIP),
)


def test_reflects_even_odd_and_total_arrays() -> None:
    mirror = mirror_of(replace(HALF, x=np.array([0.0, 1.0, 2.0])))
    a = np.array([[5.0, 1.0, 2.0], [7.0, 3.0, 4.0]])
    assert mirror.even(a).tolist() == [[2, 1, 5, 1, 2], [4, 3, 7, 3, 4]]
    assert mirror.odd(a).tolist() == [[-2, -1, 0, 1, 2], [-4, -3, 0, 3, 4]]
    assert mirror.total(a).tolist() == [[2, 1, 10, 1, 2], [4, 3, 14, 3, 4]]
    assert mirror.factor == 2.0


def test_slip_directions_change_places_on_the_reflected_side() -> None:
    mirror = mirror_of(replace(HALF, x=np.array([0.0, 1.0, 2.0, 3.0])))
    states = np.array([STICK, FORWARD, BACKWARD, OPEN], dtype=np.int8)
    expected = [OPEN, FORWARD, BACKWARD, STICK, FORWARD, BACKWARD, OPEN]
    assert mirror.states(states).tolist() == expected
    rows, nodes = mirror.nodes(np.array([2, 0, 2]))
    assert rows.tolist() == [0, 0, 1, 2, 2]
    assert nodes.tolist() == [1, 5, 3, 1, 5]
    assert mirror.left[[1, 5, 3]].tolist() == [True, False, False]


def test_a_half_without_a_node_on_the_axis_doubles_nothing() -> None:
    mirror = mirror_of(replace(HALF, x=np.array([0.5, 1.5])))
    assert mirror.total(np.array([1.0, 2.0])).tolist() == [2, 1, 1, 2]
    assert mirror.odd(np.array([1.0, 2.0])).tolist() == [-2, -1, 1, 2]


def test_a_whole_model_is_left_as_it_is() -> None:
    mirror = mirror_of(replace(HALF, half=False))
    a = np.arange(21.0)
    assert all(np.array_equal(m(a), a) for m in (mirror.even, mirror.odd, mirror.total))
    assert mirror.factor == 1.0


def test_half_and_whole_records_agree_in_every_field() -> None:
    output = OutputOptions(samples_per_leg=10, cycles="all")
    half = evolve(HALF, cyclic(3), output=output)
    whole = evolve(block_system(40, 10, half=False), cyclic(3), output=output)
    for name in ("turning_points", "samples"):
        a, b = getattr(half, name), getattr(whole, name)
        assert np.array_equal(a.state, b.state)
        fields = "cycle leg s load P Q p q v w load_displacement"
        for field in fields.split():
            x, y = getattr(a, field), getattr(b, field)
            assert x.shape == y.shape, field
            assert np.abs(x - y).max() <= 1e-10 * np.abs(y).max(), field
    for field in ("x", "points", "f", "g0", "weight"):
        assert np.allclose(getattr(half, field), getattr(whole, field), rtol=1e-14, atol=1e-14), (
            field
        )
    assert (half.modelled_nodes, whole.modelled_nodes) == (21, 41)
    assert half.dissipation_first_loading == pytest.approx(
        whole.dissipation_first_loading, rel=1e-10
    )
    for field in ("dissipation", "dissipation_density", "slip_increment"):
        a, b = getattr(half.cycles, field), getattr(whole.cycles, field)
        assert np.abs(a - b).max() <= 1e-10 * np.abs(b).max(), field
    # the density integrates to the total
    total = half.cycles.dissipation_density @ half.weight
    assert total == pytest.approx(half.cycles.dissipation, rel=1e-12)

    def rows(record: object) -> np.ndarray:
        e = record.events  # type: ignore[attr-defined]
        s = np.round(e.s, 9)
        listed = np.column_stack([e.cycle, e.leg, s, e.node, e.old, e.new])
        return listed[np.lexsort(listed.T[::-1])]

    a, b = rows(half), rows(whole)
    assert a.shape == b.shape and len(a) > 100
    assert np.array_equal(a, b)


def test_record_of_a_circle_holds_the_forces_of_all_of_it() -> None:
    """Nodes of one radian that know nothing of each other, under twice the unit load."""
    Q, P = np.array([0.1, -0.9, 0.8]), np.array([1.0, 2.0, 1.0])
    radian = small_system(np.eye(6), {"a": [*Q, *P]}, 0.3)
    radian = replace(radian, x=radian.x + 1.0, weight=np.array([1.0, 2.0, 3.0]), axisymmetric=True)
    table_ = evolve(radian, table(radian, [0.0, 2.0])).turning_points
    assert table_.state[0].tolist() == [STICK, FORWARD, BACKWARD]
    # those that slip are at their limits
    held = np.array([0.1, -0.6, 0.3])
    assert table_.P[0] == pytest.approx(2.0 * np.pi * 2.0 * P)
    assert table_.Q[0] == pytest.approx(2.0 * np.pi * 2.0 * held)
    # tractions are per area of the full circle too
    assert table_.p[0] == pytest.approx(2.0 * P / radian.weight)
    assert table_.q[0] == pytest.approx(2.0 * held / radian.weight)


def test_half_of_two_edges_dissipates_half_of_the_energy() -> None:
    """Two nodes on two edges, the one slipping; their mirror images do the same."""
    system = small_system(np.eye(4), {"a": [0.9, 0.1, 1.0, 2.0]}, 0.3)
    system = replace(
        system, x=np.array([1.0, 2.0]), edge=np.array([0, 1]), edge_names=("lower", "upper")
    )
    path = table(system, [0.0, 1.0], [1.0, 0.5, 1.0], 1)
    alone, both = (evolve(replace(system, half=half), path) for half in (False, True))
    assert both.x.tolist() == [-1.0, 1.0, -2.0, 2.0]
    # the one slips by 0.6 under 0.3, both growing from zero
    assert alone.dissipation_first_loading == pytest.approx(0.09, rel=1e-12)
    assert both.dissipation_first_loading == pytest.approx(0.18, rel=1e-12)
    assert both.cycles.dissipation == pytest.approx(2.0 * alone.cycles.dissipation, rel=1e-12)
    lower, upper = both.by_edge().values()
    assert lower.turning_points.Q[0] == pytest.approx([-0.3, 0.3])
    assert upper.turning_points.Q[0] == pytest.approx([-0.1, 0.1])


def test_half_of_a_contact_that_jumps_releases_half_of_the_energy() -> None:
    """One node without a continuation on the second leg, and the same beside its mirror image."""
    K = [[2.0, 1.5], [1.5, 2.0]]
    node = small_system(K, {"a": [1.0, 1.0], "b": [0.0, -1.0]}, 2.0)
    node = replace(node, x=np.array([1.0]), points=np.array([[1.0, 0.0]]))
    path = table(node, [[0.0, 0.0], [1.0, 0.0], [0.25, 1.0]])
    alone, both = (
        evolve(replace(node, half=half), path, SolverOptions(on_jump="static"))
        for half in (False, True)
    )
    assert alone.jumps == both.jumps == 1
    assert alone.released > 0.1
    for record in (alone, both):
        assert record.energy_error_max < 1e-10
    assert both.released == pytest.approx(2.0 * alone.released, rel=1e-12)
    assert summarise(both)["jumps"] == {"count": 1, "energy_released": both.released}
