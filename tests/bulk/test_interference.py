"""Interference: shrink fits against Lame's pressure, and other ways to the same state."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, played
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import fields_at
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.stack import build_all
from receding_fenicsx.scene.identity import body_difference
from receding_fenicsx.scene.symmetry import is_half_meshed

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]
E, NU, DEPTH = 2.0, 0.3, 0.004
ONCE = rf.HistoryOptions(kind="monotonic")
A, B, C = 0.5, 1.0, 2.0


def ring(folder: Path, name: str, inner: float, outer: float) -> str:
    """A .geo file of a ring's section, 0 <= z <= 1."""
    file = folder / f"{name}.geo"
    text = (
        f"Point(1) = {{{inner}, 0, 0}}; Point(2) = {{{outer}, 0, 0}};\n"
        f"Point(3) = {{{outer}, 1, 0}}; Point(4) = {{{inner}, 1, 0}};\n"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};\n"
        "Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};\n"
        "Transfinite Curve {1, 3} = 17; Transfinite Curve {2, 4} = 9;\n"
        "Transfinite Surface {1}; Recombine Surface {1};\n"
        "Physical Surface('s') = {1}; Physical Curve('down') = {1};\n"
        "Physical Curve('out') = {2}; Physical Curve('up') = {3}; Physical Curve('in') = {4};\n"
    )
    rf.on_root(comm, lambda: file.write_text(text))
    return str(file)


def fit(folder: Path, young: float = E, **parts: Any) -> rf.Scene:
    """A ring shrunk on a hollow shaft, between smooth plates or with free ends."""
    scene = rf.Scene(
        body=rf.Body("hub", mesh=ring(folder, "hub", B, C)),
        others=(rf.Body("shaft", mesh=ring(folder, "shaft", A, B)),),
        material=rf.Material(E, NU, "axisymmetric"),
        materials=(rf.Material(young, NU, "axisymmetric", "shaft"),),
        mesh=rf.MeshOptions(contact_elements=8, cell="quadrilateral", degree=2),
        contacts=(rf.Contact("hub.in", friction=0.0, against="shaft.out", interference=DEPTH),),
        supports=(rf.Support("y", edge="hub.down"), rf.Support("y", edge="shaft.down")),
        history=ONCE,
        probes=(
            rf.Probe("hub", points=((1.5, 0.3),), body="hub"),
            rf.Probe("shaft", points=((0.75, 0.6),), body="shaft"),
        ),
    )
    return replace(scene, **parts)


def lame(young: float) -> float:
    """Pressure of the fit with free ends, in plane stress."""
    hub = ((C**2 + B**2) / (C**2 - B**2) + NU) / E
    shaft = ((B**2 + A**2) / (B**2 - A**2) - NU) / young
    return DEPTH / (B * (hub + shaft))


@pytest.mark.one_rank
@pytest.mark.parametrize("young", [2.0, 7.0])
def test_shrink_fit_has_lames_pressure(shared_tmp_path: Path, young: float) -> None:
    record = played(fit(shared_tmp_path, young))
    p = lame(young)
    assert record.turning_points.p[-1] == pytest.approx(p, rel=1e-4)
    # the conjugate is the depth times the force
    force = 2.0 * np.pi * B * p
    assert record.turning_points.load_displacement[-1, 0] == pytest.approx(DEPTH * force, rel=1e-5)
    hub, shaft = record.probe("hub"), record.probe("shaft")
    c = p * B**2 / (C**2 - B**2)
    r = 1.5
    srr, stt = c * (1.0 - (C / r) ** 2), c * (1.0 + (C / r) ** 2)
    np.testing.assert_allclose(hub.stress[-1, 0, [0, 2]], [srr, stt], atol=1e-3 * stt)
    assert hub.displacement[-1, 0, 0] == pytest.approx(r * (stt - NU * srr) / E, rel=1e-5)
    c, r = -p * B**2 / (B**2 - A**2), 0.75
    srr, stt = c * (1.0 - (A / r) ** 2), c * (1.0 + (A / r) ** 2)
    assert shaft.displacement[-1, 0, 0] == pytest.approx(r * (stt - NU * srr) / young, rel=1e-5)


