"""Axisymmetric rectangles beside the axis: rings, against Lame's closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, NU, YOUNG, built, cylinder
from msh import write_msh

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.fields import fields_at
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.mesh.meshing import contact_nodes_of, raw_meshes
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.output.report.turning_points import zones_header, zones_shown
from receding_fenicsx.output.snapshots.view import view_of
from receding_fenicsx.studies import run as study
from receding_fenicsx.timing import Timer

comm = MPI.COMM_WORLD


def washer(cell: str = "triangle", degree: int = 2, **parts: object) -> rf.Scene:
    """A ring 3 <= r <= 7 between smooth planes, under pressure inside and on its top."""
    scene = cylinder(
        cell,
        degree,
        body=rf.Body(width=4.0, height=1.0, position=(5.0, -0.5)),
        loads=(rf.Load("inside", "left", pressure=1.0), rf.Load("top", "top", pressure=1.0)),
        history=rf.HistoryOptions(kind="table", columns=("inside", "top"), rows=((0.5, 0.8),)),
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_rectangle_beside_the_axis_is_lames_ring_at_its_own_radii(cell: str, degree: int) -> None:
    """u_r = ((1 - nu) A r + (1 + nu) B / r + nu p r) / E, with p on the plane everywhere."""
    a, b, inside, top = 3.0, 7.0, 0.5, 0.8
    record = study.run(washer(cell, degree, mesh=rf.MeshOptions(32, cell, degree, 1.3)))
    if record is None:
        return
    x, table = record.x, record.turning_points
    assert (x[0], x[-1]) == (a, b) and np.array_equal(record.points[:, 0], x)
    assert np.all(record.points[:, 1] == -0.5)
    A, B = inside * np.array([a**2, a**2 * b**2]) / (b**2 - a**2)
    expected = ((1.0 - NU) * A * x + (1.0 + NU) * B / x + NU * top * x) / YOUNG
    tolerance = 1e-3 if degree == 1 else 5e-6
    assert np.abs(table.v[-1] - expected).max() < tolerance * expected.max()
    assert np.abs(table.p[-1] - top).max() < (0.02 if degree == 1 else 1e-3) * top
    assert table.P[-1].sum() == pytest.approx(top * np.pi * (b**2 - a**2), rel=1e-12)
    # work-conjugate to the pressure inside: the volume that the bore's wall sweeps outwards
    bore = ((1.0 - NU) * A * a + (1.0 + NU) * B / a + NU * top * a) / YOUNG
    assert table.load_displacement[-1, 0] == pytest.approx(2.0 * np.pi * a * bore, rel=tolerance)
    point = rf.summarise(record)["turning_points"][-1]
    assert point["zones"] == [["contact", a, b]] and point["contact_half_width"] == 2.0
    assert "p_axis" not in point
    assert zones_shown(point, rf.summarise(record)) == "3.0000 contact to 7.0000"
    assert zones_header(rf.summarise(record)) == "zones"


def test_profiles_spans_and_tables_of_a_ring_know_its_radii() -> None:
    """Expressions of friction, gap and loads, spans and tables all run from 3 to 7."""
    table = {"x": [3.0, 7.0], "value": [0.3, 0.7]}
    contact = rf.Contact(
        span=(3.5, 6.0), friction="0.05*x", initial_gap={"x": [3.0, 7.0], "value": [0.0, 0.4]}
    )
    loads = (
        rf.Load("inside", "top", (4.0, 6.0), pressure="x"),
        rf.Load("top", "top", (6.0, 7.0), pressure=table),
    )
    scene = washer(contacts=(contact,), loads=loads)
    rf.validate(scene)
    assert contact_nodes_of(scene) == [10 * scene.mesh.degree + 1]
    bulk = built(scene, half=True)
    down = [-force.getArray(readonly=True)[1::2].sum() for force in bulk.loads]
    # integrals of r^2 from 4 to 6, and of r^2 / 10 from 6 to 7
    assert comm.allreduce(down[0]) == pytest.approx(152.0 / 3.0, rel=1e-12)
    assert comm.allreduce(down[1]) == pytest.approx(127.0 / 30.0, rel=1e-12)
    bulk.destroy()
    system = study.condense(scene)
    if system is not None:
        assert (system.x[0], system.x[-1]) == (3.5, 6.0)
        assert system.f == pytest.approx(0.05 * system.x)
        assert system.g0 == pytest.approx(0.1 * (system.x - 3.0))


def test_a_ring_is_the_same_made_by_a_mesh_file(shared_tmp_path: Path) -> None:
    rough = washer(contacts=(rf.Contact(friction="0.05*x"),))
    path = shared_tmp_path / "ring.msh"

    def write() -> None:
        (mesh,) = raw_meshes(rough, True)
        write_msh(path, mesh.points, [mesh.cells], mesh.edges)

    rf.on_root(comm, write)
    comm.barrier()
    records = [study.run(scene) for scene in (rough, replace(rough, body=rf.Body(mesh=str(path))))]
    if records[0] is not None and records[1] is not None:
        for name in ("P", "Q", "v"):
            a, b = (np.abs(getattr(r.turning_points, name)) for r in records if r is not None)
            assert np.abs(a - b).max() < 1e-9 * a.max(), name


@pytest.mark.parametrize("x", [1.0, 2.0, -5.0, 2.0 + 1e-9])
def test_a_ring_that_reaches_the_axis_is_refused(x: float) -> None:
    with pytest.raises(
        rf.InputError, match=r"\[body\] position: x = .* move it off the axis r = 0"
    ):
        rf.validate(washer(body=rf.Body(width=4.0, position=(x, 0.0))))


def test_a_cylinder_presses_a_ring_of_elements_of_its_size() -> None:
    upper = rf.Body(name="a", width=8.0, height=1.0)
    lower = rf.Body(name="b", width=2.0, height=1.0, position=(3.0, -1.0))
    scene = cylinder(
        degree=2,
        mesh=rf.MeshOptions(16, "triangle", 2, 1.3),
        body=upper,
        others=(lower,),
        contacts=(rf.Contact(edge="a.bottom", against="b.top", friction=0.0),),
        loads=(rf.Load("p", "a.top", pressure=1.0),),
        supports=(rf.Support("y", edge="b.bottom"),),
    )
    record = study.run(scene)
    if record is not None:
        # elements of 0.5 on both, and no image of the contact at the axis
        assert record.x == pytest.approx(np.linspace(2.0, 4.0, 9), abs=1e-12)
        assert record.turning_points.P[-1].sum() == pytest.approx(np.pi * 16.0, rel=1e-10)
        found = rf.summarise(record)["turning_points"][-1]["zones"]
        assert found[0][1] == 2.0 and found[-1][2] == 4.0


def test_a_picture_of_a_ring_shows_it_where_it_is() -> None:
    """Both cuts of the body, the contact on the right one, profiles at their radii."""
    gap = "0.01*(x - 3)"
    scene = washer(contacts=(rf.Contact(friction="0.05*x", initial_gap=gap),))
    system = study.condense(scene)

    def instant() -> Instant:
        assert system is not None
        record = rf.evolve(system, rf.history_from_scene(scene))
        state = turning_point(record, system, 0)
        return Instant(0, 0, 1.0, record.turning_points.load[0], state.v, state)

    now = comm.bcast(rf.on_root(comm, instant))
    bulk = bulk_of(scene, comm, Timer())
    found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
    if found is not None:
        view = view_of(bulk, found, now)
        assert {3.0, 7.0, -3.0, -7.0} == set(np.round([*extremes(view.points[:, 0])], 12).tolist())
        (strip,) = view.strips
        assert (strip.x[0], strip.x[-1]) == (3.0, 7.0)
        assert view.f.forward == pytest.approx(0.05 * strip.x)
        assert strip.gap == pytest.approx(view.factor * 0.01 * (strip.x - 3.0), abs=1e-15)
        (top,) = [a for a in view.arrows if a.heads[0, 1] > 0.0 and np.ptp(a.heads[:, 0]) > 1.0]
        assert top.heads[:, 0].min() > 2.5 and top.heads[:, 0].max() < 7.5
    bulk.destroy()


def extremes(x: Array) -> list[float]:
    """Ends of both halves."""
    return [float(part) for side in (x[x > 0.0], x[x < 0.0]) for part in (side.min(), side.max())]
