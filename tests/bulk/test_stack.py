"""Stacks of bodies: balanced loads without supports, mirrored bodies, moduli far apart."""

from dataclasses import replace

import numpy as np
import pytest
from bodies import played

import receding_fenicsx as rf


def layers(heights: tuple[float, ...], young: tuple[float, ...], *loads: rf.Load) -> rf.Scene:
    """Smooth layers b0, b1, ... of width 4 on each other, the lowest one on a plane."""
    levels = np.cumsum([0.0, *heights])
    bodies = [
        rf.Body(f"b{k}", width=4.0, height=height, position=(0.0, float(levels[k])))
        for k, height in enumerate(heights)
    ]
    contacts = [
        rf.Contact(f"b{k}.bottom", friction=0.0, against=f"b{k - 1}.top" if k else None)
        for k in range(len(heights))
    ]
    return rf.Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        materials=tuple(
            rf.Material(E, 0.3, name=body.name) for E, body in zip(young, bodies, strict=True)
        ),
        mesh=rf.MeshOptions(contact_elements=16, degree=2, growth=1.3),
        contacts=tuple(contacts),
        loads=loads,
        history=rf.HistoryOptions(kind="monotonic"),
    )


@pytest.mark.parametrize("symmetry", ["auto", "none"])
def test_a_stack_that_nothing_holds_carries_balanced_loads(symmetry: str) -> None:
    """Layers of any moduli without friction are in uniaxial stress."""
    loads = [rf.Load("p", edge, pressure=1.0) for edge in ("b0.bottom", "b2.top")]
    scene = layers((1.0, 0.5, 1.5), (1.0, 2.0, 0.5), *loads)
    scene = replace(scene, contacts=scene.contacts[1:], solver=rf.SolverOptions(symmetry=symmetry))
    record = rf.run(scene)
    if record is not None:
        assert len(record.by_edge()) == 2
        assert record.turning_points.p[-1] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.one_rank
@pytest.mark.parametrize("symmetry", ["auto", "none", "axis"])
@pytest.mark.parametrize("friction", [0.0, 0.35])
def test_mirrored_bodies_and_loads_are_one_body_on_a_frictionless_plane(
    symmetry: str, friction: float
) -> None:
    round_axis = symmetry == "axis"
    load = rf.Load("p0", "top", (0.0 if round_axis else -1.0, 1.0), pressure=1.0)
    one = rf.Scene(
        material=rf.Material(kinematics="axisymmetric" if round_axis else "plane strain"),
        mesh=rf.MeshOptions(contact_elements=16),
        contacts=(rf.Contact(friction=0.0),),
        loads=(load,),
        history=rf.HistoryOptions(cycles=2),
        solver=rf.SolverOptions(symmetry="auto" if round_axis else symmetry),
    )
    two = replace(
        one,
        body=rf.Body("a"),
        others=(rf.Body("b", position=(0.0, -1.0)),),
        contacts=(rf.Contact("a.bottom", against="b.top", friction=friction),),
        # parts of one load: nothing but their balance holds the bodies
        loads=(replace(load, edge="a.top"), replace(load, edge="b.bottom")),
    )
    a, b = (played(scene).turning_points for scene in (one, two))
    scale = np.abs(a.P).max()
    assert np.abs(a.P - b.P).max() < 1e-11 * scale
    assert np.abs(b.Q).max() < 1e-11 * scale
    assert np.array_equal(a.state == rf.State.SEPARATION, b.state == rf.State.SEPARATION)
    assert np.abs(2.0 * a.w - b.w).max() < 1e-10 * np.abs(a.w).max()
    assert b.load_displacement == pytest.approx(2.0 * a.load_displacement, rel=1e-10)


@pytest.mark.one_rank
def test_ratio_of_moduli_that_costs_too_many_figures_is_said() -> None:
    for young, words in (
        ((1e-9, 1.0), "resists a rigid .*; bring"),
        ((1.0, 1e-15, 1.0), "is singular .*"),
    ):
        load = rf.Load("p", f"b{len(young) - 1}.top", pressure=1.0)
        with pytest.raises(rf.SolveError, match=f"{words} Young's moduli closer together"):
            played(layers((1.0,) * len(young), young, load))