@pytest.mark.one_rank
def test_fields_of_a_shrink_fit_are_the_true_ones(shared_tmp_path: Path) -> None:
    """The two surfaces, apart by the depth as made, meet: u_hub - u_shaft = depth."""
    scene = replace(fit(shared_tmp_path), probes=())
    record = played(scene)
    bulk = build_all(scene, make_meshes(comm, scene, True))
    end = record.turning_points
    assert np.abs(end.w[-1]).max() < 1e-12
    found = rf.given(fields_at(bulk, end.load[-1], np.concatenate([end.v[-1], end.w[-1]])))
    bulk.destroy()
    on = np.abs(found.points[:, 0] - B) < 1e-9
    radial = [found.displacement[on & (found.body == k), 0].mean() for k in (0, 1)]
    assert radial[0] - radial[1] == pytest.approx(DEPTH, rel=1e-9)
    p = lame(E)
    hub = ((C**2 + B**2) / (C**2 - B**2) + NU) / E * B * p
    assert radial[0] == pytest.approx(hub, rel=1e-5)


# -- a block that its support presses on the plane -----------------------------------------------

BULGE = "0.01*(1 - 0.1*x**2)"
HELD = (rf.Support("y", edge="top"),)
SHEAR = rf.Load("Q", "left", traction=(0.01, 0.0))


def wedged(**parts: Any) -> rf.Scene:
    scene = block(
        degree=2,
        loads=(rf.Load("P", "top", (-1.0, 1.0), traction=("0.06*x", 0.0)),),
        contacts=(rf.Contact(friction=0.3, interference=BULGE),),
        supports=HELD,
        history=rf.HistoryOptions(kind="cyclic", minimum=-1.0, cycles=3),
        probes=(rf.Probe("s", points=((-0.3, 0.1), (0.3, 0.1))),),
    )
    return replace(scene, **parts)


