import tomllib
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system, table

from receding_fenicsx.errors import (
    InputError,
    NoEquilibrium,
    NoQuasiStaticContinuation,
    NotConverged,
    SolveError,
)
from receding_fenicsx.evolution import run_state
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.problem import problem_of_history
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.exact.path import EventPath
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

pytestmark = [pytest.mark.one_rank, pytest.mark.once]

BLOCK = block_system(40, 20)
STEPS = SolverOptions(method="gauss-seidel", steps_per_leg=2)
ENDS = tomllib.loads(Path(__file__).with_name("ends.toml").read_text())["end"]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("beyond", [-3, 0, 1, 3])
def test_round_off_does_not_name_a_node_that_comes_to_its_limit_at_the_end_of_a_leg(
    beyond: int, side: float
) -> None:
    """K = I, f P = 1/2, pulled to its limit and some units of round-off: it sticks until it moves.

    Half a body and the whole one differ by as much.
    """
    node = small_system(np.eye(2), {"press": [0, 1], "pull": [-1, 0]}, 0.5)
    pull = side * 0.5 * (1.0 + beyond * 2.3e-16)
    path = [[0, 0], [1, 0], [1, pull], [1, 1.2 * side], [1, pull], [1, pull + 1e-6 * side]]
    forward = State.FORWARD_SLIP if side > 0.0 else State.BACKWARD_SLIP
    for solver in (None, STEPS):
        record = evolve(node, table(node, path), solver, OutputOptions(1, "all"))
        table_ = record.turning_points
        assert table_.state.ravel().tolist() == [1, 1, forward, 1, 1]
        assert record.samples.state.ravel().tolist() == [1, 1, forward, 1, 1]
        assert record.events.leg.tolist() == [2, 3] and record.n_events == 2
        # of the ten steps the two that move the node take a second sweep
        assert record.sweeps == (12 if solver else 0)
    slipped = [[0, 0], [1, 0], [1, pull], [1, pull + 1e-6 * side]]
    assert evolve(node, table(node, slipped)).turning_points.state[-1] == forward


def test_the_usual_cycles_and_the_last_are_sampled() -> None:
    record = evolve(BLOCK, cyclic(12))
    kept = np.unique(record.samples.cycle).tolist()
    assert kept == [0, 1, 2, 9, 12]
    for cycle, legs in ((0, 1), (1, 2), (12, 2)):
        assert np.sum(record.samples.cycle == cycle) == 40 * legs
    assert sorted(set(record.events.cycle.tolist())) == [0, 1, 2, 9, 12]
    assert record.samples.s.tolist() == pytest.approx(np.tile(np.arange(1, 41) / 40, 9))
    assert set(evolve(BLOCK, cyclic(2)).samples.cycle.tolist()) == {0, 1, 2}
    # in load steps at the ends of those that are nearest
    thirds = evolve(BLOCK, cyclic(0), replace(STEPS, steps_per_leg=8), OutputOptions(3, "all"))
    assert thirds.samples.s.tolist() == [3 / 8, 5 / 8, 1.0]
    # the last one is traced once more, from its start
    every = evolve(BLOCK, cyclic(12), output=OutputOptions(cycles="all")).samples
    for name in ("load", "state", "P", "Q", "v"):
        found, known = (getattr(table, name) for table in (record.samples, every))
        known = known[np.isin(every.cycle, kept)]
        assert np.abs(found - known).max() <= 1e-11 * np.abs(known).max(), name


