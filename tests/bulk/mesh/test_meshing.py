"""The body's mesh: where its nodes lie, its symmetry, its groups, its messages."""

import logging
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from bodies import ROUND, block, everything, make_mesh

import receding_fenicsx as rf
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.mesh.grading import size_callback
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.mesh.user_mesh import read_user_meshes
from receding_fenicsx.timing import Timer

comm = MPI.COMM_WORLD


@pytest.mark.parametrize(
    ("loads", "ends"),
    [
        ((), [(2.0, 1.0)]),
        ((rf.Load("a", "top", (-1.0, 1.0), pressure=1.0),), [(1.0, 1.0), (2.0, 1.0)]),
        # of a cylinder, on whose axis nothing ends
        ((rf.Load("a", "top", (0.0, 1.0), pressure=1.0),), [(1.0, 1.0), (2.0, 1.0)]),
        (
            (
                rf.Load("a", "top", (-1.2, 0.3), pressure=1.0),
                rf.Load("b", "right", (-0.1, 0.5), pressure=1.0),
            ),
            [(1.2, 1.0), (0.3, 1.0), (2.0, 0.4), (2.0, 1.0)],
        ),
    ],
)
def test_triangles_grow_from_contact_places_and_ends_of_loads_and_supports(
    loads: tuple[rf.Load, ...], ends: list[tuple[float, float]]
) -> None:
    held = block(elements=80, growth=1.25, loads=loads, supports=(rf.Support("x", "right"),))
    round_ = any(load.span == (0.0, 1.0) for load in loads)
    held = replace(held, material=ROUND if round_ else held.material)
    for places in (None, (rf.Refinement(0.02, (-0.7, -0.3)),)):
        scene = replace(held, mesh=replace(held.mesh, refine=places))
        points, cells = everything(make_mesh(comm, scene, True))
        corners = points[cells]
        sides = np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), 2, 0))
        x, y = corners.mean(axis=1).T
        far = [np.hypot(x - end[0], y - end[1]) for end in ends]
        asked = 4.0 / 80 + 0.25 * np.min([y, *far], axis=0)
        if places:
            beside = np.maximum(np.abs(x - 0.5) - 0.2, 0.0)
            asked = np.minimum(asked, 0.02 + 0.25 * np.hypot(beside, y))
        ratio = sides.mean(axis=1) / asked
        assert 0.5 < ratio.min() and ratio.max() < 1.6
        assert np.median(ratio) == pytest.approx(1.0, abs=0.15)


def test_sizes_grow_with_the_distance_from_a_range_of_any_direction() -> None:
    ends = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 2))
    size = size_callback([(rf.Refinement(0.1, growth=1.5), *ends)])
    line = ends[0] + np.linspace(0.0, 1.0, 20001)[:, None] * (ends[1] - ends[0])
    for x, y in np.random.default_rng(2).uniform(-2.0, 2.0, (20, 2)):
        known = 0.1 + 0.5 * np.hypot(*(line - [x, y]).T).min()
        assert size(2, 1, x, y, 0.0, 0.9) == pytest.approx(min(known, 0.9), abs=1e-6)


def test_layers_of_quadrilaterals_shrink_towards_contacts_and_ends_of_loads() -> None:
    loads = (
        rf.Load("a", "top", (-1.0, 1.0), pressure=1.0),
        rf.Load("b", "right", (0.1, 0.3), pressure=1.0),
    )
    scene = block("quadrilateral", elements=160, growth=1.3, loads=loads)
    stacked = replace(
        scene,
        body=rf.Body("a"),
        others=(rf.Body("b", position=(0.0, 1.0)),),
        contacts=(rf.Contact("a.bottom"), rf.Contact("b.bottom", against="a.top")),
        loads=(rf.Load("c", "b.top", pressure=1.0),),
    )
    for each, ends in ((scene, (0.0, 0.6, 0.8, 1.0)), (stacked, (0.0, 1.0))):
        points, _ = everything(make_meshes(comm, each, True)[0])
        levels = np.unique(points[:, 1])
        heights, middle = np.diff(levels), 0.5 * (levels[1:] + levels[:-1])
        distance = np.min([np.abs(middle - at) for at in ends], axis=0)
        ratio = heights / (4.0 / 160 + 0.3 * distance)
        assert 0.75 < ratio.min() and ratio.max() < 1.33


@pytest.mark.parametrize("half", [False, True])
def test_vertices_lie_at_ends_of_spans_and_at_points(half: bool) -> None:
    """To the bit: gmsh gets numbers of twelve figures."""
    third = 1.0 / 3.0
    wanted = [(0.77, 1.0), (2.0, third), (1.5, 0.0), (third, 0.47), (0.0, 0.2), (0.0, 2.0 * third)]
    loads = (
        rf.Load("a", "top", (-0.77, 0.77), pressure=1.0),
        rf.Load("b", "right", (third - 0.5, 0.1), pressure=1.0),
    )
    supports = tuple(rf.Support("x", point=at) for at in (*wanted[3:], (-third, 0.47)))
    scene = block(loads=loads, contacts=(rf.Contact(span=(-1.5, 1.5)),), supports=supports)
    columns = block("quadrilateral", load=loads[1], supports=(rf.Support("y", point=(-0.5, 0.47)),))
    levels = [(x, y) for x in (0.0, 0.5, 2.0) for y in (third, 0.6, 0.47, 1.0)]
    for each, places in ((scene, wanted), (columns, levels)):
        points, _ = everything(make_mesh(comm, each, half))
        for x, y in places:
            assert np.hypot(points[:, 0] - x, points[:, 1] - y).min() < 1e-15
            if not half:
                assert np.hypot(points[:, 0] + x, points[:, 1] - y).min() < 1e-15


