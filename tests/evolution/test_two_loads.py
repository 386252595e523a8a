"""Histories in two loads, and contact nodes that supports hold, by independent means."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.plots.series import loop_of
from receding_fenicsx.scene.model import (
    Body,
    Contact,
    HistoryOptions,
    Load,
    Material,
    MeshOptions,
    OutputOptions,
    Scene,
    SolverOptions,
    Support,
)
from receding_fenicsx.studies.run import condense

pytestmark = pytest.mark.one_rank

F = 0.6
PRESS = Load("P", "top", platen=True, force=(0.0, -2.0))
SHEAR = Load("Q", "top", platen=True, force=(2.0 * F, 0.0))
DRIVE = Load("Q", "top", platen=True, displacement=(1.0, "free"))

Corners = tuple[tuple[float, ...], ...]

TO_AND_FRO: tuple[Corners, Corners] = (
    ((1.0, 0.0), (1.0, 0.9)),
    ((1.0, -0.9), (1.0, 0.9)),
)
POLYGON: tuple[Corners, Corners] = (
    ((1.0, 0.0), (1.0, 0.9)),
    ((0.7, 0.0), (1.0, -0.9), (1.4, 0.0), (1.0, 0.9)),
)
DRIVEN: tuple[Corners, Corners] = (
    ((1.0, 0.0), (1.0, 4.0)),
    ((0.8, 0.0), (1.0, -4.0), (1.3, 0.0), (1.0, 4.0)),
)
CASES = {
    "platen sheared to and fro": (SHEAR, TO_AND_FRO),
    "polygon of P and Q": (SHEAR, POLYGON),
    "polygon of P and a prescribed displacement": (DRIVE, DRIVEN),
}


def scene_of(case: str, cycles: int = 40, until: str | None = "steady") -> Scene:
    """A block, 2 by 1, between a plane and its platen."""
    shear, (rows, loop) = CASES[case]
    return Scene(
        body=Body(width=2.0, height=1.0),
        material=Material(1.0, 0.3),
        mesh=MeshOptions(24, "triangle", 2, 1.3),
        contacts=(Contact(friction=F),),
        loads=(PRESS, shear),
        history=HistoryOptions(
            kind="table",
            columns=("P", "Q"),
            rows=rows,
            cycle_rows=loop,
            cycles=cycles,
            until=until,
        ),
    )


@cache
def system_of(case: str) -> ContactSystem:
    system = condense(scene_of(case), MPI.COMM_SELF)
    assert system is not None
    return system


def evolved(scene: Scene, system: ContactSystem, samples: int = 20) -> Record:
    output = OutputOptions(samples_per_leg=samples)
    return evolve(system, replace(scene, output=output))


@pytest.mark.parametrize("case", CASES)
def test_loop_area_of_the_steady_cycle_is_its_dissipation(case: str) -> None:
    scene, system = scene_of(case), system_of(case)
    off = []
    for samples in (100, 400):
        record = evolved(scene, system, samples)
        assert record.steady.reached and record.steady.kind == "cyclic slip"
        assert record.energy_error_max < 1e-10
        D = record.cycles.dissipation[-1]
        assert D > 1e-3 * record.dissipation_first_loading
        off.append(loop_of(record, len(record.cycles.dissipation)).area().sum() / D - 1.0)
    assert abs(off[1]) < 1e-4
    assert abs(off[1]) < 0.2 * abs(off[0])


@pytest.mark.parametrize("case", CASES)
def test_load_steps_converge_to_the_exact_polygon(case: str) -> None:
    """Gauss-Seidel knows nothing of rates or events; its error falls with the step."""
    scene, system = scene_of(case, 2, None), system_of(case)
    exact = evolved(scene, system)
    off = []
    for steps in (20, 80):
        solver = SolverOptions(method="gauss-seidel", steps_per_leg=steps)
        found = evolved(replace(scene, solver=solver), system)
        p, q = (
            np.abs(getattr(found.turning_points, k) - getattr(exact.turning_points, k)).max()
            for k in "pq"
        )
        D = np.abs(found.cycles.dissipation / exact.cycles.dissipation - 1.0).max()
        off.append((D, p / exact.turning_points.p.max(), q / exact.turning_points.q.max()))
    coarse, fine = np.array(off)
    assert np.all(fine < 5e-3)
    assert np.all(fine < 0.5 * coarse)


def test_load_steps_converge_where_all_but_one_node_slip() -> None:
    """A polish with wrong states shifts the whole body; sweeps must not go on from there."""
    scene = replace(
        scene_of("platen sheared to and fro"),
        material=Material(1.0, 0.45),
        mesh=MeshOptions(16, "triangle", 1, 1.4),
        contacts=(Contact(friction=0.1),),
        loads=(Load("p", "top", (-0.5, 0.5), pressure=2.0),),
        history=HistoryOptions(kind="monotonic"),
    )
    steps = SolverOptions(method="gauss-seidel", symmetry="none", steps_per_leg=80, max_sweeps=500)
    scene = replace(scene, solver=steps)
    system = condense(scene, MPI.COMM_SELF)
    assert system is not None
    exactly = replace(scene, solver=SolverOptions(symmetry="none"))
    found, exact = evolved(scene, system), evolved(exactly, system)
    assert np.sum(exact.turning_points.state[0] == State.STICK) == 1
    P, Q = (
        np.abs(getattr(found.turning_points, k) - getattr(exact.turning_points, k)).max()
        for k in "PQ"
    )
    assert max(P, Q) < 1e-9


@pytest.mark.parametrize("case", CASES)
def test_shear_the_other_way_round_mirrors_the_answer(case: str) -> None:
    scene, system = scene_of(case, 3, None), system_of(case)
    rows, loop = CASES[case][1]
    turned = replace(
        scene.history,
        rows=tuple((P, -Q) for P, Q in rows),
        cycle_rows=tuple((P, -Q) for P, Q in loop),
    )
    a = evolved(scene, system)
    b = evolved(replace(scene, history=turned), system)
    for name, sign in (("p", 1.0), ("q", -1.0), ("v", -1.0), ("w", 1.0)):
        left, right = getattr(a.turning_points, name), getattr(b.turning_points, name)
        scale = max(np.abs(left).max(), 1e-300)
        assert np.abs(left - sign * right[:, ::-1]).max() < 1e-9 * scale, name
    assert b.cycles.dissipation == pytest.approx(a.cycles.dissipation, rel=1e-9)
    d, e = a.turning_points.load_displacement, b.turning_points.load_displacement
    assert np.abs(d * [1.0, -1.0] - e).max() < 1e-9 * np.abs(d).max()


def test_loads_in_proportion_are_one_load() -> None:
    """P and Q on a ray through zero, and the one load that is their sum there."""
    case = "polygon of P and Q"
    both = scene_of(case)
    both = replace(
        both,
        history=replace(
            both.history,
            rows=((1.0, 0.5),),
            cycle_rows=((0.4, 0.2), (1.0, 0.5)),
            cycles=3,
            until=None,
        ),
    )
    one = replace(
        both,
        loads=(replace(PRESS, name="R", force=(F, -2.0)),),
        history=HistoryOptions(kind="cyclic", minimum=0.4, cycles=3),
    )
    system = condense(one, MPI.COMM_SELF)
    assert system is not None
    a, b = evolved(both, system_of(case)), evolved(one, system)
    for name in ("p", "q", "v", "w"):
        x, y = getattr(a.turning_points, name), getattr(b.turning_points, name)
        assert np.abs(x - y).max() < 1e-9 * max(np.abs(y).max(), 1e-300), name
    assert a.cycles.dissipation == pytest.approx(b.cycles.dissipation, rel=1e-9)
    conjugate = a.turning_points.load_displacement @ [1.0, 0.5]
    assert conjugate == pytest.approx(b.turning_points.load_displacement[:, 0], rel=1e-9)


def test_pressure_and_shear_out_of_phase_make_the_block_walk() -> None:
    """Low pressure on the way back, high on the way forth: rigid steps, turned by the direction."""
    scene = scene_of("polygon of P and Q", 4, None)
    scene = replace(scene, material=Material(1.0, 0.0), mesh=MeshOptions(8, "triangle", 2, 1.3))
    loop = ((0.4, 0.0), (1.0, -0.98), (2.0, 0.0), (1.0, 0.98))
    back = (*loop[2::-1], loop[3])
    system = condense(scene, MPI.COMM_SELF)
    assert system is not None
    steps = []
    for corners, solver in (
        (loop, SolverOptions()),
        (back, SolverOptions()),
        (loop, SolverOptions(method="gauss-seidel", steps_per_leg=160)),
    ):
        history = replace(scene.history, rows=((1.0, 0.0), (1.0, 0.98)), cycle_rows=corners)
        record = evolved(replace(scene, history=history, solver=solver), system)
        # also of nodes that are open at the ends of the cycle
        step = record.turning_points.v[-1] - record.turning_points.v[-5]
        assert np.ptp(step) < 1e-9 * np.ptp(record.turning_points.v)
        steps.append(step.mean())
    assert record.steady.kind == "ratchetting"
    assert steps[0] < -1e-4 * np.ptp(record.turning_points.v)
    assert steps[1] == pytest.approx(-steps[0], rel=1e-9)
    assert steps[2] == pytest.approx(steps[0], rel=0.05)


def test_round_off_in_the_first_cycle_is_no_cyclic_slip() -> None:
    """Sheared back by half, the block sticks from cycle 1 on: shakedown."""
    scene = scene_of("platen sheared to and fro")
    back = replace(scene.history, cycle_rows=((1.0, 0.2), (1.0, 0.9)), cycles=4)
    record = evolved(replace(scene, history=back), system_of("platen sheared to and fro"))
    assert record.cycles.dissipation.max() < 1e-12 * record.dissipation_first_loading
    assert record.steady.kind == "shakedown"


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_block_dragged_by_its_platen_slides_under_exactly_the_friction_force(method: str) -> None:
    """What force control cannot pass: |F| = f P, and every node moves as the platen does."""
    reach, far = 8.0, 0.5
    scene = scene_of("polygon of P and a prescribed displacement", 2, None)
    history = replace(
        scene.history,
        rows=((1.0, 0.0), (1.0, reach)),
        cycle_rows=((1.0, -reach), (1.0, reach)),
    )
    solver = SolverOptions(method=method, steps_per_leg=40)
    scene = replace(scene, history=history, solver=solver)
    system = system_of("polygon of P and a prescribed displacement")
    record = evolved(scene, system, 40)
    force = 2.0 * F
    table, samples = record.turning_points, record.samples
    assert np.abs(table.load_displacement[1:, 1]) == pytest.approx(force, rel=1e-10)
    late = (samples.cycle == 2) & (samples.s > far)
    assert np.abs(samples.load_displacement[late, 1]) == pytest.approx(force, rel=1e-10)
    assert np.abs(samples.Q[late].sum(axis=1)) == pytest.approx(force, rel=1e-10)
    here = samples.cycle == 2
    v, d = (x[here & (samples.leg == 1) & (samples.s > far)] for x in (samples.v, samples.load))
    assert np.diff(v, axis=0) == pytest.approx(
        np.repeat(np.diff(d[:, 1])[:, None], v.shape[1], axis=1), rel=1e-8
    )


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_top_that_is_lifted_takes_no_force_and_may_come_down_again(
    friction: float, method: str
) -> None:
    """A prescribed displacement holds the open block; without friction the force is E' d w / h."""
    scene = Scene(
        material=Material(2.0, 0.3),
        mesh=MeshOptions(16, "triangle", 2, 1.3),
        contacts=(Contact(friction=friction),),
        loads=(Load("d", "top", displacement=("free", -1.0)),),
        history=HistoryOptions(
            kind="table", columns=("d",), rows=((0.1,), (-0.1,), (0.2,)), cycles=1
        ),
        solver=SolverOptions(method=method, steps_per_leg=20),
    )
    system = condense(scene, MPI.COMM_SELF)
    assert system is not None and system.kind == ("frictional" if friction else "normal")
    table = evolved(scene, system).turning_points
    force, pressed = table.load_displacement[:, 0], table.P.sum(axis=1)
    assert np.abs(force - pressed).max() < 1e-12
    assert abs(force[1]) < 1e-12 and table.w[1] == pytest.approx(0.1, abs=1e-12)
    if friction == 0.0:
        assert force[[0, 2]] == pytest.approx(2.0 / (1.0 - 0.3**2) * 4.0 * np.array([0.1, 0.2]))
    else:
        assert np.all(force[[0, 2]] > 2.0 / (1.0 - 0.3**2) * 4.0 * np.array([0.1, 0.2]))


