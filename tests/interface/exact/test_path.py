from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from law import random_system, worst_violation
from models import block_system, pushed_block
from replay import objections
from small import cyclic, named_loads, small_system, table, walker

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.exact.free_motions import at_rest
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.residual import round_off
from receding_fenicsx.interface.system import ContactState, ContactSystem, eliminate_tangential
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, SolverOptions

STICK, OPEN = State.STICK, State.SEPARATION
FORWARD, BACKWARD = State.FORWARD_SLIP, State.BACKWARD_SLIP
ALL = OutputOptions(samples_per_leg=12, cycles="all")


def near(value: object) -> Any:
    return pytest.approx(value, rel=1e-12, abs=1e-13)


def events_of(record: Record, cycle: int, leg: int) -> list[tuple[Any, ...]]:
    """Return (s, node, old, new) of one leg."""
    e = record.events
    rows = np.flatnonzero((e.cycle == cycle) & (e.leg == leg))
    return [(float(e.s[j]), int(e.node[j]), int(e.old[j]), int(e.new[j])) for j in rows]


# -- one node: a tangential spring of stiffness k on a plane --------------------------------------
#
# Loads "press" (P* = 1) and "push" (Q* = -1, to the right): Q = k v - push, P = press.

SPRING = 5.0
F = 0.4


def slider(k_n: float = 3.0) -> ContactSystem:
    K = [[SPRING, 0.0], [0.0, k_n]]
    return small_system(K, {"press": [0.0, 1.0], "push": [-1.0, 0.0]}, F)


def test_cyclic_push_runs_round_a_hysteresis_loop() -> None:
    P, top = 2.0, 1.6
    history = table(slider(), [[0, 0], [P, 0], [P, top]], [[P, top], [P, -top], [P, top]], 4)
    record = evolve(slider(), history, output=ALL)
    slip = (top - F * P) / SPRING
    # slip turns back once the push has changed by 2 f P, of 2 top in all
    for cycle in range(1, 5):
        assert events_of(record, cycle, 0) == [
            (near(0.0), 0, FORWARD, STICK),
            (near(F * P / top), 0, STICK, BACKWARD),
        ]
        assert events_of(record, cycle, 1) == [
            (near(0.0), 0, BACKWARD, STICK),
            (near(F * P / top), 0, STICK, FORWARD),
        ]
    ends = record.turning_points
    assert ends.v[2:, 0] == near([-slip, slip] * 4)
    assert record.cycles.dissipation == near([4 * F * P * slip] * 4)
    assert (record.steady.kind, record.steady.cycle) == ("cyclic slip", 2)
    # area of the loop of push over v
    s = record.samples
    one = s.cycle == 3
    push = np.concatenate([[top], s.load[one, 1]])
    v = np.concatenate([[slip], s.v[one, 0]])
    fine = evolve(slider(), history, output=replace(ALL, samples_per_leg=40))
    assert np.sum(0.5 * (push[1:] + push[:-1]) * np.diff(v)) == near(4 * F * P * slip)
    assert fine.n_events == record.n_events


def test_falling_pressure_lets_the_spring_slip_and_rising_pressure_holds_it() -> None:
    push, low = 0.6, 0.5
    history = table(slider(), [[0, 0], [2, 0], [2, push]], [[2, push], [low, push], [2, push]], 3)
    record = evolve(slider(), history, output=ALL)
    # slip starts at P = push / f = 1.5, a third of the way down; then Q = -f P
    assert events_of(record, 1, 0) == [(near(1 / 3), 0, STICK, FORWARD)]
    assert events_of(record, 1, 1) == [(near(0.0), 0, FORWARD, STICK)]
    assert record.turning_points.v[2:, 0] == near([(push - F * low) / SPRING] * 6)
    first = F**2 * ((push / F) ** 2 - low**2) / (2 * SPRING)
    assert record.cycles.dissipation == near([first, 0.0, 0.0])
    assert record.steady.kind == "shakedown"


# -- advancing contact: K = [[2, 1], [1, 2]], g0 = 1, loads as in the tests of Gauss-Seidel --------