def test_assembly_leaves_gmsh_logs_and_the_terminal_as_they_were(
    capfd: pytest.CaptureFixture[str],
) -> None:
    logging.disable(logging.ERROR)
    bulk_of(block(), comm, Timer(None)).destroy()
    assert logging.root.manager.disable == logging.ERROR and capfd.readouterr().out == ""
    logging.disable(logging.NOTSET)
    assert not gmsh.isInitialized()
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("mine")
    make_mesh(comm, block(), False)
    assert gmsh.isInitialized() and gmsh.model.getCurrent() == "mine"
    gmsh.finalize()


DEMOS = Path(__file__).parents[3] / "demos"


@pytest.mark.parametrize("offset", [0.0, 0.7])
def test_all_contacts_of_a_stack_are_graded(offset: float) -> None:
    """Also both edges of the block in the middle; each contact carries the load and the moment."""
    scene = rf.Scene(
        body=rf.Body("a", width=4.0, position=(0.0, 1.0)),
        others=(
            rf.Body("b", width=6.0, position=(offset, 0.0)),
            rf.Body("c", width=5.0, position=(0.0, -1.0)),
        ),
        mesh=rf.MeshOptions(
            16, growth=1.4, refine=(rf.Refinement(0.02), rf.Refinement(0.05, 0.4, 1.5))
        ),
        contacts=(
            rf.Contact("a.bottom", against="b.top", friction=0.4),
            rf.Contact("b.bottom", against="c.top", friction=0.4),
            rf.Contact("c.bottom", friction=0.4),
        ),
        loads=(rf.Load("p", "a.top", pressure="1 + 0.1*x"),),
        history=rf.HistoryOptions(load="p", cycles=1),
        solver=rf.SolverOptions(symmetry="none"),
    )
    record = rf.run(scene)
    if record is None:
        return
    points, cells = everything(make_meshes(MPI.COMM_SELF, scene, False)[1])
    upper = points[cells].mean(axis=1)[:, 1] > 0.5
    assert 0.9 < upper.sum() / np.sum(~upper) < 1.1
    middles = (0.0, offset, 0.0)
    for k, middle in enumerate(middles):
        x, P = record.x[record.edge == k], record.turning_points.P[-1][record.edge == k]
        assert np.diff(x)[[0, -1]].max() < 0.014 and np.abs(x - 0.4).min() < 1e-9
        assert P.sum() == pytest.approx(4.0, rel=1e-10)
        assert (x + middle) @ P == pytest.approx(0.1 * 16.0 / 3.0, rel=1e-9)


def test_geo_files_take_a_size_field() -> None:
    places = (rf.Refinement(0.01, "ends"), rf.Refinement(0.02, (0.2, 0.3), 1.3))
    scene = rf.read_scene(DEMOS / "punch.toml", ["mesh.contact_elements=20"])
    system = rf.condense(replace(scene, mesh=replace(scene.mesh, refine=places)))
    if system is not None:
        assert np.diff(system.x)[[0, -1]].max() < 0.006
        inside = (system.x[:-1] > 0.2 - 1e-9) & (system.x[1:] < 0.3 + 1e-9)
        assert np.isclose(np.diff(system.x)[inside].sum(), 0.1)
        assert np.diff(system.x)[inside].max() <= 0.01 * (1 + 1e-9)
    # both bodies of one file, whose pads run against each other
    overrides = ["mesh.contact_elements=8", "mesh.growth=1.6"]
    scene = rf.read_scene(DEMOS / "dovetail.toml", overrides)
    pads = ("right", 0.01, 0.1), ("left", 0.03, -0.2)
    both = tuple(rf.Refinement(size, at, 1.6, f"blade.{pad}") for pad, size, at in pads)
    sides = zip(scene.contacts, ("edge", "against"), strict=True)  # the nodes of either body
    contacts = tuple(replace(contact, slave=slave) for contact, slave in sides)
    mesh = replace(scene.mesh, refine=both)
    system = rf.condense(replace(scene, mesh=mesh, contacts=contacts))
    if system is not None:
        right, left = (system.x[system.edge == k] for k in (0, 1))
        assert max(np.abs(right - 0.1).min(), np.abs(left + 0.2).min()) < 1e-9
        assert np.diff(right).min() < 0.007 < 0.011 < np.diff(left).min() < 0.018


def test_re_entrant_corners_of_a_geo_file_get_smaller_elements() -> None:
    scene = rf.read_scene(DEMOS / "dovetail.toml", ["mesh.contact_elements=8", "mesh.growth=1.6"])
    place = rf.Refinement(0.002, "corners", 1.6)
    for body, corners in zip(
        scene.bodies, ([(1.0, 0.0)], [(1.8, -0.8), (2.2, -1.8), (2.2, -0.8)]), strict=True
    ):
        (plain,) = read_user_meshes([body], scene.mesh)
        places = (replace(place, edge="right"),)
        (fine,) = read_user_meshes([body], replace(scene.mesh, refine=places))
        near = [
            (mesh.points[:, None] - [(sign * x, y) for x, y in corners for sign in (1, -1)])
            for mesh in (plain, fine)
        ]
        # the second smallest distance from a corner, which is a node, is that of a neighbour
        before, after = (np.sort(np.hypot(d[..., 0], d[..., 1]), axis=0)[1] for d in near)
        refined = [x != 1.8 for x, _ in corners for _ in (1, -1)]
        assert np.all(before > 0.05)
        assert np.all((after < 0.004) == refined)
