"""Press fits on cylinders and cones, whose positions along the edge are no radii."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import played
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.stack import build_all
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.output.plots.labels import Scales
from receding_fenicsx.output.report.contact import zones_header
from receding_fenicsx.output.snapshots.view import WholeContact, whole_contact

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

comm = MPI.COMM_WORLD
E, NU, F = 196000.0, 0.3, 0.1
A, B, C, L = 10.0, 20.0, 30.0, 19.0
DEPTH = 0.0025

SECTION = """
DefineConstant[ contact_elements = 8 ]; h = 19 / contact_elements;
Point(1) = {10, 0, 0, h}; Point(2) = {20, 0, 0}; Point(3) = {20 + TAPER, 19, 0};
Point(4) = {10, 19, 0, h}; Point(5) = {30, 0, 0, h}; Point(6) = {30, 19, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {2, 5}; Line(6) = {5, 6}; Line(7) = {6, 3};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {5, 6, 7, -2}; Plane Surface(2) = {2};
Transfinite Curve {2} = contact_elements + 1;
Physical Surface("shaft") = {1}; Physical Surface("hub") = {2};
Physical Curve("fit") = {2}; Physical Curve("push") = {1}; Physical Curve("rim") = {6};
Physical Curve("bed") = {5};
"""


def pressed_in(folder: Path, taper: float) -> rf.Scene:
    """Two rings of 19 by 10 from one .geo file: a fit at radius 20, or a taper in its seat."""
    file, fit = folder / "fit.geo", taper == 0.0
    rf.on_root(comm, lambda: file.write_text(SECTION.replace("TAPER", str(taper))))
    shaft, hub = (rf.Body(name=n, mesh=str(file), surface=n) for n in ("shaft", "hub"))
    contact = rf.Contact(edge="shaft.fit", against="hub.fit", friction=F)
    low, high = (-0.8, 0.8) if fit else (0.4, 1.0)
    return rf.Scene(
        body=shaft,
        others=(hub,),
        material=rf.Material(E, NU, "axisymmetric"),
        mesh=rf.MeshOptions(contact_elements=8),
        contacts=(replace(contact, interference=DEPTH if fit else None),),
        loads=(rf.Load("push", "shaft.push", pressure=1.0 if fit else -float(np.sign(taper))),),
        supports=(rf.Support("y", edge="hub.rim"),),
        history=rf.HistoryOptions(kind="cyclic", minimum=low, maximum=high, cycles=1),
    )


@pytest.mark.parametrize("taper", [0.0, 1.0, -1.0])
def test_a_fit_is_shown_over_its_whole_length_in_balance(
    shared_tmp_path: Path, taper: float
) -> None:
    record = played(pressed_in(shared_tmp_path, taper))
    x, table = record.x, record.turning_points
    length = np.hypot(L, taper)
    assert [x[0], x[-1]] == pytest.approx([-0.5 * length, 0.5 * length])
    assert not record.begins_on_axis and not Scales(record).radial
    # z upwards, n into the shaft: t = (taper, L) / length, n = (-L, taper) / length
    pressure = (float(-np.sign(taper)) or 1.0) * table.load[:, record.load_names.index("push")]
    axial = (table.Q.sum(axis=1) * L + table.P.sum(axis=1) * taper) / length
    scale = table.P.sum(axis=1).max()
    assert axial == pytest.approx(-np.pi * (B**2 - A**2) * pressure, abs=1e-9 * scale)
    assert np.all(np.abs(table.Q) <= F * table.P + 1e-12 * scale)
    summary = rf.summarise(record)
    assert zones_header(summary) == "zones"
    for point in summary["turning_points"]:
        assert "p_axis" not in point
        assert (point["zones"][0][1], point["zones"][-1][2]) == (x[0], x[-1])


def whole_contact_at_rest(scene: rf.Scene) -> tuple[WholeContact, NDArray[np.int64]]:
    """What pictures show of a contact that slips forward, and the modelled nodes' edges."""
    bulk = build_all(scene, make_meshes(comm, scene, True))
    n, edge = len(bulk.contact.x), bulk.contact.edge
    zeros, states = np.zeros(2 * n), np.full(n, 3, dtype=np.int8)
    now = Instant(
        0, 0, 1.0, np.zeros(len(scene.loads)), zeros[:n], rf.ContactState(zeros, zeros, states)
    )
    found = whole_contact(bulk, now)
    bulk.destroy()
    return found, edge


TIP = """
DefineConstant[ contact_elements = 8 ];
Point(1) = {0, 0, 0, 2}; Point(2) = {10, RISE, 0, 2}; Point(3) = {10, 40, 0, 2};
Point(4) = {0, 40, 0, 2}; Point(5) = {10, -40, 0, 2}; Point(6) = {0, -40, 0, 2};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {2, 5}; Line(6) = {5, 6}; Line(7) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {5, 6, 7, 1}; Plane Surface(2) = {2};
Transfinite Curve {1} = contact_elements + 1;
Physical Surface("top") = {1}; Physical Surface("seat") = {2};
Physical Curve("cone") = {1}; Physical Curve("push") = {3}; Physical Curve("bed") = {6};
"""


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("rise", [5.0, 20.0, -20.0])
def test_a_cone_on_the_axis_is_shown_from_its_tip(
    shared_tmp_path: Path, rise: float, degree: int
) -> None:
    """A cylinder cut along a cone that sticks, pressed uniformly; the axis holds the tip."""
    file = shared_tmp_path / "tip.geo"
    rf.on_root(comm, lambda: file.write_text(TIP.replace("RISE", str(rise))))
    scene = rf.Scene(
        body=rf.Body(name="top", mesh=str(file), surface="top"),
        others=(rf.Body(name="seat", mesh=str(file), surface="seat"),),
        material=rf.Material(E, NU, "axisymmetric"),
        mesh=rf.MeshOptions(contact_elements=8, degree=degree),
        contacts=(rf.Contact(edge="top.cone", against="seat.cone", friction=6.0),),
        loads=(rf.Load("push", "top.push", pressure=1.0),),
        supports=(rf.Support("y", edge="seat.bed"),),
        history=rf.HistoryOptions(kind="monotonic"),
    )
    record = played(scene)
    x, table = record.x, record.turning_points
    length = np.hypot(10.0, rise)
    assert record.radius is not None and record.radius == pytest.approx(x * 10.0 / length)
    p, q = 100.0 / length**2, 10.0 * rise / length**2
    assert np.all(table.state == 1)
    inner = slice(3, -1)
    assert table.p[0, inner] == pytest.approx(p, rel=0.02)
    assert np.abs(table.q[0, inner]) == pytest.approx(abs(q), rel=0.02)
    assert np.array_equal(whole_contact_at_rest(scene)[0].x, x)


def test_pictures_show_a_fit_once_and_a_plane_on_both_sides_of_the_axis(
    shared_tmp_path: Path,
) -> None:
    """Both at once: the shaft stands on a plane and sits in a hub."""
    several = (
        rf.Contact(edge="shaft.push", span=(0.0, 15.0), friction="0.1 + 0.01*x"),
        rf.Contact(edge="shaft.fit", against="hub.fit", friction="0.3 + 0.01*x"),
    )
    text = SECTION.replace("{10,", "{0,") + "Transfinite Curve {1} = 5;"
    scene = pressed_in(shared_tmp_path, 0.0)
    scene = replace(scene, contacts=several, loads=(), supports=())
    rf.on_root(comm, lambda: (shared_tmp_path / "fit.geo").write_text(text.replace("TAPER", "0")))
    found, edge = whole_contact_at_rest(scene)
    plane, fit = (found.edge == k for k in (0, 1))
    own = [int(np.sum(edge == k)) for k in (0, 1)]
    # at order 2 no node on the axis
    assert [int(plane.sum()), int(fit.sum())] == [2 * own[0], own[1]]
    assert np.allclose(found.points[plane, 0], found.x[plane])
    assert found.state[plane].tolist() == [4] * own[0] + [3] * own[0]
    assert np.all(found.points[fit, 0] == 20.0) and found.x[fit][0] == -9.5
    assert np.array_equal(found.argument[fit], found.x[fit])
    assert np.array_equal(found.argument[plane], np.abs(found.x[plane]))