CYCLIC = HistoryOptions(kind="cyclic", minimum=0.2, cycles=3)
WHOLE = Scene(
    mesh=MeshOptions(16, "quadrilateral", 2, 1.0),
    loads=(Load("p0", "top", (-1.0, 1.0), pressure=1.0),),
    history=CYCLIC,
)


def test_rollers_on_one_side_are_the_half_of_a_symmetric_block() -> None:
    """Rollers hold the last contact node as symmetry does; the meshes are the same."""
    rollers = replace(
        WHOLE,
        body=Body(width=2.0, height=1.0),
        mesh=replace(WHOLE.mesh, contact_elements=8),
        loads=(Load("p0", "top", (-1.0, 0.0), pressure=1.0),),
        supports=(Support("x", edge="left"),),
    )
    records = []
    for scene in (WHOLE, rollers):
        system = condense(scene, MPI.COMM_SELF)
        assert system is not None and np.flatnonzero(system.held).tolist() == [0]
        records.append(evolved(scene, system))
    whole, half = records
    right = whole.x > 0.0
    for name in ("P", "Q", "v", "w", "state"):
        a = getattr(whole.turning_points, name)[:, right]
        b = getattr(half.turning_points, name)[:, 1:]
        assert np.abs(a - b).max() < 1e-12, name
    assert half.cycles.dissipation * 2.0 == pytest.approx(whole.cycles.dissipation, rel=1e-11)


