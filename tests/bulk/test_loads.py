"""Loads on curved edges of .geo files: resultants of the true curve, not of its chords."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.mesh.gmsh_model import gmsh_model
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Body, Contact, Load, Material, MeshOptions, Scene
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
    "spline": "Point(7) = {1, 2.8, 0}; Point(8) = {-0.7, 2.4, 0}; Spline(2) = {3, 7, 8, 4};"
    "roof() = {2};",
    "nurbs": "Point(7) = {1, 3.2, 0}; Point(8) = {-1, 2.2, 0}; BSpline(2) = {3, 7, 8, 4};"
    "roof() = {2};",
}
NEAR = {"spline": 1e-8}
"""Gauss's rule across the knots of a spline."""


def arch(path: Path, text: str, load: Load, kinematics: str = "plane strain") -> Scene:
    """A body on a straight foot below a curved roof that carries a load."""
    on_root(comm, lambda: path.write_text(text))
    comm.barrier()
    return Scene(
        body=Body(mesh=str(path)),
        material=Material(1.0, 0.3, kinematics),
        mesh=MeshOptions(8, "triangle", 1, 1.3),
        contacts=(Contact("foot"),),
        loads=(load,),
    )


def forces(scene: Scene) -> Array:
    """Nodal forces (n, 2) of the first load, and the places (n, 2) of their nodes, side by side."""
    (bulk,) = bulk_of(scene, comm, Timer()).parts
    assert isinstance(bulk, Bulk)
    force = bulk.loads[0].getArray(readonly=True).reshape(-1, 2).copy()
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
    scene = arch(shared_tmp_path / "arch.geo", ARCH % ROOFS[kind], Load("p", "roof", pressure="x"))
    found = forces(replace(scene, mesh=replace(scene.mesh, degree=degree)))
    near = NEAR.get(kind, 1e-11)
    assert found[:, 1].sum() == pytest.approx(0.0, abs=near)
    assert found[:, 0].sum() == pytest.approx(-area_above(kind), rel=10.0 * near)


def area_above(kind: str) -> float:
    """Area between the roof and y = 2: closed, or from many points of gmsh's curve (order 4)."""
    closed = {"circle": 2.0 * np.pi, "ellipse": np.pi}
    if kind in closed:
        return closed[kind]
    with gmsh_model() as gmsh:
        for i, (x, y) in enumerate([(2.0, 2.0), (-2.0, 2.0)], start=3):
            gmsh.model.geo.addPoint(x, y, 0.0, tag=i)
        inner = {"spline": [(1.0, 2.8), (-0.7, 2.4)], "nurbs": [(1.0, 3.2), (-1.0, 2.2)]}[kind]
        for i, (x, y) in enumerate(inner, start=7):
            gmsh.model.geo.addPoint(x, y, 0.0, tag=i)
        add = gmsh.model.geo.addSpline if kind == "spline" else gmsh.model.geo.addBSpline
        add([3, 7, 8, 4], 2)
        gmsh.model.geo.synchronize()
        low, high = (float(bound[0]) for bound in gmsh.model.getParametrizationBounds(1, 2))

        def area(n: int) -> float:
            u = np.linspace(low, high, n + 1)
            x, y, _ = np.array(gmsh.model.getValue(1, 2, u.tolist())).reshape(-1, 3).T
            return float(-np.sum(0.5 * (y[1:] + y[:-1] - 4.0) * np.diff(x)))

        coarse, fine = area(3000), area(6000)
    return fine + (fine - coarse) / 3.0


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
def test_uniform_pressure_is_left_as_it_is_on_the_chords(
    kinematics: str, shared_tmp_path: Path
) -> None:
    """A polygon under hydrostatic pressure needs the forces of its own sides, at every node."""
    text = ARCH % ROOFS["circle"] if kinematics == "plane strain" else BALL
    pressure = Load("p", "roof", pressure=1.0)
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


def saved(scene: Scene, path: Path) -> Scene:
    """The scene on the mesh of its .geo file, of which nothing but the chords is known."""

    def write() -> None:
        with gmsh_model() as gmsh:
            gmsh.merge(str(scene.body.mesh))
            gmsh.model.mesh.generate(2)
            gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
            gmsh.write(str(path))

    on_root(comm, write)
    comm.barrier()
    return replace(scene, body=Body(mesh=str(path)))


def ordered(found: Array) -> Array:
    """Rows of forces by their places."""
    loaded = found[np.abs(found[:, :2]).max(axis=1) > 0.0]
    return np.asarray(loaded[np.lexsort(np.round(loaded[:, 2:], 9).T)])


@pytest.mark.parametrize("degree", [1, 2])
def test_traction_along_the_axis_on_a_ball_counts_its_true_area(
    degree: int, shared_tmp_path: Path
) -> None:
    """A hemisphere of radius 3 has the area 18 pi; its chords fall short by the square of h."""
    load = Load("t", "roof", traction=(0.0, -1.0))
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
        (Load("p", "roof", pressure="x"), (np.pi * scale**2, 0.0)),
        (Load("t", "roof", traction=(0.0, 1.0)), (0.0, 2.0 * np.pi * scale)),
    ):
        scene = arch(shared_tmp_path / "bore.geo", text, load)
        assert forces(scene)[:, :2].sum(axis=0) == pytest.approx(expected, abs=1e-10)
