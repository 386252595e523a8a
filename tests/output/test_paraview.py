"""Files for ParaView: values against record and load, mirrored halves, two bodies, two readers."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import meshio
import numpy as np
import pytest
from pictured import instant_of_row, small_block

from receding_fenicsx import environment
from receding_fenicsx.bulk.fields import fields_at
from receding_fenicsx.evolution.moment import Moment
from receding_fenicsx.output.snapshots.paraview import Grid, grid_of, write_instant
from receding_fenicsx.output.snapshots.view import whole_contact
from receding_fenicsx.pictures import picture_body
from receding_fenicsx.scene.model import Body, Contact, HistoryOptions, Material, Scene, Support

COMM = MPI.COMM_WORLD
LEGS = {0.5: (0, "0"), 1.5: (1, "0"), 2.0: (1, "1")}
"""Cycle and leg of the instants by their time."""
READ = (Path(__file__).parents[1] / "programs" / "read_series.txt").read_text()
"""Prints, for each time, what pyvista (with VTK's reader of XDMF) finds."""


def two_blocks() -> Scene:
    """The block on a wider and higher one, with a gap that opens outwards."""
    scene = small_block()
    return replace(
        scene,
        body=replace(scene.body, name="upper", position=(0.0, 2.0)),
        others=(Body("lower", width=8.0, height=2.0),),
        material=Material(2.0, 0.3),
        materials=(Material(3.0, 0.2, name="lower"),),
        contacts=(Contact("upper.bottom", against="lower.top", initial_gap="0.1 * x**2"),),
        loads=(replace(scene.loads[0], edge="upper.top"),),
        supports=(Support("xy", edge="lower.bottom"),),
        history=HistoryOptions(load="p0", kind="monotonic"),
    )


def grids(scene: Scene, *times: float) -> dict[float, tuple[Grid, Moment]]:
    """Return grid and record of the ends of a scene's first legs, alike on every rank."""
    found = {}
    for row, time in enumerate(times):
        record, now = instant_of_row(scene, row)
        with picture_body(scene, COMM) as bulk:
            fields = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
            if fields is not None:
                first, *_ = record.by_edge().values()
                end = first.at(cycle=now.cycle, leg=now.leg)
                found[time] = grid_of(fields, whole_contact(bulk, now)), end
    return COMM.bcast(found)


@pytest.fixture(scope="module")
def half() -> dict[float, tuple[Grid, Moment]]:
    return grids(small_block(), *LEGS)


def cells_of(grid: Grid) -> np.ndarray[Any, Any]:
    """Return the points (m, 3 or 4) of the triangles or quadrilaterals."""
    part = grid.in_cells["part"]
    cells = np.count_nonzero(part)
    rows = grid.topology[: len(grid.topology) - 4 * (len(part) - cells)].reshape(cells, -1)
    assert np.all(rows[:, 0] == rows.shape[1])  # XDMF's number: 4 a triangle, 5 a quadrilateral
    return rows[:, 1:]


def on_contact(grid: Grid) -> np.ndarray[Any, Any]:
    """Return the contact's points in the order of x."""
    nodes = np.flatnonzero(grid.at_points["state"])
    return nodes[np.argsort(grid.points[nodes, 0])]


def test_contact_has_the_values_of_the_record(half: dict[float, tuple[Grid, Moment]]) -> None:
    for grid, end in half.values():
        nodes = on_contact(grid)
        value = {name: values[nodes] for name, values in grid.at_points.items()}
        assert np.array_equal(grid.points[nodes, 0], end.x)
        assert np.array_equal(value["state"], end.state)
        for name, known in (("p", end.p), ("q", end.q), ("slip", end.v), ("gap", end.w)):
            scale = np.abs(known).max()
            np.testing.assert_allclose(value[name], known, rtol=0.0, atol=1e-12 * scale)
        # t = +x, n = +y: what the plane does to the body
        assert np.array_equal(value["traction"][:, :2].T, [value["q"], value["p"]])
        # the body's displacement at vertices is that of the contact
        moved = np.column_stack([end.v, end.w])[::2]
        difference = value["displacement"][::2, :2] - moved
        assert np.abs(difference).max() < 1e-12 * np.abs(moved).max()
        off = np.setdiff1d(np.arange(len(grid.points)), nodes)
        assert all(np.all(np.isnan(grid.at_points[n][off])) for n in ("p", "q", "gap", "slip"))


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_both_bodies_and_their_contact_are_one_grid(cell: str, shared_tmp_path: Path) -> None:
    scene = two_blocks()
    found = grids(replace(scene, mesh=replace(scene.mesh, cell=cell)), 1.0)
    for grid, end in found.values():
        if COMM.rank == 0:
            write_instant(file := shared_tmp_path / "cycle0000_leg0_s1.000.xdmf", grid, 1.0)
            kinds = [block.type for block in meshio.read(file).cells]
            assert kinds == [cell.replace("rilateral", ""), "line"]
        part = grid.in_cells["part"]
        x, y, _ = np.moveaxis(grid.points[cells_of(grid)], -1, 0)
        # with the corners in order around each cell
        around = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)
        area = 0.5 * np.abs(around.sum(axis=1))
        body = part[part > 0]
        assert [area[body == k].sum() for k in (1, 2)] == pytest.approx([4.0, 16.0])
        assert np.count_nonzero(part == 0) == len(end.x) - 1
        nodes = on_contact(grid)
        assert grid.at_points["gap"][nodes] == pytest.approx(0.1 * end.x**2 + end.w, abs=1e-12)
        assert np.any(end.state == 2) and np.any(end.p > 0.0)
        # a line's stress is the mean of its ends'
        lines = grid.topology[-4 * np.count_nonzero(part == 0) :].reshape(-1, 4)[:, 2:]
        for name in ("sxx", "syy", "sxy", "von_mises", "max_shear"):
            mean = grid.at_points[name][lines].mean(axis=1)
            assert grid.in_cells[f"{name}_cell"][part == 0] == pytest.approx(mean, rel=1e-12)
        # the gap is between the two edges as they are drawn
        y = grid.points[:, 1] + grid.at_points["displacement"][:, 1]
        for node in nodes[::2]:
            at = np.abs(grid.points - grid.points[node]).max(axis=1) < 1e-9
            (other,) = set(np.flatnonzero(at)) & set(cells_of(grid)[body == 2].ravel())
            apart = y[node] - y[other] + 0.1 * grid.points[node, 0] ** 2
            assert apart == pytest.approx(grid.at_points["gap"][node], abs=1e-10)


