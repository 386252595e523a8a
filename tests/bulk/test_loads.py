"""Loads on curved edges of .geo files: resultants of the true curve, not of its chords."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.mesh.user_mesh import gmsh_model
from receding_fenicsx.timing import Timer

comm = MPI.COMM_WORLD

ARCH = """
Point(1) = {-2, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 2, 0}; Point(4) = {-2, 2, 0};
Point(5) = {0, 2, 0}; Point(6) = {1, 2, 0};
Line(1) = {1, 2}; Line(3) = {4, 1}; Line(4) = {2, 3};
%s
Curve Loop(1) = {1, 4, roof(), 3}; Plane Surface(1) = {1};
Physical Curve("foot") = {1}; Physical Curve("roof") = {roof()}; Physical Surface("body") = {1};
Mesh.MeshSizeMax = 0.5;
"""
ROOFS = {
    "circle": "Circle(2) = {3, 5, 4}; roof() = {2};",
    "ellipse": "Point(7) = {0, 3, 0}; Ellipse(2) = {3, 5, 3, 7}; Ellipse(5) = {7, 5, 3, 4};"
    "roof() = {2, 5};",
}


def arch(path: Path, text: str, load: rf.Load, kinematics: str = "plane strain") -> rf.Scene:
    """A body on a straight foot below a curved roof that carries a load."""
    rf.on_root(comm, lambda: path.write_text(text))
    comm.barrier()
    return rf.Scene(
        body=rf.Body(mesh=str(path)),
        material=rf.Material(1.0, 0.3, kinematics),
        mesh=rf.MeshOptions(8, "triangle", 1, 1.3),
        contacts=(rf.Contact("foot"),),
        loads=(load,),
    )


def forces(scene: rf.Scene) -> Array:
    """Nodal forces (n, 2) of the first load, and the places (n, 2) of their nodes, side by side."""
    (bulk,) = bulk_of(scene, comm, Timer()).parts
    assert isinstance(bulk, Bulk)
    force = bulk.loads[:, 0].reshape(-1, 2)
    places = bulk.space.tabulate_dof_coordinates()[: len(force), :2]
    bulk.destroy()
    return np.vstack(comm.allgather(np.hstack([force, places])))


@pytest.mark.parametrize("kind", ROOFS)
@pytest.mark.parametrize("degree", [1, 2])
def test_pressure_x_on_any_curve_has_the_resultant_of_gauss_theorem(
    kind: str, degree: int, shared_tmp_path: Path
) -> None:
    """-integral of x n over the roof, by the divergence over what it closes with its chord.

    With y = 2 along the chord: the x component is -(area above y = 2), the y component 0 less
    the chord's -integral of x dx = 0 from end to end, whatever the curve.
    """
    scene = arch(shared_tmp_path / "a.geo", ARCH % ROOFS[kind], rf.Load("p", "roof", pressure="x"))
    found = forces(replace(scene, mesh=replace(scene.mesh, degree=degree)))
    assert found[:, 1].sum() == pytest.approx(0.0, abs=1e-11)
    area = {"circle": 2.0 * np.pi, "ellipse": np.pi}[kind]
    assert found[:, 0].sum() == pytest.approx(-area, rel=1e-10)


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
def test_uniform_pressure_is_left_as_it_is_on_the_chords(
    kinematics: str, shared_tmp_path: Path
) -> None:
    """A polygon under hydrostatic pressure needs the forces of its own sides, at every node."""
    text = ARCH % ROOFS["circle"] if kinematics == "plane strain" else BALL
    pressure = rf.Load("p", "roof", pressure=1.0)
    scene = arch(shared_tmp_path / "body.geo", text, pressure, kinematics)
    true, chords = forces(scene), forces(saved(scene, shared_tmp_path / "body.msh"))
    assert np.abs(ordered(true) - ordered(chords)).max() < 1e-13


BALL = """
Point(1) = {0, 0, 0}; Point(2) = {3, 0, 0}; Point(3) = {0, 3, 0};
Line(1) = {1, 2}; Circle(2) = {2, 1, 3}; Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};
Physical Curve("foot") = {1}; Physical Curve("roof") = {2}; Physical Surface("body") = {1};
Mesh.MeshSizeMax = 0.7;
"""


def saved(scene: rf.Scene, path: Path) -> rf.Scene:
    """The scene on the mesh of its .geo file, of which nothing but the chords is known."""

    def write() -> None:
        with gmsh_model() as gmsh:
            gmsh.merge(str(scene.body.mesh))
            gmsh.model.mesh.generate(2)
            gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
            gmsh.write(str(path))

    rf.on_root(comm, write)
    comm.barrier()
    return replace(scene, body=rf.Body(mesh=str(path)))


def ordered(found: Array) -> Array:
    """Rows of forces by their places."""
    loaded = found[np.abs(found[:, :2]).max(axis=1) > 0.0]
    return np.asarray(loaded[np.lexsort(np.round(loaded[:, 2:], 9).T)])


@pytest.mark.parametrize("degree", [1, 2])
def test_traction_along_the_axis_on_a_ball_counts_its_true_area(
    degree: int, shared_tmp_path: Path
) -> None:
    """A hemisphere of radius 3 has the area 18 pi; its chords fall short by the square of h."""
    load = rf.Load("t", "roof", traction=(0.0, -1.0))
    scene = arch(shared_tmp_path / "ball.geo", BALL, load, "axisymmetric")
    scene = replace(scene, mesh=replace(scene.mesh, degree=degree))
    resultant = -2.0 * np.pi * forces(scene)[:, 1].sum()
    assert resultant == pytest.approx(18.0 * np.pi, rel=1e-12)
    chords = -2.0 * np.pi * forces(saved(scene, shared_tmp_path / "ball.msh"))[:, 1].sum()
    assert 1e-3 < 1.0 - chords / (18.0 * np.pi) < 1e-2


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_closed_curve_in_a_scaled_file_has_its_own_length_and_area(
    scale: float, shared_tmp_path: Path
) -> None:
    """A bore as one closed circle, which begins and ends at the same point."""
    text = f"""
