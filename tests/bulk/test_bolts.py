"""Bolts: the joint diagram of two springs, a lap joint, probes, work."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import block, played

import receding_fenicsx as rf

E = 2.0
JOINT = 8.0  # E times width over both heights


def clamped(stiffness: float | None, degree: int = 1) -> rf.Scene:
    """Two layers without Poisson's effect, clamped by a bolt over all of their outer edges."""
    bodies = [rf.Body(name, height=0.5, position=(0.0, y)) for name, y in (("a", 0.5), ("b", 0.0))]
    return replace(
        block(degree=degree, material=rf.Material(E, 0.0)),
        body=bodies[0],
        others=(bodies[1],),
        contacts=(rf.Contact("a.bottom", friction=0.0, against="b.top"),),
        loads=(
            rf.Load("pull", "a.top", traction=(0.0, 1.0)),
            rf.Load("pull", "b.bottom", traction=(0.0, -1.0)),
        ),
        supports=(
            rf.Support("x", edge="a.left"),
            rf.Support("x", edge="b.left"),
            rf.Support("y", point=(0.0, 0.0), body="b"),
        ),
        bolts=(rf.Bolt("bolt", "a.top", "b.bottom", 0.04, stiffness=stiffness),),
        history=rf.HistoryOptions("table", columns=("pull",), rows=((0.03,), (0.2,), (0.01,))),
    )


def with_preloads(scene: rf.Scene, *forces: float) -> rf.Scene:
    """The scene with preloads in the place of shortenings."""
    pairs = zip(scene.bolts, forces, strict=False)
    bolts = tuple(replace(bolt, shortening=None, preload=force) for bolt, force in pairs)
    return replace(scene, bolts=bolts)


@pytest.mark.one_rank
@pytest.mark.parametrize("preload", [None, 0.15])
@pytest.mark.parametrize("round_", [False, True])
@pytest.mark.parametrize(("degree", "k"), [(1, 3.0), (2, 3.0), (2, 1e4), (1, np.inf)])
def test_joint_diagram_of_two_springs(
    k: float, degree: int, round_: bool, preload: float | None
) -> None:
    """F0 = s / (1/k + 1/k_j); a pull X adds X k / (k + k_j), and X itself once the joint gapes.

    With a rigid bolt F = F0 + X, and nothing of X reaches the contact. A preload F0 is reached, and
    the length then locked. Of a ring the same holds on the full circle.
    """
    scene, area = clamped(k if k < np.inf else None, degree), 4.0
    if round_:
        area = 4.0 * np.pi
        foot = (rf.Support("y", point=(0.0, 0.0), body="b"),)
        scene = replace(scene, material=rf.Material(E, 0.0, "axisymmetric"), supports=foot)
    if preload is not None:
        scene = with_preloads(scene, preload)
    record = played(scene)
    table, joint = record.turning_points, E * area
    share = 1.0 / (1.0 + joint / k)
    F0 = preload or 0.04 * joint * share
    pull = area * np.array([0.0, 0.03, 0.2, 0.01])
    gapes = F0 < pull * (1.0 - share)
    force = np.where(gapes, pull, F0 + share * pull)
    assert record.load_names == ("pull", "bolt")
    np.testing.assert_allclose(table.load[:, 1], F0 / k + F0 / joint, rtol=1e-9)
    np.testing.assert_allclose(table.load_displacement[:, 1], force, rtol=1e-9)
    np.testing.assert_allclose(table.P.sum(axis=1), force - pull, atol=1e-9)
    assert record.energy_error_max < 1e-10 and record.scene is not None
    assert rf.from_toml(rf.to_toml(record.scene)) == record.scene


@pytest.mark.one_rank
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_bolt_that_is_not_fitted_yet_follows_an_overlap_without_force(friction: float) -> None:
    """Until its turn s = -overlap, and nothing presses; then s = F (1/k + 1/k_j) - overlap."""
    scene, overlap, F, pull = with_preloads(clamped(3.0), 0.02), 0.003, 0.02, 0.003
    scene = replace(
        scene,
        contacts=(replace(scene.contacts[0], friction=friction, interference=overlap),),
        supports=scene.supports[bool(friction) :],  # friction alone holds the upper one
        history=rf.HistoryOptions("table", columns=("pull",), rows=((pull,),)),
    )
    table = played(scene).turning_points
    tight = F / 3.0 + F / JOINT - overlap
    np.testing.assert_allclose(table.load[:, 1], [-overlap, tight, tight], rtol=1e-9)
    left = F - 4.0 * pull * JOINT / (3.0 + JOINT)
    np.testing.assert_allclose(table.P.sum(axis=1), [0.0, F, left], rtol=1e-9, atol=1e-11)