def test_a_cycle_is_steady_at_the_tolerance_asked_for_or_at_the_documented_one() -> None:
    """1e-8, and 1e-10 of a limit, of the largest force, twice running."""
    small, stops = block_system(12, 6), {}
    for tolerance in (None, 1e-4, 1e-8, 1e-10):
        solver = SolverOptions(steady_tolerance=tolerance)
        steady = evolve(small, cyclic(200), solver, until="steady").steady
        stops[tolerance] = steady.cycle
        least = tolerance or 1e-8
        assert steady.reached and len(steady.change) == steady.cycle
        assert steady.change[-2:].max() <= least < 100.0 * steady.change[-3]
    assert stops[None] == stops[1e-8] and stops[1e-4] < stops[1e-8] < stops[1e-10]
    limited = problem_of_history(small, replace(cyclic(3), until_limit=True)).solver
    assert limited.steady_tolerance == 1e-10


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_the_options_of_a_method_reach_it_beside_a_shear_limit_too(method: str) -> None:
    """The node of `test_jumps` jumps; a limit that it never meets changes nothing."""
    node = small_system([[2.0, 1.5], [1.5, 2.0]], {"a": [1, 1], "b": [0, -1]}, 2.0)
    node = replace(node, shear_limit=np.full(1, 100.0))
    history = table(node, [[0, 0], [1, 0], [0.25, 1]])
    options = SolverOptions(method=method, steps_per_leg=5)
    with pytest.raises(NoQuasiStaticContinuation):
        evolve(node, history, options)
    record = evolve(node, history, replace(options, on_jump="static"))
    assert record.jumps == 1 and record.released == pytest.approx(32 / 211.75, rel=1e-6)
    if method == "gauss-seidel":
        # only the first two nodes, which "b" opens, act on each other
        K = np.eye(6)
        K[3, 4] = K[4, 3] = 0.9
        loads = {"a": [0.1, 0.1, 0.1, 1, 1, 1], "b": [0, 0, 0.5, -3, -3, 0]}
        three = replace(small_system(K, loads, 0.4), shear_limit=np.full(3, 100.0))
        path = table(three, [[0, 0], [1, 1]])
        with pytest.raises(
            NotConverged, match=r"after 3 sweeps .*: residual \S+ at node [01] \(x = [01]\), tol"
        ):
            evolve(three, path, replace(options, max_sweeps=3, polish=False))
        slow = replace(options, polish=False)
        loose = replace(slow, residual_tolerance=1e-6, change_tolerance=1e-6)
        slower = replace(slow, over_relaxation=1.0), replace(slow, steps_per_leg=9)
        sweeps = [evolve(three, path, some).sweeps for some in (options, loose, slow, *slower)]
        assert len(set(sweeps)) == 5 and sweeps[0] < sweeps[1] < min(sweeps[2:])


@pytest.mark.parametrize("end", ENDS)
def test_a_path_that_ends_tells_by_a_whole_message_why_and_where(end: dict[str, Any]) -> None:
    system = small_system(
        end["K"], end["loads"], end.get("f", 0.5), end.get("gap", 0.0), end.get("rigid", ())
    )
    arrays: dict[str, Any] = {k: np.array(end[k]) for k in ("f_backward", "held") if k in end}
    system = replace(system, **arrays)
    history = table(system, end["path"], end.get("loop", ()), 1)
    for method in end.get("methods", ["events"]):
        solver = SolverOptions(method=method, steps_per_leg=3, on_jump=end.get("on_jump", "stop"))
        with pytest.raises((InputError, SolveError)) as caught:
            evolve(system, history, solver, initial_slip=end.get("slip"))
        assert str(caught.value) == end["told"], method


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_an_error_carries_the_record_of_the_legs_before_it(method: str) -> None:
    options, path = SolverOptions(method=method, steps_per_leg=10), [1.0, 0.4, 0.8]
    with pytest.raises(NoEquilibrium, match=r"^cycle 1, leg 2: lift-off") as caught:
        evolve(BLOCK, table(BLOCK, [0.0, 1.0], [*path, -0.2, 1.0], 3), options)
    record = caught.value.record
    assert isinstance(record, Record)
    ends = record.turning_points
    assert list(zip(ends.cycle.tolist(), ends.leg.tolist(), strict=True)) == [
        (0, 0),
        (1, 0),
        (1, 1),
    ]
    assert ends.load[:, 0].tolist() == path and len(record.cycles.dissipation) == 0
    # the same legs as a path of their own
    parts = [evolve(BLOCK, table(BLOCK, [0.0, *path[:n]]), options) for n in (1, 2, 3)]
    assert record.n_events == parts[2].n_events > parts[0].n_events
    assert np.array_equal(ends.P, parts[2].turning_points.P)
    for name in ("sweeps", "residual_max", "energy_error_max", "jumps", "released"):
        so_far = [getattr(part, name) for part in parts]
        assert so_far == sorted(so_far) and getattr(record, name) == so_far[2], name


def test_a_leg_that_breaks_its_energy_identity_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = run_state.energy_error
    monkeypatch.setattr(run_state, "energy_error", lambda *given: (1e-5, exact(*given)[1]))
    with pytest.raises(SolveError) as caught:
        evolve(BLOCK, cyclic(1))
    assert str(caught.value) == (
        "cycle 0, leg 0: the exact path breaks the energy identity before p0 = 1: error 1.0e-05 "
        "over 1e-06 of the leg's energy; try the other solver method, and report this scene"
    )
    steps = SolverOptions(method="gauss-seidel", steps_per_leg=10)
    assert evolve(BLOCK, cyclic(1), steps).energy_error_max == 1e-5


