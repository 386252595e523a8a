"""Two elastic bodies in contact, against one body, one mesh, and an independent assembly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import condense

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.bulk.fields import _together as together
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.stack import Stack, build_all
from receding_fenicsx.studies.run import condense as condense_scene

comm = MPI.COMM_WORLD


def pair_scene(
    cell: str = "triangle",
    degree: int = 1,
    young: float = 3.0,
    poisson: float = 0.2,
    **parts: object,
) -> rf.Scene:
    """A block of 4 by 1 on one of 8 by 2 that stands on a support."""
    scene = rf.Scene(
        body=rf.Body("upper", width=4.0, position=(0.0, 2.0)),
        others=(rf.Body("lower", width=8.0, height=2.0),),
        material=rf.Material(2.0, 0.3),
        materials=(rf.Material(young, poisson, name="lower"),),
        mesh=rf.MeshOptions(contact_elements=12, cell=cell, degree=degree, growth=1.3),
        contacts=(rf.Contact("upper.bottom", against="lower.top"),),
        loads=(rf.Load("p0", "upper.top", (-1.0, 1.0), pressure=1.0),),
        supports=(rf.Support("xy", edge="lower.bottom"),),
        history=rf.HistoryOptions(cycles=2),
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


def built(scene: rf.Scene, half: bool = False) -> Stack:
    pair = build_all(scene, make_meshes(comm, scene, half))
    assert isinstance(pair, Stack)
    return pair


def system_of(scene: rf.Scene, half: bool = False) -> rf.ContactSystem | None:
    rf.validate(scene)
    pair = built(scene, half)
    system = condense(pair)
    pair.destroy()
    return system


def record_of(scene: rf.Scene) -> rf.Record | None:
    system = condense_scene(scene, comm)
    if system is None:
        return rf.on_root(comm, lambda: None)
    return rf.on_root(comm, lambda: rf.evolve(system, scene))


# -- against one body ----------------------------------------------------------------------------


@pytest.mark.parametrize("symmetry", ["auto", "none", "axis"])
@pytest.mark.parametrize("friction", [0.0, 0.35])
def test_mirrored_bodies_and_loads_are_one_body_on_a_frictionless_plane(
    symmetry: str, friction: float
) -> None:
    round_axis = symmetry == "axis"
    load = rf.Load("p0", "top", (0.0 if round_axis else -1.0, 1.0), pressure=1.0)
    one = rf.Scene(
        material=rf.Material(kinematics="axisymmetric" if round_axis else "plane strain"),
        mesh=rf.MeshOptions(contact_elements=16),
        contacts=(rf.Contact(friction=0.0),),
        loads=(load,),
        history=rf.HistoryOptions(cycles=2),
        solver=rf.SolverOptions(symmetry="auto" if round_axis else symmetry),
    )
    two = replace(
        one,
        body=rf.Body("a"),
        others=(rf.Body("b", position=(0.0, -1.0)),),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=friction),),
        # parts of one load: nothing but their balance holds the bodies
        loads=(replace(load, edge="a.top"), replace(load, edge="b.bottom")),
    )
    single, double = record_of(one), record_of(two)
    if single is not None and double is not None:
        a, b = single.turning_points, double.turning_points
        scale = np.abs(a.P).max()
        assert np.abs(a.P - b.P).max() < 1e-11 * scale
        assert np.abs(b.Q).max() < 1e-11 * scale
        assert np.array_equal(a.state == rf.State.SEPARATION, b.state == rf.State.SEPARATION)
        gap = np.abs(a.w).max()
        assert np.abs(2.0 * a.w - b.w).max() < 1e-10 * gap
        assert b.load_displacement == pytest.approx(2.0 * a.load_displacement, rel=1e-10)


@pytest.mark.parametrize("young", [1e-9, 1e-18])
def test_ratio_of_moduli_that_costs_too_many_figures_is_said(young: float) -> None:
    scene = pair_scene(young=young, supports=(rf.Support("xy", edge="lower.bottom"),))
    with pytest.raises(rf.SolveError, match="moduli closer together"):
        system_of(scene)


# -- against one mesh ----------------------------------------------------------------------------


def test_quadrilaterals_beside_triangles_are_split_and_keep_their_area() -> None:
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [0.0, 1.0]])
    none, stress = np.zeros((4, 2)), {"sxx": np.arange(4.0)}
    quad = Fields(corners, np.array([[0, 1, 2, 3]]), none, stress)
    triangle = Fields(corners[:3] + 5.0, np.array([[0, 1, 2]]), none[:3], {"sxx": np.ones(3)})
    for first, second in ((quad, triangle), (triangle, quad)):
        both = together([first, second])
        a, b, c = both.points[both.cells].transpose(1, 2, 0)
        area = 0.5 * ((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
        # counterclockwise all, those of the square and of the triangle
        assert np.all(area > 0.0) and area.sum() == pytest.approx(2.5 + 1.0)
        assert both.body is not None
        assert np.array_equal(both.body, np.repeat([0, 1], [len(first.points), len(second.points)]))
        assert np.all(both.points[both.body == 1] == second.points)


# -- histories -----------------------------------------------------------------------------------


def test_two_surfaces_of_one_file_balance_the_pull_on_their_oblique_pads() -> None:
    demo = Path(__file__).parents[2] / "demos" / "dovetail.toml"
    record = record_of(rf.read_scene(demo, ["mesh.contact_elements=8", "history.cycles=1"]))
    if record is None:
        return
    table, total = record.turning_points, np.zeros((3, 2))
    for pad in record.by_edge().values():
        t = (pad.points[-1] - pad.points[0]) / np.ptp(pad.x)
        n = np.array([-t[1], t[0]])
        assert np.abs(np.abs(t) - np.sqrt(0.5)).max() < 1e-12 and n[1] < 0.0
        states = pad.turning_points
        total += states.P.sum(axis=1)[:, None] * n + states.Q.sum(axis=1)[:, None] * t
    assert total == pytest.approx(np.outer(table.load[:, 0], [0.0, -1.0]), abs=1e-9)


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"supports": ()}, "load 'p0' moves both bodies together, and nothing holds them"),
        ({"contacts": (rf.Contact("upper.bottom"),)}, "body 'lower': touches nothing; name one of"),
        (
            {"body": rf.Body("upper", position=(0.0, 2.5))},
            "do not lie on each other, but 0.5 apart",
        ),
        ({"body": rf.Body("upper", position=(6.0, 2.0))}, "do not overlap"),
        (
            {"body": rf.Body("upper", position=(2.1, 2.0)), "mesh": rf.MeshOptions(11 * 2)},
            "ends inside a facet of the other one at",
        ),
        (
            {"supports": (rf.Support("xy", edge="lower.top"),)},
            "'lower.top' lies on the contact edge",
        ),
    ],
)
def test_pairs_that_cannot_be_modelled_are_refused(change: dict, words: str) -> None:
    with pytest.raises(rf.InputError) as caught:
        system_of(pair_scene(**change))
    assert words in str(caught.value)
    assert len(set(comm.allgather(str(caught.value)))) == 1