def test_each_contact_edge_moves_with_its_own_body() -> None:
    """The upper block on the lower one, which lies on the plane."""
    scene, plane = two_blocks(), Contact("lower.bottom")
    scene = replace(scene, contacts=(*scene.contacts, plane), supports=())
    ((grid, _),) = grids(scene, 1.0).values()
    nodes, moved = np.flatnonzero(grid.at_points["state"]), grid.at_points["displacement"]
    assert set(grid.points[nodes, 1]) == {0.0, 2.0}
    assert np.count_nonzero(grid.in_cells["part"] == 0) == len(nodes) - 2  # two chains of lines
    compared = 0
    for node in nodes:
        body = 1 if grid.points[node, 1] else 2
        own = np.unique(cells_of(grid)[grid.in_cells["part"][: len(cells_of(grid))] == body])
        for k in own[np.abs(grid.points[own] - grid.points[node]).max(axis=1) < 1e-9]:
            assert np.abs(moved[k] - moved[node]).max() < 1e-12 * np.abs(moved).max()
            compared += 1
    assert compared > len(nodes) / 3  # there are no vertices between those of the elements


def test_meshio_and_pyvista_read_the_series(
    half: dict[float, tuple[Grid, Moment]], shared_tmp_path: Path
) -> None:
    if COMM.rank != 0:
        return
    # written out of order
    for time in sorted(half, reverse=True):
        (cycle, leg), (grid, _) = LEGS[time], half[time]
        file = shared_tmp_path / f"cycle{cycle:04d}_leg{leg}_s1.000.xdmf"
        write_instant(file, grid, time)
        # one whose data are lost is left out
        lost = shared_tmp_path / "cycle0009_leg0_s1.000.xdmf"
        lost.write_bytes(file.read_bytes())
    series = shared_tmp_path / "instants.xdmf"
    with meshio.xdmf.TimeSeriesReader(series) as reader:
        points, blocks = reader.read_points_cells()
        for k, time in enumerate(sorted(half)):
            told, at_points, in_cells = reader.read_data(k)
            grid, _ = half[time]
            assert told == time
            assert np.array_equal(points, grid.points)
            assert np.array_equal(blocks[0].data, cells_of(grid))
            for name, values in grid.at_points.items():
                assert np.array_equal(at_points[name], values, equal_nan=True)
            assert np.array_equal(np.concatenate(in_cells["part"]), grid.in_cells["part"])
    lost.unlink()
    # in a process of its own: DOLFINx and VTK do not go well together
    command, own = [sys.executable, "-c", READ, str(series)], environment.child_environment()
    done = subprocess.run(command, env=own, capture_output=True, text=True, timeout=300)
    rows = np.array(done.stdout.split(), dtype=float).reshape(-1, 8)
    assert len(rows) == len(half), done.stderr
    for time, row in zip(sorted(half), rows, strict=True):
        grid, end = half[time]
        lowest = grid.at_points["displacement"][:, 1].min()
        known = [time, len(grid.points), len(end.x) - 1, end.p.max(), lowest, len(end.x)]
        arrays = len(grid.at_points) + len(grid.in_cells)
        assert row == pytest.approx([*known, grid.in_cells["sxy_cell"].min(), arrays], rel=1e-9)
