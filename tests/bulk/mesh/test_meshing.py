"""The body's mesh: where its nodes lie, its symmetry, its groups, its messages."""

from __future__ import annotations

import re
from dataclasses import replace

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from bodies import CELLS, block, everything, facet_ends, make_mesh

from receding_fenicsx.bulk.mesh.gmsh_model import geo_path
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Load, MeshOptions, Scene, Support

comm = MPI.COMM_WORLD


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("half", [False, True])
def test_contact_vertices_are_equally_spaced(cell: str, half: bool) -> None:
    load = Load("a", "top", (-0.925, 0.925), pressure=1.0)
    scene = block(cell, elements=36, body=Body(width=3.7, height=0.9), load=load)
    points, _ = everything(make_mesh(comm, scene, half))
    x = np.sort(points[points[:, 1] == 0.0, 0])
    expected = 3.7 * np.arange(0 if half else -18, 19) / 36
    assert x.shape == expected.shape
    # gmsh alone is off by 1e-12
    assert np.abs(x - expected).max() <= np.spacing(3.7)
    assert x[-1] == 3.7 / 2


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("edge", ["bottom", "top"])
def test_whole_mesh_is_its_own_mirror_image_to_the_bit(cell: str, edge: str) -> None:
    load = Load("a", "left", (-0.25, 0.3), pressure=1.0)
    scene = block(cell, elements=24, load=load, contacts=(Contact(edge=edge),))
    points, cells = everything(make_mesh(comm, scene, False))

    def shapes(sign: float) -> set[frozenset[tuple[float, float]]]:
        moved = points * [sign, 1.0] + 0.0
        return {frozenset(map(tuple, moved[cell_])) for cell_ in cells}

    assert len(shapes(1.0)) == len(cells)
    assert shapes(1.0) == shapes(-1.0)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("growth", [1.0, 1.3])
def test_cells_fill_the_body(cell: str, half: bool, growth: float) -> None:
    points, cells = everything(make_mesh(comm, block(cell, growth=growth), half))
    around = cells if cell == "triangle" else cells[:, [0, 1, 3, 2]]
    x, y = np.moveaxis(points[around], 2, 0)
    following = np.roll(np.arange(x.shape[1]), -1)
    area = 0.5 * np.abs((x * y[:, following] - x[:, following] * y).sum(axis=1))
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(2.0 if half else 4.0, rel=1e-13)


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


def test_layers_of_quadrilaterals_grow_geometrically() -> None:
    scene = block("quadrilateral", elements=80, growth=1.3, loads=())
    points, _ = everything(make_mesh(comm, scene, True))
    heights = np.diff(np.unique(points[:, 1]))
    assert heights[1:] / heights[:-1] == pytest.approx(np.full(len(heights) - 1, 1.3), rel=0.05)
    assert heights[0] == pytest.approx(4.0 / 80, rel=0.2)


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


def test_quadrilaterals_have_levels_at_span_ends_on_sides() -> None:
    load = Load("b", "right", (-0.19, 0.1), pressure=1.0)
    points, cells = everything(make_mesh(comm, block("quadrilateral", load=load), False))
    levels = np.unique(points[:, 1])
    assert np.abs(levels - 0.31).min() < 1e-15 and np.abs(levels - 0.6).min() < 1e-15
    assert len(points) == 17 * len(levels)
    assert cells.shape == (16 * (len(levels) - 1), 4)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("contact", ["bottom", "top", "left", "right"])
def test_each_group_is_its_edge(cell: str, contact: str) -> None:
    scene = block(cell, contacts=(Contact(edge=contact),), loads=(), elements=12)
    body = make_mesh(comm, scene, False)
    lines = {
        "bottom": (1, 0.0, 4.0),
        "top": (1, 1.0, 4.0),
        "left": (0, -2.0, 1.0),
        "right": (0, 2.0, 1.0),
    }
    assert set(body.groups) == set(lines)
    for edge, (axis, at, length) in lines.items():
        ends = facet_ends(body, edge)
        assert np.all(ends[:, :, axis] == at)
        assert np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum() == pytest.approx(length, rel=1e-13)
        if edge == contact:
            assert len(ends) == 12


def test_half_has_an_axis_and_no_left_edge() -> None:
    body = make_mesh(comm, block(), True)
    assert set(body.groups) == {"bottom", "right", "top", "axis"}
    ends = facet_ends(body, "axis")
    assert np.all(ends[:, :, 0] == 0.0)
    assert np.ptp(ends[:, :, 1]) == 1.0


@pytest.mark.parametrize("cell", CELLS)
def test_power_of_two_lengths_scale_the_mesh_to_the_bit(cell: str) -> None:
    factor = 2.0**-30
    scene = block(cell, load=Load("p0", "top", (-0.75, 0.75), pressure=1.0))
    small = replace(
        scene,
        body=Body(width=4.0 * factor, height=factor),
        loads=(Load("p0", "top", (-0.75 * factor, 0.75 * factor), pressure=1.0),),
    )
    points, cells = everything(make_mesh(comm, scene, False))
    scaled, cells_scaled = everything(make_mesh(comm, small, False))
    assert np.array_equal(points * factor, scaled)
    assert np.array_equal(cells, cells_scaled)


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


def test_geo_file_works_by_itself() -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(geo_path("rectangle.geo")))
        gmsh.model.mesh.generate(2)
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
        _, coordinates, _ = gmsh.model.mesh.getNodes()
    finally:
        gmsh.finalize()
    assert names == {"bottom", "right", "top", "axis", "body"}
    points = coordinates.reshape(-1, 3)
    assert (points[:, 1] == 0.0).sum() == 81
    # the end of the load in the paper's figure 2
    assert np.hypot(points[:, 0] - 1.0, points[:, 1] - 1.0).min() < 1e-12


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
