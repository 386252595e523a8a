"""Graded contact edges: sizes, symmetry, matching bodies, .geo files, and messages."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, everything, make_mesh

import receding_fenicsx as rf
from receding_fenicsx.bulk.mesh.grading import Base, graded
from receding_fenicsx.bulk.mesh.user_mesh import read_user_meshes

comm = MPI.COMM_WORLD
DEMOS = Path(__file__).parents[3] / "demos"
EDGE = Base(np.array([0.0, 1.0, 3.0]), np.array([0.2, 0.1]))


def test_elements_have_the_size_of_the_formula() -> None:
    random = np.random.default_rng(5)
    for _ in range(12):
        at = np.sort(random.uniform(0.0, 3.0, (4, 2)), axis=1)
        at[0, 1] = at[0, 0]
        places = [
            rf.Refinement(10.0 ** random.uniform(-2.5, 0), tuple(a), random.uniform(1.05, 2.5))
            for a in at
        ]
        s = graded((0.0, 3.0), EDGE, places)
        assert s[0] == 0.0 and s[-1] == 3.0 and np.all(np.diff(s) > 0.0)
        for a in at.ravel():
            assert np.abs(s - a).min() < 1e-8
        # integral of ds/h over each element, by the midpoint rule
        parts = np.linspace(s[:-1], s[1:], 401)
        middle = 0.5 * (parts[1:] + parts[:-1])
        h = np.where(middle < 1.0, 0.2, 0.1)
        for place in places:
            low, high = place.span
            away = np.maximum(np.maximum(low - middle, middle - high), 0.0)
            assert place.growth is not None
            h = np.minimum(h, place.size + (place.growth - 1.0) * away)
        steps = (np.diff(parts, axis=0) / h).sum(axis=0)
        assert steps.max() < 1.0 + 1e-3
        # equal between breaks: no piece has an element fewer than it needs
        breaks = np.unique(np.concatenate([[0.0, 3.0], at.ravel()]))
        for a, b in pairwise(breaks):
            own = steps[(s[:-1] > a - 1e-8) & (s[1:] < b + 1e-8)]
            assert np.ptp(own) < 1e-3 and len(own) == max(1, np.ceil(own.sum() - 1e-3))


def refined(*places: rf.Refinement, elements: int = 16, **parts: object) -> rf.Scene:
    """The block with refined places."""
    scene = block(elements=elements, degree=2, **parts)  # type: ignore[arg-type]
    return replace(scene, mesh=replace(scene.mesh, refine=places))


@pytest.mark.parametrize("edge", ["bottom", "top"])
def test_graded_mesh_is_its_own_mirror_image_to_the_bit(edge: str) -> None:
    load = rf.Load("a", "left", (-0.25, 0.3), pressure=1.0)
    contact = rf.Contact(edge=edge, span=(-1.9, 1.3))
    scene = refined(
        rf.Refinement(0.01), rf.Refinement(0.02, (0.3, 0.5), 1.5), load=load, contacts=(contact,)
    )
    points, cells = everything(make_mesh(comm, scene, False))
    shapes = [
        {frozenset(map(tuple, points[cell] * [sign, 1.0] + 0.0)) for cell in cells}
        for sign in (1.0, -1.0)
    ]
    assert len(shapes[0]) == len(cells) and shapes[0] == shapes[1]
    x = np.unique(points[points[:, 1] == (0.0 if edge == "bottom" else 1.0), 0])
    for place in (-1.9, -1.3, -0.5, 0.3, 1.9):
        assert np.abs(x - place).min() < 1e-12
    first = np.flatnonzero(x > 1.3 + 1e-9)[0]
    # it grows within the element
    assert 0.006 < x[first] - x[first - 1] < 0.012


def test_refinement_below_nothing_changes_no_number() -> None:
    """Places with elements as large as those of the mesh only add their breaks."""
    plain = block(elements=16, degree=2)
    same = refined(rf.Refinement(10.0, 0.5))
    a, b = (np.sort(everything(make_mesh(comm, s, True))[0], axis=0) for s in (plain, same))
    assert a.shape == b.shape and np.abs(a - b).max() < 1e-9


def pair(offset: float, *places: rf.Refinement) -> rf.Scene:
    """Two rectangles, the lower one wider and moved by an offset."""
    return rf.Scene(
        body=rf.Body("a", width=4.0, position=(0.0, 1.0)),
        others=(rf.Body("b", width=6.0, position=(offset, 0.0)),),
        mesh=rf.MeshOptions(16, growth=1.4, refine=places),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=0.4),),
        loads=(rf.Load("p", "a.top", pressure=1.0),),
        supports=(rf.Support("xy", "b.bottom"),),
        history=rf.HistoryOptions(load="p", cycles=1),
        solver=rf.SolverOptions(symmetry="none"),
    )


@pytest.mark.parametrize("offset", [0.0, 0.7, 2.2])
def test_nodes_of_two_graded_rectangles_match(offset: float) -> None:
    scene = pair(offset, rf.Refinement(0.01), rf.Refinement(0.05, 0.4, 1.3))
    system = rf.condense(scene)
    if system is None:
        return
    ends = max(-2.0, offset - 3.0), min(2.0, offset + 3.0)
    assert system.x[0] == pytest.approx(ends[0]) and system.x[-1] == pytest.approx(ends[1])
    assert np.diff(system.x)[[0, -1]].max() < 0.007
    assert np.abs(system.x - 0.4).min() < 1e-9


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
    one = rf.Refinement(0.01, 0.1, 1.6, "blade.right")
    system = rf.condense(replace(scene, mesh=replace(scene.mesh, refine=(one,))))
    if system is not None:
        right, left = (system.x[system.edge == k] for k in (0, 1))
        assert len(left) == 17 and np.abs(right - 0.1).min() < 1e-9
        assert np.diff(right).min() < 0.007


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