SetFactory("OpenCASCADE");
Rectangle(1) = {{-2, 0, 0, 4, 4}}; Disk(2) = {{0.3, 2, 0, 1}};
BooleanDifference(3) = {{ Surface{{1}}; Delete; }}{{ Surface{{2}}; Delete; }};
Physical Curve("roof") = {{Curve In BoundingBox{{-0.8, 0.9, -1, 1.4, 3.1, 1}}}};
Physical Curve("foot") = {{Curve In BoundingBox{{-2.1, -0.1, -1, 2.1, 0.1, 1}}}};
Physical Surface("body") = {{3}};
Mesh.MeshSizeMax = 0.5; Mesh.ScalingFactor = {scale};
"""
    for load, expected in (
        (rf.Load("p", "roof", pressure="x"), (np.pi * scale**2, 0.0)),
        (rf.Load("t", "roof", traction=(0.0, 1.0)), (0.0, 2.0 * np.pi * scale)),
    ):
        scene = arch(shared_tmp_path / "bore.geo", text, load)
        assert forces(scene)[:, :2].sum(axis=0) == pytest.approx(expected, abs=1e-10)


WHEEL = rf.Load("wheel", "top", (-0.5, 0.5), pressure=1.0, travel=(-1.0, 1.0), steps=4)
TRAVEL = rf.HistoryOptions(kind="travel", cycles=2, constant={"weight": 1.0})


def strip(*wheels: rf.Load, **parts: Any) -> rf.Scene:
    scene = block(
        degree=2,
        contacts=(rf.Contact(friction=0.2),),
        loads=(rf.Load("weight", body_force=(0.0, -0.05)), *wheels),
        history=TRAVEL,
    )
    return replace(scene, **parts)


TABLE = {"x": [-0.5, 0.1, 0.5], "value": [1.0, 2.0, 0.0]}


@pytest.mark.parametrize(
    ("pressure", "size", "middle"),
    [
        (1.0, 1.0, 0.0),
        ("1 + 0.4*x", 1.0, 0.4 / 12.0),
        (TABLE, 1.3, (0.9 * (-0.5 + 0.6 * 5.0 / 9.0) + 0.4 * (0.1 + 0.4 / 3.0)) / 1.3),
    ],
)
def test_unit_loads_have_resultant_and_moment_of_the_load_at_their_positions(
    pressure: Any, size: float, middle: float
) -> None:
    """Wherever their ends and the kinks of a table lie between the vertices."""
    wheel = replace(WHEEL, pressure=pressure, travel=(-1.0, 1.13), steps=7)
    rests = rf.Load("rests", "top", WHEEL.span, pressure=pressure)
    history = replace(TRAVEL, constant={"weight": 1.0, "rests": 1.0})
    system = rf.condense(strip(wheel, rests, history=history), comm)
    if system is None:
        return
    assert system.load_names == ("weight", *(f"wheel {k}" for k in range(8)), "rests")
    for k, s in enumerate([*np.linspace(-1.0, 1.13, 8), 0.0]):
        tangential, normal = np.split(system.r_star[1 + k], 2)
        assert normal.sum() == pytest.approx(size, rel=1e-12)
        assert tangential.sum() == pytest.approx(0.0, abs=1e-12)
        assert normal @ system.x == pytest.approx(size * (s + middle), abs=1e-12)


@pytest.mark.one_rank
def test_loads_are_put_on_travel_and_are_taken_off() -> None:
    drag = rf.Load(
        "wheel", "top", (-0.5, 0.5), traction=(0.1, 0.0), travel=(-1.0, 1.0, 0.0), steps=3
    )
    wheel = replace(WHEEL, travel=drag.travel, steps=3)
    scene = strip(wheel, drag)
    history = rf.history_from_scene(scene)
    assert history.load_names == ("weight", *(f"wheel {k}" for k in range(4)))
    hats = np.vstack([np.zeros(4), np.eye(4), np.zeros(4)])
    assert np.array_equal(history.loop, np.column_stack([np.ones(6), hats]))
    assert [unit.travel for unit in wheel.units] == [(-1.0,), (0.0,), (1.0,), (0.0,)]
    assert np.array_equal(history.path[1:], history.loop) and not history.path[0].any()
    assert rf.from_toml(rf.to_toml(scene)) == scene
    both = rf.history_from_scene(strip(wheel, drag, replace(drag, name="side")))
    assert np.array_equal(both.loop, np.column_stack([history.loop, hats]))
    # a uniform pressure over 1: (2 sqrt(1e-3))^2 / 4 = 1e-3
    assert len(replace(WHEEL, steps=None).units) == 1 + 32