@pytest.mark.one_rank
def test_first_leg_closes_the_interference_alone() -> None:
    history = rf.history_from_scene(wedged(history=replace(wedged().history, cycles=2)))
    assert history.load_names == ("P", "interference")
    assert history.path.tolist() == [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    assert history.loop.tolist() == [[1.0, 1.0], [-1.0, 1.0], [1.0, 1.0]]


@pytest.mark.one_rank
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_pushing_the_far_side_by_the_depth_gives_the_same(friction: float) -> None:
    """A uniform interference against the displacement of the held edge by the same."""
    contacts = (rf.Contact(friction=friction, interference=0.01),)
    scene = wedged(
        contacts=contacts, loads=(), supports=(rf.Support("xy", edge="top"),), history=ONCE
    )
    other = replace(
        scene,
        contacts=(rf.Contact(friction=friction),),
        loads=(rf.Load("d", "top", displacement=(0.0, -0.01)),),
        supports=(),
    )
    a, b = played(scene), played(other)
    for name in ("P", "Q", "v"):
        one, two = (getattr(r.turning_points, name)[-1] for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-9 * np.abs(b.turning_points.P).max())
    ends = [r.turning_points.load_displacement[-1, 0] for r in (a, b)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)
    one, two = a.probe("s"), b.probe("s")
    np.testing.assert_allclose(one.stress[-1], two.stress[-1], atol=1e-9)
    shift = two.displacement[-1] - one.displacement[-1]
    np.testing.assert_allclose(shift, np.tile([0.0, -0.01], (2, 1)), atol=1e-11)


@pytest.mark.one_rank
@pytest.mark.parametrize("shape", [BULGE, "0.01 + 0.002*x"])
def test_a_gap_that_a_load_closes_is_an_interference(shape: str) -> None:
    fitted = wedged(contacts=(rf.Contact(friction=0.3, interference=shape),))
    steps = (0.0, 1.0), (1.0, 1.0)
    driven = wedged(
        contacts=(rf.Contact(friction=0.3),),
        loads=(*fitted.loads, rf.Load("d", "bottom", gap=f"-({shape})")),
        history=rf.HistoryOptions(
            kind="table", columns=("P", "d"), rows=steps, cycle_rows=((-1.0, 1.0), steps[1])
        ),
    )
    driven = replace(driven, history=replace(driven.history, cycles=3))
    assert is_half_meshed(driven) == is_half_meshed(fitted) == (shape == BULGE)
    a, b = played(fitted), played(rf.from_toml(rf.to_toml(driven)))
    for name in ("P", "Q", "v", "w", "load_displacement"):
        one, two = (getattr(r.turning_points, name)[-1] for r in (a, b))
        np.testing.assert_allclose(one, two, atol=1e-12 * np.abs(two).max())
    one, two = a.probe("s"), b.probe("s")
    np.testing.assert_allclose(one.displacement[-1], two.displacement[-1], atol=1e-14)


@pytest.mark.one_rank
def test_conjugate_of_a_pressure_is_its_integral_over_the_true_displacement() -> None:
    """Of an edge that the interference moves, too, though [v; w] has no part of it."""
    y = np.linspace(0.0, 1.0, 101)
    edge = rf.Probe("edge", points=tuple((-2.0, value) for value in y))
    push = rf.Load("P", "left", pressure="0.01*(1 + y)")
    record = played(wedged(loads=(push,), probes=(edge,)))
    inward, table = record.probe("edge").displacement[:, :, 0], record.turning_points
    weight = 0.01 * (1.0 + y) * 0.01 * np.where((y == 0.0) | (y == 1.0), 0.5, 1.0)
    rows = record.probe("edge").kind == "turning point"
    known = inward[rows] @ weight
    found = table.load_displacement[:, record.load_names.index("P")]
    assert found == pytest.approx(known, abs=1e-3 * np.abs(known).max())
    assert abs(found[0]) > 0.1 * np.abs(found).max()  # interference alone


def test_saved_system_belongs_to_its_interference(shared_tmp_path: Path) -> None:
    scene = wedged()
    assert rf.from_toml(rf.to_toml(scene)) == scene
    system = rf.condense(scene, comm)
    if system is None:
        return
    rf.write_system(shared_tmp_path / "system.h5", system)
    saved = rf.read_system(shared_tmp_path / "system.h5", scene)
    assert np.array_equal(saved.r_star, system.r_star)
    deeper = wedged(contacts=(rf.Contact(friction=0.3, interference=0.02),))
    assert body_difference(scene, deeper) == "[contact] interference"
    with pytest.raises(rf.InputError, match="interference"):
        rf.read_system(shared_tmp_path / "system.h5", deeper)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"loads": (rf.Load("P", "top", gap=0.1),)}, "load 'P' edge: unknown edge of a"),
        ({"loads": (rf.Load("P", "bottom", gap=0.0),)}, "load 'P' gap: is zero everywhere"),
        ({"loads": (rf.Load("P", "bottom", gap="1/x"),)}, "load 'P' gap: .* not a finite number"),
        (
            {"loads": (rf.Load("P", "bottom", gap=0.1, platen=True),)},
            "platen: needs force or displ",
        ),
    ],
)
def test_bad_interference_is_refused(parts: dict[str, Any], words: str) -> None:
    with pytest.raises(rf.InputError, match=words) as error:
        rf.condense(wedged(**parts), comm)
    assert "\n" not in str(error.value)


@pytest.mark.one_rank
def test_half_of_the_scene_is_half_meshed() -> None:
    assert is_half_meshed(wedged())
    lopsided = (rf.Contact(interference="0.01 + 0.001*x"),)
    assert not is_half_meshed(wedged(contacts=lopsided))
