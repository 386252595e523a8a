"""Contacts and ties whose nodes do not match, on straight and curved edges, and edges that meet."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import ONCE, last
from msh import grid, ring
from scipy.optimize import brentq

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.stack import contact_of
from receding_fenicsx.modal import _modes
from receding_fenicsx.output.report.run import slip_warnings
from receding_fenicsx.timing import Timer

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank


def blocks(folder: Path, degree: int, counts: tuple[int, int], round_: bool) -> rf.Scene:
    """Two blocks, one on the other, as wide, under uniform pressure 1 and, but rings, shear 0.3."""
    both = [
        rf.Body(name, mesh=grid(folder / f"{name}.msh", at, n, 3))
        for name, n, at in (
            ("a", counts[0], lambda s, t: (1.0 + 2.0 * s, 1.0 + t)),
            ("b", counts[1], lambda s, t: (1.0 + 2.0 * s**1.2, t)),
        )
    ]
    shear, kinematics = (0.0, "axisymmetric") if round_ else (0.3, "plane strain")
    loads = [rf.Load("p", "a.top", traction=(shear, -1.0))]
    for name in "" if round_ else "ab":
        loads += [
            rf.Load("p", f"{name}.{side}", traction=(0.0, tau))
            for side, tau in (("left", -shear), ("right", shear))
        ]
    return rf.Scene(
        body=both[0],
        others=(both[1],),
        material=rf.Material(2.0, 0.0, kinematics),
        materials=(rf.Material(5.0, 0.0, kinematics, "b"),),
        mesh=rf.MeshOptions(degree=degree, cell="quadrilateral"),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=0.5),),
        loads=tuple(loads),
        supports=(rf.Support("y" if round_ else "xy", edge="b.bottom"),),
        history=ONCE,
    )


@pytest.mark.parametrize("round_", [False, True])
@pytest.mark.parametrize("slave", [None, "edge", "against"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("counts", [(7, 5), (5, 8), (4, 4)])
def test_constant_pressure_and_shear_pass_a_joint_that_does_not_match(
    degree: int, counts: tuple[int, int], slave: str | None, round_: bool, shared_tmp_path: Path
) -> None:
    scene = blocks(shared_tmp_path, degree, counts, round_)
    scene = replace(scene, contacts=(replace(scene.contacts[0], slave=slave),))
    system, record = last(scene)
    n = counts[{None: int(counts[1] > counts[0]), "edge": 0, "against": 1}[slave]]
    assert system.n == degree * n + 1
    swapped = replace(scene, body=scene.others[0], others=(scene.body,))
    assert [*contact_of(scene)[1], *contact_of(swapped)[1]] == pytest.approx([2.0 / n] * 2)
    end, weight = record.turning_points, record.weight
    assert end.P[-1] == pytest.approx(weight, rel=1e-11)
    assert np.abs(end.Q[-1]) == pytest.approx(0.0 * weight if round_ else 0.3 * weight, abs=1e-12)
    assert np.abs(system.K @ system.rigid).max(initial=0.0) < 1e-12 * np.abs(system.K).max()


def rings(folder: Path, counts: tuple[int, int], degree: int, turn: float = 0.0) -> rf.Scene:
    """A ring from 1 to 2 pressed into one from 2 to 3 by an interference of 0.01."""
    inner = grid(folder / "i.msh", ring(1.0, 2.0), counts[0], max(counts) // 4)
    outer = grid(folder / "o.msh", ring(2.0, 3.0, turn), counts[1], max(counts) // 4)
    return rf.Scene(
        body=rf.Body("i", mesh=inner),
        others=(rf.Body("o", mesh=outer),),
        material=rf.Material(200.0, 0.3, "plane stress"),
        mesh=rf.MeshOptions(degree=degree, cell="quadrilateral"),
        contacts=(rf.Contact("i.top", against="o.bottom", friction=0.3, interference=0.01),),
        history=ONCE,
    )


LAME = 0.01 * 200.0 / (2.0 * ((9.0 + 4.0) / (9.0 - 4.0) + (4.0 + 1.0) / (4.0 - 1.0)))
"""Pressure between the rings: interference over the sum of both radial compliances."""


@pytest.mark.parametrize(("shift", "turn"), [(0, 0.0), (5, 0.0), (-7, 0.05)])
@pytest.mark.parametrize("degree", [1, 2])
def test_rings_with_interference_have_lames_pressure_with_the_order_of_the_elements(
    degree: int, shift: int, turn: float, shared_tmp_path: Path
) -> None:
    errors = []
    for n in (24, 48):
        scene = rings(shared_tmp_path, (n, n + shift * (n // 24)), degree, turn)
        system, record = last(scene)
        P, Q = record.turning_points.P[-1], record.turning_points.Q[-1]
        errors.append(np.abs(P / system.weight - LAME).max() / LAME)
        # also on the coarser side's chords, translations and rotation move nothing
        assert np.abs(system.K @ system.rigid).max() < 1e-13 * np.abs(system.K).max()
        assert system.n == n + max(shift, 0) * (n // 24)
        normal = -system.points / np.linalg.norm(system.points, axis=1)[:, None]
        force = P[:, None] * normal + Q[:, None] * normal @ [[0.0, -1.0], [1.0, 0.0]]
        assert np.abs(force.sum(axis=0)).max() < 1e-12 * P.sum()
        if not shift:
            assert np.ptp(P / system.weight) < 1e-11 and np.abs(Q).max() < 1e-13
            # every node of the ring's mesh carries, the middles of its chords do not
            assert system.x == pytest.approx(
                (np.arange(n) - (n // 2 - 1)) * 4.0 * np.sin(np.pi / n), abs=1e-12
            )
    assert errors[1] < (0.3 if not shift else 0.56 if degree == 1 else 0.35) * errors[0] < 0.02


@pytest.mark.parametrize(("degree", "limit"), [(1, 0.004), (2, 0.004)])
@pytest.mark.parametrize("interference", [None, 0.01])
def test_ring_in_a_rigid_circle_has_lames_pressure(
    degree: int, limit: float, interference: float | None, shared_tmp_path: Path
) -> None:
    """u_r = (2 p_i a^2 - p ((1 - nu) b^2 + (1 + nu) a^2)) b / (E (b^2 - a^2)) is 0 or -0.01."""
    young, nu, a, b = 200.0, 0.3, 1.0, 2.0
    soft = (1.0 - nu) * b**2 + (1.0 + nu) * a**2
    load = rf.Load("p", "bottom", pressure=1.0)
    found = last(
        rf.Scene(
            body=rf.Body(mesh=grid(shared_tmp_path / "r.msh", ring(a, b), 48, 12)),
            material=rf.Material(young, nu, "plane stress"),
            mesh=rf.MeshOptions(degree=degree, cell="quadrilateral"),
            contacts=(rf.Contact("top", interference=interference),),
            loads=() if interference else (load,),
            history=ONCE,
        )
    )
    system, record = found
    p = 0.01 * young * (b**2 - a**2) / (b * soft) if interference else 2.0 * a**2 / soft
    assert record.turning_points.P[-1] / system.weight == pytest.approx(p, rel=limit)


@pytest.mark.parametrize("edge", ["i.top", "o.bottom"])
def test_a_curved_edge_may_reach_beyond_the_other_one(edge: str, shared_tmp_path: Path) -> None:
    """Arcs of 120 and 180 degrees on each other carry what pulls the shorter one."""

    def arc(name: str, low: float, half: float, n: int) -> rf.Body:
        def at(s: Array, t: Array) -> tuple[Array, Array]:
            return (low + t) * np.cos((1 - 2 * s) * half), (low + t) * np.sin((1 - 2 * s) * half)

        return rf.Body(name, mesh=grid(shared_tmp_path / f"{name}.msh", at, n, 4))

    against = {"i.top": "o.bottom", "o.bottom": "i.top"}[edge]
    n, half = 24, np.pi / 3.0
    scene = rf.Scene(
        body=arc("i", 1.0, half, n),
        others=(arc("o", 2.0, 0.5 * np.pi, 31),),
        mesh=rf.MeshOptions(cell="quadrilateral", degree=1),
        contacts=(rf.Contact(edge, against=against, friction=0.3),),
        loads=(rf.Load("p", "i.bottom", traction=(1.0, 0.0)),),
        supports=(rf.Support("xy", edge="o.top"),),
        history=ONCE,
    )
    record = last(scene)[1]
    P, Q = record.turning_points.P[-1], record.turning_points.Q[-1]
    normal = -record.points / np.linalg.norm(record.points, axis=1)[:, None]
    force = P[:, None] * normal + Q[:, None] * normal @ [[0.0, -1.0], [1.0, 0.0]]
    assert force.sum(axis=0) == pytest.approx([-n * 2.0 * np.sin(half / n), 0.0], abs=1e-10)


HALF_PIN = """
DefineConstant[ contact_elements = 48, ratio = 1, size = 12 ];
n = ratio * contact_elements / 2; h = Pi / contact_elements;
Point(1) = {0, 0, 0, 0.06};
Point(2) = {0, -1, 0, h}; Point(3) = {1, 0, 0, h}; Point(4) = {0, 1, 0, h};
Circle(1) = {2, 1, 3}; Circle(2) = {3, 1, 4}; Line(3) = {4, 1}; Line(4) = {1, 2};
Point(5) = {0, -size, 0, size / 6}; Point(6) = {size, -size, 0, size / 6};
Point(7) = {size, size, 0, size / 6}; Point(8) = {0, size, 0, size / 6};
Line(5) = {2, 5}; Line(6) = {5, 6}; Line(7) = {6, 7}; Line(8) = {7, 8}; Line(9) = {8, 4};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {5, 6, 7, 8, 9, -2, -1}; Plane Surface(2) = {2};
Transfinite Curve {1, 2} = n + 1;
Physical Surface("pin") = {1}; Physical Surface("plate") = {2}; Physical Curve("rim") = {1, 2};
Physical Curve("axis") = {3, 4}; Physical Curve("sides") = {5, 9}; Physical Curve("top") = {8};
"""


def persson(angle: Array) -> Array:
    """Pressure of a pin of radius 1 in a hole of its size, pulled by 1 at its middle.

    Persson's solution for one material and an infinite plate (On the stress distribution of
    cylindrical elastic bodies in contact, Chalmers 1964; Ciavarella & Decuzzi, Int. J. Solids
    Struct. 38, 2001): without clearance b of the contact's half angle 2 arctan(b) is the root of
    ln(b^2 + 1) + 2 b^4 = 2, 84.83 degrees at any load.
    """
    b = brentq(lambda b: np.log(b**2 + 1.0) + 2.0 * b**4 - 2.0, 0.5, 1.5)
    y, w = np.tan(0.5 * angle), np.sqrt(b**2 + 1.0)
    s = np.sqrt((b**2 - y**2).clip(min=0.0))
    return 2.0 * s / (np.pi * w * (1.0 + y**2)) + np.log((w + s) / (w - s)) / (
        2.0 * np.pi * b**2 * w**2
    )


@pytest.mark.one_rank
@pytest.mark.parametrize("ratio", [1.0, 0.75])
def test_a_pin_in_a_hole_of_its_size_has_perssons_pressure(tmp_path: Path, ratio: float) -> None:
    """The size of the plate counts with its inverse: two sizes give the infinite one."""
    file = tmp_path / "pin.geo"
    file.write_text(HALF_PIN)
    pressure = []
    for size in (12.0, 24.0):
        parts = [
            rf.Body(name, mesh=str(file), surface=name, parameters={"size": size, "ratio": part})
            for name, part in (("pin", 1.0), ("plate", ratio))
        ]
        pull = "-exp(-(x**2 + y**2)/0.01)/(0.01*pi)"
        scene = rf.Scene(
            body=parts[0],
            others=(parts[1],),
            mesh=rf.MeshOptions(contact_elements=48, degree=2),
            contacts=(rf.Contact("pin.rim", friction=0.0, against="plate.rim"),),
            loads=(rf.Load("F", body="pin", body_force=(0.0, pull)),),
            supports=(
                rf.Support("x", edge="pin.axis"),
                rf.Support("x", edge="plate.sides"),
                rf.Support("xy", edge="plate.top"),
            ),
            history=ONCE,
        )
        record = rf.run(scene)
        assert record is not None
        angle = np.arctan2(record.points[:, 0], -record.points[:, 1])
        pressure.append(record.turning_points.p[-1])
        # the nodes beside 84.83 degrees
        touching = angle[pressure[-1] > 0.0].max()
        assert abs(touching - np.radians(84.83)) < np.pi / 48.0
    # not beside the axis and the end of the contact, where nodes do not match
    inside = (angle > 0.1) & (angle < 1.3)
    found = 2.0 * pressure[1] - pressure[0]
    assert found[inside] == pytest.approx(persson(angle[inside]), abs=4e-3)


@pytest.mark.parametrize("turn", [1e-3, 0.15])
def test_slips_beyond_half_an_element_of_a_curved_edge_are_a_warning(
    turn: float, shared_tmp_path: Path
) -> None:
    """A ring driven round and back in its circle slips by the radius times the angle."""
    scene = rf.Scene(
        body=rf.Body(mesh=grid(shared_tmp_path / "r.msh", ring(1.0, 2.0), 24, 4)),
        material=rf.Material(200.0, 0.3),
        mesh=rf.MeshOptions(degree=1, cell="quadrilateral"),
        contacts=(rf.Contact("top", friction=0.0, interference=0.01),),
        loads=(rf.Load("d", "bottom", displacement=(f"-{turn}*y", f"{turn}*x")),),
        history=rf.HistoryOptions("table", columns=("d",), rows=((1.0,), (0.1,))),
    )
    found = last(scene)
    lines = slip_warnings(found[1])
    assert len(lines) == (turn > 0.1)
    for line in lines:
        # 24 nodes on a circle of radius 2
        times = 2.0 * turn / (4.0 * np.sin(np.pi / 24))
        assert f"'top' slip by up to {2.0 * turn:.3g}, {times:.2g} times the distance" in line


# -- edges that meet -----------------------------------------------------------------------------


@pytest.mark.parametrize("joint", [0.0, 0.3, "tied"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("counts", [(4, 4, 4, 4), (4, 5, 6, 7)])
def test_four_blocks_around_a_point_are_in_uniform_stress(
    degree: int, counts: tuple[int, ...], joint: float | str, shared_tmp_path: Path
) -> None:
    """Two of them on a smooth plane where all are tied: the last tie says what the others do."""

    def block(name: str, n: int, x: float, y: float) -> rf.Body:
        path = shared_tmp_path / f"{name}.msh"
        return rf.Body(name, mesh=grid(path, lambda s, t: (x + s, y + t), n, n))

    corners = {"a": (0.0, 0.0), "b": (-1.0, 0.0), "c": (-1.0, -1.0), "d": (0.0, -1.0)}
    first, *others = (block(k, n, *at) for (k, at), n in zip(corners.items(), counts, strict=True))
    pairs = (
        ("a.left", "b.right"),
        ("c.right", "d.left"),
        ("a.bottom", "d.top"),
        ("b.bottom", "c.top"),
    )
    outer = {1.0: ("a.top", "b.top", "c.bottom", "d.bottom"), 0.6: ("a.right", "d.right")}
    outer[0.6] += ("b.left", "c.left")
    tied = joint == "tied"
    smooth = tuple(rf.Contact(edge, friction=0.0) for edge in outer[1.0][2:])
    loaded = {1.0: outer[1.0][: 2 if tied else 4], 0.6: outer[0.6]}
    found = last(
        rf.Scene(
            body=first,
            others=tuple(others),
            material=rf.Material(2.0, 0.3),
            mesh=rf.MeshOptions(degree=degree, cell="quadrilateral"),
            contacts=smooth
            if tied
            else tuple(rf.Contact(e, against=a, friction=float(joint)) for e, a in pairs),
            ties=tuple(rf.Tie(e, against=a) for e, a in pairs) if tied else (),
            loads=tuple(rf.Load("p", e, pressure=p) for p, edges in loaded.items() for e in edges),
            history=ONCE,
        )
    )
    system, record = found
    expected = np.where((system.edges < 2) & ~np.array(tied), 0.6, 1.0)
    P, Q = record.turning_points.P[-1], record.turning_points.Q[-1]
    assert P / system.weight == pytest.approx(expected, abs=1e-12)
    assert np.abs(Q).max() < 1e-13


QUARTERS = """
DefineConstant[ n = 8, m = 8 ];
Point(1) = {0, 0, 0};
For k In {0:3}
  For j In {1:4}
    r = j < 3 ? j : j - 1;
    Point(10 * j + k) = {r * Cos(k * Pi / 2), r * Sin(k * Pi / 2), 0};
  EndFor