def test_a_node_that_lands_slipping_slips_at_once() -> None:
    node = small_system([[2.0, 1.0], [1.0, 2.0]], {"load": [-3.0, 3.0]}, 0.5, 1.0)
    record = evolve(node, table(node, [0.0, 1.0]), output=ALL)
    (event,) = events_of(record, 0, 0)
    assert event == (near(1 / 3), 0, OPEN, FORWARD)
    s = record.samples
    landed = s.s > 1 / 3
    assert s.v[:, 0] == near(np.where(landed, 0.6 * s.s + 0.8, 3 * s.s))
    assert s.P[:, 0] == near(np.where(landed, 3.6 * s.s - 1.2, 0.0))
    assert record.dissipation_first_loading == near(0.24)


def test_a_node_that_leaves_and_lands_again_forgets_where_it_stuck() -> None:
    # Landed at 1/2 with v = 1/2, P = 3 lambda - 3/2: it leaves at 1/2 on the way back to -1, where
    # v = lambda again, and lands there next time: nothing is dissipated on the way.
    node = small_system([[2.0, 1.0], [1.0, 2.0]], {"load": [0.0, 3.0]}, 1.0, 1.0)
    history = table(node, [0.0, 1.0], [1.0, -1.0, 1.0], 2)
    record = evolve(node, history, output=ALL)
    for cycle in (1, 2):
        assert events_of(record, cycle, 0) == [(near(0.25), 0, STICK, OPEN)]
        assert events_of(record, cycle, 1) == [(near(0.75), 0, OPEN, STICK)]
    assert record.turning_points.v[:, 0] == near([0.5, -1.0, 0.5, -1.0, 0.5])
    assert record.cycles.dissipation == near([0.0, 0.0])


# -- two nodes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("locked", [-0.3, 0.0, 0.25])
def test_the_limit_cycle_of_a_coupled_pair_remembers_the_initial_slip(locked: float) -> None:
    # Node 1 always sticks where it was laid down, v1 = locked; K_tn couples that to the pressure of
    # node 0: P0 = 1 + c locked. Node 0 runs round the loop of a spring under that pressure.
    k, c, top = 2.0, 0.5, 1.5
    K = np.diag([k, 0.5, 4.0, 4.0])
    K[1, 2] = K[2, 1] = c
    two = small_system(K, {"press": [0, 0, 1, 1], "push": [-1, 0, 0, 0]}, F)
    history = table(two, [[0, 0], [1, 0], [1, top]], [[1, top], [1, -top], [1, top]], 5)
    record = evolve(two, history, output=ALL, initial_slip=np.array([0.0, locked]))
    P0 = 1.0 + c * locked
    assert record.turning_points.v[:, 1] == near([locked] * 12)
    assert record.turning_points.P[0, 0] == near(P0)
    assert record.cycles.dissipation == near([4 * F * P0 * (top - F * P0) / k] * 5)


def test_the_first_leg_after_an_initial_slip_is_one_static_problem() -> None:
    # Laid down at v = 1 on a spring k = 5 under P = 1, f = 0.4, it springs back: Q = k v = f P
    record = evolve(
        slider(), table(slider(), [[0, 0], [1, 0]]), initial_slip=np.array([1.0]), output=ALL
    )
    end = record.turning_points
    assert (end.v[0, 0], end.Q[0, 0]) == (near(F / SPRING), near(F))
    assert end.state.tolist() == [[BACKWARD]]
    assert record.dissipation_first_loading == near(0.5 * F * (1.0 - F / SPRING))


def test_a_pushed_body_walks_as_its_weight_shifts_from_foot_to_foot() -> None:
    # Weights 1 -+ 0.9 under a push of 0.5 < f 2: the light foot slips until its spring carries the
    # push but for f 0.1: +-k (v0 - v1) = 0.5/2 - f 0.1 = 0.2; each foot gains 2 * 0.2/k a cycle.
    body, k = walker(), 2.0
    path = [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 0.5, 0.9]]
    loop = [[1, 0.5, 0.9], [1, 0.5, -0.9], [1, 0.5, 0.9]]
    record = evolve(body, table(body, path, loop, 6), output=ALL)
    assert record.cycles.slip_increment[1:] == near(np.full((5, 2), 0.4 / k))
    assert record.steady.reached and record.steady.kind == "ratchetting"
    # friction takes what the push supplies: 0.5 times the advance
    assert record.cycles.dissipation[1:] == near([0.5 * 0.4 / k] * 5)