@pytest.mark.parametrize(
    ("support", "held"),
    [
        (Support("x", point=(2.0, 0.0)), [32]),
        (Support("y", point=(2.0, 0.0)), [65]),
        (Support("y", point=(0.25, 0.0)), [51]),
        (Support("xy", point=(0.5, 0.0)), [20, 53]),
        (Support("xy", edge="right"), [32, 65]),
    ],
)
def test_held_contact_nodes_by_two_methods(support: Support, held: list[int]) -> None:
    """A node held normally carries no friction, one held tangentially never slips."""
    scene = replace(WHOLE, supports=(support,), history=replace(CYCLIC, cycles=1))
    system = condense(scene, MPI.COMM_SELF)
    assert system is not None and np.flatnonzero(system.held).tolist() == held
    exact = evolved(scene, system)
    table, density = exact.turning_points, exact.cycles.dissipation_density
    for dof in held:
        node = dof % 33
        assert np.abs((table.v if dof < 33 else table.w)[:, node]).max() == 0.0
        assert np.abs(density[:, node]).max() < 1e-15
        if dof >= 33 and node not in held:
            assert np.abs(table.Q[:, node]).max() < 1e-13
            assert np.abs(table.v[-1, node]) > 1e-3
    solver = SolverOptions(method="gauss-seidel", steps_per_leg=80)
    steps = evolved(replace(scene, solver=solver), system)
    assert steps.cycles.dissipation == pytest.approx(exact.cycles.dissipation, rel=1e-3)
    largest = np.abs(table.P).max()
    assert np.abs(steps.turning_points.P - table.P).max() < 1e-3 * largest
    assert np.abs(steps.turning_points.Q - table.Q).max() < 1e-3 * largest
