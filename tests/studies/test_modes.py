"""Vibration modes of preloaded contacts, and frequency and damping over the amplitude."""

from dataclasses import replace

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.modal import mode_system
from receding_fenicsx.studies.joint.curve import _driven


def block(width: float, height: float, elements: int, friction: float = 0.4) -> rf.Scene:
    """A block pressed on a plane."""
    return rf.Scene(
        body=rf.Body(width=width, height=height),
        material=rf.Material(200.0, 0.0, "plane stress", density=2.0),
        mesh=rf.MeshOptions(elements),
        contacts=(rf.Contact(friction=friction),),
        loads=(rf.Load("N", "top", pressure=0.01),),
    )


def driven(
    scene: rf.Scene, drive: str, preload: dict[str, float]
) -> tuple[rf.ContactSystem, np.ndarray]:
    """The system with a mode as its last load, and the frequencies up to it."""
    scene = replace(scene, history=replace(scene.history, constant=preload))
    return mode_system(_driven(scene, drive, np.ones(1)))


@pytest.mark.one_rank
def test_a_slender_block_that_sticks_vibrates_as_a_cantilever_and_a_bar() -> None:
    height, length = 0.05, 1.0
    scene, bar = block(height, length, 8), 0.5 * np.pi / length * np.sqrt(200.0 / 2.0)
    round_ = replace(scene, material=replace(scene.material, kinematics="axisymmetric"))
    assert driven(round_, "mode:1", {"N": 1.0})[1][0] == pytest.approx(bar, rel=1e-6)
    # along a contact without friction
    smooth = replace(block(1.5, 1.0, 8, 0.0), supports=(rf.Support("x", edge="left"),))
    _, omega = driven(smooth, "mode:3", {"N": 1.0})
    assert np.abs(omega / bar - 1.0 / 1.5).min() < 1e-3
    _, omega = driven(scene, "mode:5", {"N": 1.0})
    assert omega[3] == pytest.approx(bar, rel=1e-6)
    # Euler and Bernoulli: roots of cos x cosh x = -1
    roots = np.array([1.87510407, 4.69409113, 7.85475744])
    beam = roots**2 * np.sqrt(200.0 * height**2 / 12.0 / 2.0) / length**2
    lacking = 1.0 - omega[:3] / beam
    # shear and rotary inertia: with the square of height over wave length
    assert np.all((lacking > 0.0) & (lacking < 0.8 * (height * roots / length) ** 2))


@pytest.mark.one_rank
def test_the_system_of_a_mode_has_the_law_of_its_scene() -> None:
    law = {"friction": {"forward": 0.4, "backward": 0.3}, "cohesion": 2.0, "shear_limit": 5.0}
    scene = replace(block(4.0, 1.0, 8), contacts=(rf.Contact(**law),))  # type: ignore[arg-type]
    system, _ = driven(scene, "mode:1", {"N": 1.0})
    found = system.f, system.f_backward, system.cohesion, system.shear_limit
    for part, known in zip(found, (0.4, 0.3, 2.0, 5.0), strict=True):
        assert part is not None and np.all(part == known)


def test_frequency_and_damping_follow_from_the_loop() -> None:
    scene = block(4.0, 1.0, 16, friction=0.5)
    # the load of the mode shears the block
    curve = rf.joint_curve(scene, "mode:1", [1e-6, 0.0077, 0.0082])
    if curve is None:
        return
    system, omega = driven(scene, "mode:1", {"N": 1.0})
    assert curve.omega[0] == pytest.approx(omega[0], rel=1e-9) and curve.zeta[0] == 0.0
    assert f"omega = {omega[0]:.6g}" in repr(curve)
    a = curve.amplitude[2]
    names, held = system.load_names, np.array([1.0, 0.0])
    loop = held + np.array([[0.0, a], [0.0, -a], [0.0, a]])
    path = np.vstack([0.0 * held, held, loop[0]])
    record = rf.evolve(system, rf.History(names, path, loop, 40), until="limit")
    table = record.turning_points
    q = 0.5 * np.ptp(table.load_displacement[-3:, 1])
    D, square = record.cycles.dissipation[-1], a / q
    assert D > 0.0 and curve.omega[2] == pytest.approx(np.sqrt(square), rel=1e-9)
    assert curve.zeta[2] == pytest.approx(D / (2 * np.pi * square * q**2), rel=1e-9)
    assert curve.omega[0] > curve.omega[1] > curve.omega[2]
    assert curve.zeta[0] < curve.zeta[1] < curve.zeta[2]
    assert curve.estimate[2] < curve.dissipation[2]


@pytest.mark.one_rank
def test_bolts_and_springs_between_bodies_hold_a_mode() -> None:
    """Of two stiff blocks on elastic springs, w^2 = k / m, whichever way the springs are given."""
    heights = ("a", 1.0), ("b", 0.0)
    a, b = (rf.Body(n, width=1.0, height=1.0, position=(0.0, y)) for n, y in heights)
    scene = replace(
        block(1.0, 1.0, 8),
        body=a,
        others=(b,),
        material=rf.Material(1e6, 0.3, density=2.0),
        contacts=(rf.Contact("a.bottom", (-0.25, 0.25), 0.0, initial_gap=0.1, against="b.top"),),
        loads=(rf.Load("N", "a.top", traction=(0.0, 0.001)),),
        supports=(rf.Support("xy", edge="b.bottom"), rf.Support("x", edge="a.left")),
    )
    spans = (-0.5, -0.25), (0.25, 0.5)
    spread = tuple(rf.Spring("a.bottom", s, normal=0.6, against="b.top") for s in spans)
    bolt = rf.Bolt("tie", "a.top", "b.bottom", 1e-3, stiffness=0.3)
    for parts in ({"springs": spread}, {"bolts": (bolt,)}):
        _, omega = driven(replace(scene, **parts), "mode:1", {"N": 1.0})
        assert omega[0] == pytest.approx(np.sqrt(0.3 / 2.0), rel=1e-5)
    # cylinders on a ring of bolts, whose stiffness is that of all of them
    ring = replace(scene, material=replace(scene.material, kinematics="axisymmetric"))
    supports = (rf.Support("xy", edge="b.bottom"),)
    contacts = (replace(scene.contacts[0], span=(0.0, 0.25)),)
    ring = replace(ring, bolts=(bolt,), supports=supports, contacts=contacts)
    _, omega = driven(ring, "mode:1", {"N": 1.0})
    assert omega[0] == pytest.approx(np.sqrt(0.3 / (2.0 * np.pi * 0.5**2)), rel=1e-5)