def sledge() -> ContactSystem:
    """Return two nodes joined by a spring, free to slide; a push of 1 shears them 0.8 to 0.2."""
    K = np.zeros((4, 4))
    K[:2, :2] = 3.0 * np.array([[1, -1], [-1, 1]])
    K[2:, 2:] = np.eye(2)
    loads = {"weight": [0, 0, 0.5, 0.5], "push": [-0.8, -0.2, 0, 0]}
    return small_system(K, loads, F, rigid=[[1.0, 1.0, 0.0, 0.0]])


@pytest.mark.parametrize("weight", [1.0, 250.0])
def test_a_free_body_slides_exactly_at_the_friction_of_its_weight(weight: float) -> None:
    top = 1.01 * F * weight
    with pytest.raises(NoEquilibrium, match="gross sliding") as caught:
        evolve(sledge(), table(sledge(), [[0, 0], [weight, 0], [weight, top]]))
    slides = [weight, pytest.approx(F * weight, rel=1e-8)]
    assert named_loads(caught.value, "weight", "push") == slides
    assert "\n" not in str(caught.value)


# -- the block ------------------------------------------------------------------------------------

SMALL = block_system(40, 20)


def test_reloading_after_complete_unloading_is_the_first_loading_again() -> None:
    record = evolve(SMALL, cyclic(3, minimum=0.0), output=ALL)
    s = record.samples
    first = np.flatnonzero(s.cycle == 0)
    for cycle in (1, 2, 3):
        again = np.flatnonzero((s.cycle == cycle) & (s.leg == 1))
        assert np.array_equal(s.state[again], s.state[first])
        for field in ("P", "Q", "v", "w"):
            a, b = getattr(s, field)[again], getattr(s, field)[first]
            assert np.abs(a - b).max() <= 1e-12 * np.abs(b).max(), field
        empty = record.turning_points.P[1 + 2 * (cycle - 1)]
        assert not empty.any()
    assert record.cycles.dissipation == pytest.approx([record.cycles.dissipation[0]] * 3, rel=1e-9)


def test_gauss_seidel_converges_to_the_exact_path() -> None:
    exact = evolve(SMALL, cyclic(1))
    steps = np.array([40, 80, 160, 320])
    error, force_error = [], []
    for n in steps.tolist():
        record = evolve(SMALL, cyclic(1), SolverOptions(method="gauss-seidel", steps_per_leg=n))
        error.append(abs(record.cycles.dissipation[0] / exact.cycles.dissipation[0] - 1.0))
        a, b = record.turning_points, exact.turning_points
        force_error.append(max(np.abs(a.P - b.P).max(), np.abs(a.Q - b.Q).max()) / b.P.max())
    slope = np.polyfit(np.log(steps), np.log(error), 1)[0]
    assert 0.9 <= -slope <= 2.1
    assert force_error[-1] < 1e-4


def test_a_thousand_cycles_keep_residual_and_energy() -> None:
    record = evolve(block_system(80, 40), cyclic(1000))
    assert 0.0 < record.residual_max <= 1e-10
    assert 0.0 < record.energy_error_max <= 1e-10
    assert record.steady.kind == "cyclic slip" and record.steady.period == 1
    D = record.cycles.dissipation
    # round-off neither drains nor feeds the steady cycle
    assert np.ptp(D[300:]) <= 1e-10 * D[0]
    assert np.all(np.diff(D[:60]) < 0.0)