EndFor
For k In {0:3}
  For j In {1:4}
    Circle(10 * j + k) = {10 * j + k, 1, 10 * j + (k + 1) % 4};
  EndFor
EndFor
Transfinite Curve{10:13, 20:23} = n + 1; Transfinite Curve{30:33, 40:43} = m + 1;
Curve Loop(1) = {20:23}; Curve Loop(2) = {10:13}; Plane Surface(1) = {1, 2};
Curve Loop(3) = {40:43}; Curve Loop(4) = {30:33}; Plane Surface(2) = {3, 4};
Physical Surface("i") = {1}; Physical Surface("o") = {2};
Physical Curve("i0") = {20}; Physical Curve("i1") = {21}; Physical Curve("i2") = {22};
Physical Curve("i3") = {23}; Physical Curve("o0") = {30}; Physical Curve("o1") = {31};
Physical Curve("o2") = {32}; Physical Curve("o3") = {33};
"""
"""A ring in a ring whose common circle is split into four edges."""


@pytest.mark.parametrize("other", [1.0, 0.75])
def test_ring_split_into_four_edges_that_meet_converges_to_lames_pressure(
    other: float, shared_tmp_path: Path
) -> None:
    """Beside the four nodes of two edges with the first power of the element length."""
    path, errors = shared_tmp_path / "ring.geo", []
    path.write_text(QUARTERS)
    for n in (12, 24):
        numbers = {"n": float(n), "m": other * n}
        both = [rf.Body(k, mesh=str(path), surface=k, parameters=numbers) for k in "io"]
        found = last(
            rf.Scene(
                body=both[0],
                others=(both[1],),
                material=rf.Material(200.0, 0.3, "plane stress"),
                contacts=tuple(
                    rf.Contact(f"i.i{k}", against=f"o.o{k}", friction=0.3, interference=0.01)
                    for k in range(4)
                ),
                history=ONCE,
            )
        )
        system, record = found
        assert system.n == 4 * (n - 1)
        p = record.turning_points.P[-1] / system.weight
        errors.append(np.abs(p / LAME - 1.0).max())
    assert errors[1] < 0.55 * errors[0] < 0.03


# -- ties ----------------------------------------------------------------------------------------


def layers(folder: Path, counts: tuple[int, int] | None, degree: int) -> rf.Scene:
    """Two layers of 4 by 0.5, tied, or one mesh of both; rubbed to and fro on a plane."""

    def layer(name: str, n: int, low: float, high: float, up: int) -> rf.Body:
        path = folder / f"{name or 'whole'}.msh"
        mesh = grid(path, lambda s, t: (4.0 * s - 2.0, low + (high - low) * t), n, up)
        return rf.Body(name, mesh=mesh)

    if counts is None:
        bodies = [layer("", 16, 0.0, 1.0, 4)]
        foot, top, side = "bottom", "top", "right"
    else:
        bodies = [layer("a", counts[0], 0.0, 0.5, 2), layer("b", counts[1], 0.5, 1.0, 2)]
        foot, top, side = "a.bottom", "b.top", "b.right"
    return rf.Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        material=rf.Material(2.0, 0.3),
        mesh=rf.MeshOptions(degree=degree, cell="quadrilateral"),
        contacts=(rf.Contact(foot, friction=0.4),),
        ties=() if counts is None else (rf.Tie("b.bottom", against="a.top"),),
        loads=(
            rf.Load("p", top, pressure="1 + 0.2*x"),
            rf.Load("q", side, (0.0, 0.5) if counts is None else None, traction=(0.2, 0.0)),
        ),
        probes=(rf.Probe("s", points=((0.3, 0.5), (1.0, 0.9)), body="b" if counts else None),),
        history=rf.HistoryOptions(
            "table",
            columns=("p", "q"),
            rows=((1.0, 0.0), (1.0, 1.0)),
            cycle_rows=((1.0, -1.0), (1.0, 1.0)),
            cycles=2,
        ),
    )


@pytest.mark.parametrize("degree", [1, 2])
def test_tied_layers_are_one_mesh(degree: int, shared_tmp_path: Path) -> None:
    """To round-off where nodes match, else up to the error of the mesh."""
    whole, same, coarse = (
        last(layers(shared_tmp_path, counts, degree)) for counts in (None, (16, 16), (16, 11))
    )
    (a, one), (b, two), (c, _) = whole, same, coarse
    scale = np.abs(a.K).max()
    assert np.abs(a.K - b.K).max() < 1e-13 * scale
    assert 1e-6 * scale < np.abs(a.K - c.K).max() < 6e-3 * scale
    assert np.abs(c.K @ c.rigid).max() < 1e-13 * scale and c.rigid.shape == (2 * c.n, 3)
    for name in ("P", "Q", "v", "load_displacement"):
        first, second = (getattr(r.turning_points, name) for r in (one, two))
        assert first == pytest.approx(second, abs=1e-12), name
    first, second = one.probe("s"), two.probe("s")
    assert first.displacement == pytest.approx(second.displacement, abs=1e-12)


def test_tied_layers_vibrate_as_one_mesh(shared_tmp_path: Path) -> None:
    found = []
    for counts in (None, (16, 16), (16, 11)):
        scene = layers(shared_tmp_path, counts, 2)
        scene = replace(scene, material=replace(scene.material, density=1.0))
        bulk = bulk_of(scene, MPI.COMM_SELF, Timer(None))
        found.append(_modes(bulk, np.ones(2 * len(bulk.contact.x), dtype=bool), 1, 3)[1])
        bulk.destroy()
    assert found[1] == pytest.approx(found[0], rel=1e-10)
    assert found[2] == pytest.approx(found[0], rel=1e-4) and found[2].min() > found[0].min()
