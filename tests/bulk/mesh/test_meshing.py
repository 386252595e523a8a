"""The body's mesh: where its nodes lie, its symmetry, its groups, its messages."""

from __future__ import annotations

import re
from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from bodies import block, everything, make_mesh

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Load, MeshOptions, Scene, Support

comm = MPI.COMM_WORLD


@pytest.mark.parametrize(
    ("loads", "ends"),
    [
        ((), []),
        ((Load("a", "top", (-1.0, 1.0), pressure=1.0),), [(1.0, 1.0)]),
        (
            (
                Load("a", "top", (-1.2, 0.3), pressure=1.0),
                Load("b", "right", (-0.1, 0.5), pressure=1.0),
            ),
            [(1.2, 1.0), (0.3, 1.0), (2.0, 0.4), (2.0, 1.0)],
        ),
    ],
)
def test_triangles_grow_from_contact_and_ends_of_loads(
    loads: tuple[Load, ...], ends: list[tuple[float, float]]
) -> None:
    points, cells = everything(make_mesh(comm, block(elements=80, growth=1.25, loads=loads), True))
    corners = points[cells]
    sides = np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), 2, 0))
    middle = corners.mean(axis=1)
    far = [np.hypot(*(middle - end).T) for end in ends]
    asked = 4.0 / 80 + 0.25 * np.min([middle[:, 1], *far], axis=0)
    ratio = sides.mean(axis=1) / asked
    assert 0.5 < ratio.min() and ratio.max() < 1.6
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("loads", "supports", "end"),
    [
        ((Load("a", "top", (-0.7, 0.7), pressure=1.0),), (), (0.7, 1.0)),
        ((Load("a", "top", pressure=1.0),), (), (2.0, 1.0)),
        ((), (Support("x", "right"), Support("x", "left")), (2.0, 1.0)),
    ],
)
def test_a_mesh_is_as_fine_at_ends_of_loads_and_supports_as_on_the_contact(
    loads: tuple[Load, ...], supports: tuple[Support, ...], end: tuple[float, float]
) -> None:
    for growth in (1.25, 1.8):
        scene = block(elements=80, growth=growth, loads=loads, supports=supports)
        points, cells = everything(make_mesh(comm, scene, True))
        corners = points[cells]
        there = np.any(np.all(np.abs(corners - end) < 1e-15, axis=2), axis=1)
        sides = np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), 2, 0))[there]
        assert 0 < there.sum() <= 8
        assert 0.5 * 4.0 / 80 < sides.min() and sides.max() < growth**2 * 4.0 / 80


def test_layers_of_quadrilaterals_shrink_towards_ends_of_loads() -> None:
    loads = (
        Load("a", "top", (-1.0, 1.0), pressure=1.0),
        Load("b", "right", (0.1, 0.3), pressure=1.0),
    )
    scene = block("quadrilateral", elements=160, growth=1.3, loads=loads)
    points, _ = everything(make_mesh(comm, scene, True))
    levels = np.unique(points[:, 1])
    heights, middle = np.diff(levels), 0.5 * (levels[1:] + levels[:-1])
    distance = np.min([np.abs(middle - at) for at in (0.0, 0.6, 0.8, 1.0)], axis=0)
    ratio = heights / (4.0 / 160 + 0.3 * distance)
    assert 0.75 < ratio.min() and ratio.max() < 1.33


@pytest.mark.parametrize("half", [False, True])
def test_vertices_lie_at_ends_of_spans_and_at_points(half: bool) -> None:
    wanted = [(0.77, 1.0), (2.0, 0.31), (1.5, 0.0), (0.31, 0.47)]
    scene = block(
        loads=(
            Load("a", "top", (-0.77, 0.77), pressure=1.0),
            Load("b", "right", (-0.19, 0.1), pressure=1.0),
        ),
        contacts=(Contact(span=(-1.5, 1.5)),),
        supports=(Support("x", point=(0.31, 0.47)), Support("x", point=(-0.31, 0.47))),
    )
    points, _ = everything(make_mesh(comm, scene, half))
    for x, y in wanted:
        assert np.hypot(points[:, 0] - x, points[:, 1] - y).min() < 1e-15
        if not half:
            assert np.hypot(points[:, 0] + x, points[:, 1] - y).min() < 1e-15


def test_misfit_names_the_key_and_its_advice_serves() -> None:
    scene = block(contacts=(Contact(span=(-1.2, 1.2)),), elements=16)
    with pytest.raises(InputError, match=r"mesh\.contact_elements = 16 .* contact\.span") as caught:
        make_mesh(comm, scene, False)
    advice = re.search(r"use (\d+)$", str(caught.value))
    assert advice is not None and int(advice[1]) == 20
    better = replace(scene, mesh=MeshOptions(contact_elements=20, degree=1))
    points, _ = everything(make_mesh(comm, better, False))
    assert np.hypot(points[:, 0] - 1.2, points[:, 1]).min() < 1e-15


def test_misfit_without_a_near_count_advises_to_move() -> None:
    scene = block(contacts=(Contact(span=(-np.sqrt(2.0), np.sqrt(2.0))),), elements=16)
    with pytest.raises(InputError, match=r"contact\.span .* multiple of 0\.25"):
        make_mesh(comm, scene, False)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"body": Body(mesh="my.msh")}, "no such file"),
        ({"supports": (Support("x", point=(3.0, 0.5)),)}, "support.point.*outside"),
        ({"supports": (Support("x", point=(0.33, 0.0)),)}, "support.point needs one"),
    ],
)
def test_what_cannot_be_meshed_is_said_on_all_ranks(change: dict, message: str) -> None:
    scene: Scene = replace(block(), **change)
    with pytest.raises(InputError, match=message):
        make_mesh(comm, scene, False)


def test_side_contact_has_no_half() -> None:
    with pytest.raises(InputError, match="no half at x >= 0"):
        make_mesh(comm, block(contacts=(Contact(edge="left"),), loads=()), True)


def test_a_gmsh_session_of_the_user_survives() -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        gmsh.model.geo.addPoint(1.0, 2.0, 3.0)
        gmsh.model.geo.synchronize()
        make_mesh(comm, block(), False)
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "mine"
        assert len(gmsh.model.getEntities(0)) == 1
    finally:
        gmsh.finalize()