@pytest.mark.parametrize("bend", [0.01, 0.2])
def test_a_whole_body_that_touches_at_one_node_first_is_that_of_its_half(bend: float) -> None:
    half, whole = block_system(24, 12), block_system(48, 12, half=False)
    found = [
        evolve(replace(body, g0=bend * body.x**2), cyclic(3, maximum=5.0)) for body in (half, whole)
    ]
    a, b = (record.turning_points for record in found)
    assert 0 < np.count_nonzero(a.state[0] == OPEN) < whole.n
    for field in ("P", "Q", "v", "w"):
        x, y = getattr(a, field), getattr(b, field)
        assert np.abs(x - y).max() <= 1e-9 * np.abs(y).max(), field
    assert found[1].residual_max <= 1e-11


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
    assert tilted.residual_max <= 1e-11 and tilted.energy_error_max <= 1e-10
    assert worst_violation(replace(body, g0=bend * (body.x - top) ** 2), tilted) <= 1e-9


def test_a_crowned_body_pressed_beside_its_top_is_what_load_steps_make_of_it() -> None:
    # without friction the answer knows no path
    body = block_system(24, 8, half=False, f=0.0)
    body = replace(body, g0=0.02 * (body.x - 1.0) ** 2)
    history = cyclic(1, maximum=2.0)
    steps = SolverOptions(method="gauss-seidel", steps_per_leg=2)
    a, b = (evolve(body, history, solver).turning_points for solver in (None, steps))
    assert np.abs(a.P - b.P).max() <= 1e-9 * a.P.max()
    states = np.where(body.g0 > 0.0, OPEN, STICK).astype(np.int8)
    laid = ContactState(np.zeros(2 * body.n), np.zeros(2 * body.n), states)
    rolled = at_rest(body, laid, np.ones(1))
    # the load's middle lies above a node: the body leans to neither side of it
    assert np.flatnonzero(rolled.state == STICK).tolist() == [int(np.argmin(np.abs(body.x)))]
    left, right = (body.g0 + rolled.w)[[11, 13]]
    assert left == near(right)


def test_a_crowned_body_pushed_over_its_end_is_refused() -> None:
    whole = block_system(24, 6, half=False)
    whole = replace(whole, g0=0.2 * whole.x**2)
    couple = np.zeros(2 * whole.n)
    couple[[whole.n, -1]] = -1.5, 1.5  # the resultant stands at 3, the body ends at 2
    pushed = replace(whole, r_star=whole.r_star + couple, load_compliance=np.zeros((0, 0)))
    with pytest.raises(NoEquilibrium, match="that touch first"):
        evolve(pushed, cyclic(1))


@pytest.mark.parametrize("poisson", [0.499, 0.4999])
def test_round_off_does_not_build_up_on_nearly_incompressible_bodies(poisson: float) -> None:
    system = block_system(64, 32, f=0.1, poisson=poisson)
    record = evolve(system, cyclic(3))
    end = record.at(cycle=3, load="maximum")
    u, force = np.concatenate([end.v[-system.n :], end.w[-system.n :]]), np.abs(end.P).max()
    # of some hundred round-offs of |K| |u| the largest are a few tens times as large as one
    assert record.residual_max <= 32.0 * round_off(system, u, force)
    assert record.energy_error_max <= 1e-10


def test_a_load_range_lost_in_round_off_is_refused() -> None:
    fine = evolve(SMALL, cyclic(3, 1.0 - 1e-6)).cycles.dissipation
    coarse = evolve(SMALL, cyclic(3, 1.0 - 1e-4)).cycles.dissipation
    # the change of load alone decides: small ranges dissipate in proportion
    assert fine == pytest.approx(1e-2 * coarse, rel=1e-3)
    with pytest.raises(SolveError, match="enlarge the load range"):
        evolve(SMALL, cyclic(3, 1.0 - 1e-8))
    with pytest.raises(SolveError, match="enlarge the load range"):
        evolve(eliminate_tangential(replace(SMALL, f=np.zeros(SMALL.n))), cyclic(3, 1.0 - 1e-8))


# -- random systems -------------------------------------------------------------------------------


def random_case(seed: int, margin: float, largest: int = 12) -> tuple[ContactSystem, History]:
    """Return a random system of 2 nodes at least, and a random polygon in its two loads."""
    rng = np.random.default_rng([seed, int(100 * margin)])
    system = random_system(seed, int(rng.integers(2, largest + 1)), margin)
    corner = [1.0, 0.0]
    others = [[rng.uniform(0.1, 1.5), rng.uniform(-1.0, 1.0)] for _ in range(rng.integers(1, 4))]
    return system, table(system, [[0.0, 0.0], corner], [corner, *others, corner], 3)