def laid_down(gap: float) -> ContactSystem:
    """Return two nodes, the second one open; it is lowered as the first one slides forward."""
    K = np.diag([5.0, 5.0, 3.0, 4.0])
    K[0, 3] = K[3, 0] = 0.8
    return small_system(K, {"p0": [0.0, 0.0, 1.0, 0.2]}, 0.4, [0.0, gap])


METHODS = ["events", "gauss-seidel"]


@pytest.mark.parametrize("method", METHODS)
def test_an_open_node_has_no_initial_slip(method: str) -> None:
    # node 1 hangs free: w = -(0.2 + 0.8 v0) / 4; node 0 slides back to Q = 5 v0 + 0.8 w = f P
    system = laid_down(0.3)
    v0 = (0.4 + 0.8 * 0.2 / 4.0) / (5.0 - 0.8**2 / 4.0)
    # nor does a shear limit that is never met change anything, or the numbers given afterwards
    far, slip = replace(system, shear_limit=np.full(2, 100.0)), np.array([1.0, 0.0])
    history, solver = table(system, [0.0, 1.0]), SolverOptions(method=method)
    for elsewhere, body in product((0.0, -7.0), (system, far)):
        slip[1] = elsewhere
        record = evolve(body, history, solver, initial_slip=slip)
        end = record.turning_points
        assert end.v[0] == pytest.approx([v0, 0.0], rel=1e-11, abs=1e-13)
        assert end.w[0, 1] == pytest.approx(-(0.2 + 0.8 * v0) / 4.0, rel=1e-11)
        assert record.dissipation_first_loading == pytest.approx(0.2 * (1.0 - v0), rel=1e-11)
        assert record.residual_max <= 1e-11
        # Gauss-Seidel's only step ends there, of the exact path all states hold from the start on
        place = float(method == "gauss-seidel" and body is system)
        assert record.events.s.tolist() == [place] and record.events.load.tolist() == [[place]]
    # nor has one that is held
    held = replace(system, held=np.array([True, False, False, False]))
    record = evolve(held, history, solver, initial_slip=slip)
    assert record.turning_points.v[0, 0] == 0.0 and slip.tolist() == [1.0, -7.0]


@pytest.mark.parametrize("method", METHODS)
def test_a_landing_after_an_initial_slip_is_refused_by_node(method: str) -> None:
    system = laid_down(0.01)
    history, options = table(system, [0.0, 1.0]), SolverOptions(method=method)
    with pytest.raises(InputError, match=r"^initial_slip: node 1 \(x = 1\) has an initial gap"):
        evolve(system, history, options, initial_slip=np.array([1.0, 0.0]))
    # where it lands without friction nothing depends on the place
    smooth = replace(system, f=np.array([0.4, 0.0]))
    end = evolve(smooth, history, options, initial_slip=np.array([1.0, 0.0])).turning_points
    assert end.P[0, 1] > 0.0
    held = replace(system, held=np.array([False, True, False, False]))
    end = evolve(held, history, options, initial_slip=np.array([1.0, 0.0])).turning_points
    assert end.P[0, 1] > 0.0


def test_a_refusal_names_a_motion_that_is_almost_free(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*leg: Any) -> None:
        raise SolveError("lost accuracy")

    monkeypatch.setattr(EventPath, "trace_leg", lost)
    system = small_system(np.diag([1e-9, 1.0]), {"p": [0.0, 1.0]}, 0.5)
    with pytest.raises(SolveError, match="softest motion of the body is 1e-09 as stiff"):
        evolve(system, table(system, [0.0, 1.0]))


def test_a_leg_across_the_unloaded_state_has_its_samples_where_they_were_asked_for() -> None:
    system = small_system(np.eye(2), {"a": [0.1, 1.0]}, 0.3)
    samples = evolve(system, table(system, [[0], [1]], [[1], [-0.5], [1]], 1)).samples
    for leg in (0, 1):
        s = samples.s[(samples.cycle == 1) & (samples.leg == leg)]
        assert s == pytest.approx(np.arange(1, 41) / 40.0, abs=1e-14)