@pytest.mark.one_rank
def test_bolts_are_tightened_to_their_preloads_one_after_the_other() -> None:
    slow = rf.HistoryOptions("monotonic", load="pull", maximum=0.1, constant={"kept": 1.0})
    loads = (*lap().loads, rf.Load("kept", "a.right", traction=(1e-4, 0.0)))
    scene = with_preloads(lap(probes=(), history=slow, loads=loads), 0.01, 0.03)
    record = played(scene)
    first, second = record.turning_points.load[:, 2:].T
    # once tightened, their lengths are locked under the next one, what is constant and what grows
    assert first.tolist() == 4 * [first[0]] and np.all(second[1:] == second[1]) and second[1]
    force = record.turning_points.load_displacement[:, 2:]
    # the second one carries nothing before its turn; the first one follows
    np.testing.assert_allclose(force[0], [0.01, 0.0], atol=1e-11)
    assert force[1, 1] == pytest.approx(0.03, rel=1e-9) and force[1, 0] != force[0, 0]
    assert record.energy_error_max < 1e-9 and record.residual_max < 1e-9
    assert rf.from_toml(rf.to_toml(rf.given(record.scene))) == record.scene
    # an elastic one is shortened by its own lengthening more
    soft = replace(scene, bolts=(scene.bolts[0], replace(scene.bolts[1], stiffness=4.0)))
    longer = played(soft).turning_points.load[-1, 3] - second[1]
    assert longer == pytest.approx(0.03 / 4.0, rel=1e-9)
    # a scene with the shortenings that were found has the same path
    one = replace(scene, bolts=scene.bolts[:1])
    found = played(one)
    (bolt,) = rf.given(found.scene).bolts
    plain = played(replace(one, bolts=(replace(bolt, preload=None, tightening=()),)))
    np.testing.assert_array_equal(plain.turning_points.P, found.turning_points.P)
    # that of the first bolt alone, up to what the second one carries within the leg
    assert bolt.shortening == pytest.approx(first[0], rel=2e-3)


@pytest.mark.one_rank
def test_bolts_draw_parts_over_a_gap_or_say_that_they_cannot() -> None:
    scene = lap(probes=(), history=rf.HistoryOptions(kind="monotonic", maximum=0.1))
    scene = replace(scene, contacts=(replace(scene.contacts[0], initial_gap="0.01*x**2"),))
    force = played(with_preloads(scene, 0.01, 0.03)).turning_points.load_displacement[:2, 1:]
    np.testing.assert_allclose([*force[0], force[1, 1]], [0.01, 0.0, 0.03], atol=1e-10)
    # nothing tells where a plate without bolts floats
    scene = replace(scene, contacts=(replace(scene.contacts[0], initial_gap=0.05),))
    with pytest.raises(rf.SolveError, match=r"bolt 'one': the shortening .* not found") as error:
        played(with_preloads(scene, 0.01, 0.03))
    assert "\n" not in str(error.value)


def test_bolt_in_one_body_prestresses_it() -> None:
    """A block, nu = 0, between head and nut: s + L alpha dT = F (1/k + L / (E H))."""
    scene = block(
        degree=1,
        material=rf.Material(E, 0.0),
        loads=(rf.Load("heat", thermal_strain=0.01),),
        supports=(rf.Support("y", edge="top"),),
        contacts=(rf.Contact(friction=0.0),),
        bolts=(rf.Bolt("tie", "left", "right", 0.1, axis=(2.0, 0.0), stiffness=3.0),),
        history=rf.HistoryOptions(kind="monotonic"),
        probes=(rf.Probe("s", points=((0.3, 0.4),)),),
    )
    record = played(scene)
    force = (0.1 + 4.0 * 0.01) / (1.0 / 3.0 + 4.0 / E)
    assert record.turning_points.load_displacement[-1, 1] == pytest.approx(force, rel=1e-9)
    stress = record.probe("s").stress[-1, 0, :2]
    assert stress == pytest.approx([-force, -E * 0.01], rel=1e-9)


def lap(**parts: Any) -> rf.Scene:
    """Two overlapping plates, clamped by two bolts, pulled to and fro."""
    scene = replace(
        block(degree=1, elements=24, growth=1.6),
        body=rf.Body("a", width=3.0, height=0.4, position=(-0.5, 0.4)),
        others=(rf.Body("b", width=3.0, height=0.4, position=(0.5, 0.0)),),
        contacts=(rf.Contact("a.bottom", span=(-0.5, 1.5), friction=0.4, against="b.top"),),
        loads=(rf.Load("pull", "a.left", traction=(-0.012, 0.0)),),
        supports=(rf.Support("xy", edge="b.right"),),
        bolts=(
            rf.Bolt("one", "a.top", "b.bottom", 0.01, (-0.25, 0.25), (-1.25, -0.75), stiffness=2.0),
            rf.Bolt("two", "a.top", "b.bottom", 0.01, (0.75, 1.25), (-0.25, 0.25)),
        ),
        history=rf.HistoryOptions(kind="cyclic", minimum=-1.0, cycles=20, until="steady"),
        probes=(rf.Probe("s", points=((-0.5, 0.6), (0.3, 0.7)), body="a"),),
    )
    return replace(scene, **parts)