def test_every_random_system_below_the_margin_has_an_exact_path() -> None:
    events = 0
    for seed in range(80):
        system, history = random_case(seed, 0.49)
        record = evolve(system, history, output=replace(ALL, samples_per_leg=8))
        assert objections(system, history, record) == [], seed
        assert record.energy_error_max <= 1e-9, seed
        events += record.n_events
    assert events > 1500


def test_a_jump_is_stepped_over_where_that_is_asked_for() -> None:
    jumped = 0
    for seed in (16, 31, 53, 68, 110):
        system, history = random_case(seed, 5.0, largest=6)
        with pytest.raises(NoQuasiStaticContinuation):
            evolve(system, history)
        record = evolve(system, history, SolverOptions(on_jump="static"), ALL)
        assert record.jumps >= 1, seed
        assert objections(system, history, record) == [], seed
        # friction and the loads' work are whole with what the jumps release, which is never gained
        assert record.released > 0.0 and record.energy_error_max <= 1e-10, seed
        jumped += record.jumps
    assert jumped > 5


def test_jumps_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # a leg that jumps twice stands for one that jumps without end
    system, history = random_case(53, 5.0, largest=6)
    assert evolve(system, history, SolverOptions(on_jump="static")).jumps >= 2
    monkeypatch.setattr("receding_fenicsx.interface.exact.jumps.MAX_JUMPS", 1)
    said = r"^cycle 2, leg 0: .*jumps again at \w+ = 0\.4425\d*, \w+ = 0\.0816\d*;"
    with pytest.raises(NoQuasiStaticContinuation, match=said):
        evolve(system, history, SolverOptions(on_jump="static"))


def test_a_free_body_rests_at_a_point_repeated() -> None:
    once = evolve(SMALL, table(SMALL, [0.0, 1.0, 0.5]))
    twice = evolve(SMALL, table(SMALL, [0.0, 1.0, 1.0, 0.5, 0.5]))
    for field in ("P", "Q", "v", "w"):
        a, b = getattr(once.turning_points, field), getattr(twice.turning_points, field)
        for stood in ([0, 2], [1, 3]):
            assert np.abs(a - b[stood]).max() <= 1e-12 * np.abs(a).max(), field
    assert twice.dissipation_first_loading == near(once.dissipation_first_loading)


def test_a_body_that_has_slid_rests_without_load() -> None:
    pushed = pushed_block()
    there, rest = [1.0, 0.63], [0.0, 0.0]
    once = evolve(pushed, table(pushed, [rest, there, rest, [1.0, 0.0]]))
    twice = evolve(pushed, table(pushed, [rest, rest, there, rest, rest, [1.0, 0.0]]))
    assert np.array_equal(once.turning_points.P, twice.turning_points.P[[1, 2, 4]])
    assert np.array_equal(once.turning_points.v, twice.turning_points.v[[1, 2, 4]])
    assert twice.dissipation_first_loading == once.dissipation_first_loading


@pytest.mark.parametrize("pull", [0.1, -0.1])
def test_a_node_that_opened_without_tangential_force_slips_first_under_one(pull: float) -> None:
    # P = 1 - 2 s on the legs down: both margins vanish at s = 0.5 where Q = 0, and one does where
    # f P = |Q| = 0.1, at s = 0.4. The second node carries the body while the first is open
    loads = {"press": [0, 0, 1, 0], "pull": [-1, 0, 0, 0], "rest": [0, 0, 0, 1]}
    system = small_system(np.diag([2.0, 2.0, 1.0, 1.0]), loads, 0.5)
    path = [[0, 0, 0], [0, 0, 1], [1, 0, 1], [-1, 0, 1], [1, 0, 1], [1, pull, 1], [-1, pull, 1]]
    record = evolve(system, table(system, path))
    slip = FORWARD if pull > 0.0 else BACKWARD
    assert events_of(record, 0, 5) == [near((0.4, 0, STICK, slip)), near((0.5, 0, slip, OPEN))]
    assert record.energy_error_max < 1e-12
