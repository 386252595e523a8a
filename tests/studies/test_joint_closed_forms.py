"""Joints whose dissipation is known: a strip on a wall, two clamped beams, one node, a dovetail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

ROOT = Path(__file__).parents[2]
STRIP = ROOT / "tests" / "trials" / "strip_on_wall.toml"
BEAMS = ROOT / "tests" / "trials" / "goodman_klumpp.toml"
comm = MPI.COMM_WORLD

HEIGHT, YOUNG, LIMIT = 0.125, 1.0, 0.5 * 0.001
"""Strip: height, Young's modulus, limit q = f p of the traction."""


def test_a_strip_on_a_wall_obeys_shear_lag_to_second_order() -> None:
    """With u = F^2/(2 q E A) cycles 0..F dissipate F^3/(12 q E A), first loadings twice that."""
    scene = rf.read_scene(STRIP, ["mesh.contact_elements=80"])
    system = rf.condense(scene, whole=True)
    if system is None:
        return
    slender, errors, first, lengths = [], [], [], []
    for factor in (0.25, 0.5, 1.0):
        F = factor * 0.024 * HEIGHT
        slip_length, unit = F / LIMIT, F**3 / (LIMIT * YOUNG * HEIGHT)
        loop = np.array([[1.0, factor], [1.0, 0.0], [1.0, factor]])
        path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, factor]])
        record = rf.evolve(system, rf.History(("N", "P"), path, loop, 3))
        table = record.turning_points
        top = np.flatnonzero((table.cycle == 0) & (table.load[:, 1] > 0.9 * factor))[0]
        slips = np.isin(table.state[top], (rf.State.FORWARD_SLIP, rf.State.BACKWARD_SLIP))
        slender.append(slip_length / HEIGHT)
        errors.append(1.0 - record.cycles.dissipation[-1] / (unit / 12.0))
        first.append(1.0 - record.dissipation_first_loading / (unit / 6.0))
        lengths.append(slip_length - record.weight[slips].sum())
    for found, last in ((errors, 4e-3), (first, 9e-4)):
        order = np.polyfit(np.log(slender), np.log(found), 1)[0]
        assert order == pytest.approx(-2.0, abs=0.15) and 0.0 < found[-1] < last
    # ahead of the slip zone the strip still carries what friction takes on a part of its height
    assert np.ptp(lengths) < 1e-12 and 0.5 * HEIGHT < lengths[0] < HEIGHT


@pytest.mark.parametrize("length", [10.0, 40.0])
def test_two_clamped_beams_dissipate_as_goodman_and_klumpp_say(length: float) -> None:
    """The interface slips at once where its shear 3 V/(4 h) exceeds f p; stiffness falls to 1/4."""
    text = BEAMS.read_text().replace("width = 20.0", f"width = {length}")
    scene = rf.from_toml(text.replace("cycles = 2", "cycles = 100"), ["mesh.contact_elements=40"])
    system = rf.condense(scene)
    if system is None:
        return
    fp, height, young = 0.3 * 0.01, 1.0, 1000.0
    V, slip = 2.0 * 0.004 * height, 4.0 * height * fp / 3.0
    D = 8.0 * fp * length**3 * (V - slip) / (young * height**2)
    found = rf.evolve(system, scene).cycles.dissipation
    assert found[-1] == pytest.approx(D, rel=2e-4)
    assert np.ptp(found) < 1e-10 * D and len(found) == 100


def dovetail(elements: int) -> rf.Scene:
    """A pulled dovetail whose blade is shaken sideways."""
    scene = rf.read_scene(ROOT / "demos" / "dovetail.toml", [f"mesh.contact_elements={elements}"])
    shake = rf.Load("shake", "blade.pull", traction=(0.5, 0.0))
    return replace(scene, loads=(*scene.loads, shake))


def test_a_dovetail_has_estimates_on_its_own_mesh_file() -> None:
    coarse = rf.joint_curve(dovetail(16), "shake", [0.05, 0.2])
    fine = rf.joint_curve(dovetail(28), "shake", [0.2])
    if coarse is None or fine is None:
        return
    # the contact has slid under the pull: small amplitudes shake down, and Masing's rule fails
    assert coarse.kind == ("shakedown", "cyclic slip") and coarse.dissipation[0] == 0.0
    assert coarse.masing[0] == 0.0 and coarse.masing_defect[1] > 0.5
    change = abs(fine.dissipation[0] - coarse.dissipation[1])
    assert change < coarse.estimate[1] < 0.3 * coarse.dissipation[1]
    assert fine.estimate[0] < coarse.estimate[1]


@pytest.mark.parametrize("young", [1e4, 1e6])
def test_a_nearly_rigid_body_on_springs_dissipates_as_a_slider_beside_a_spring(
    young: float,
) -> None:
    """D = 4 f N (Q - f N) / k after few cycles, though forces repeat to their round-off only."""
    scene = rf.Scene(
        body=rf.Body(width=2.0, height=1.0),
        material=rf.Material(young, 0.3),
        mesh=rf.MeshOptions(contact_elements=16),
        contacts=(rf.Contact(friction=0.35, initial_gap=0.2),),
        springs=(rf.Spring("top", normal=0.7, tangential=0.4),),
        loads=(
            rf.Load("N", "top", pressure=1.0),
            rf.Load("Q", body_force=(1.0, 0.0)),
        ),
    )
    curve = rf.joint_curve(scene, "Q", [1.0])
    if curve is None:
        return
    limit = 0.35 * (2.0 - 0.2 * 1.4)
    assert curve.kind == ("cyclic slip",)
    assert curve.dissipation == pytest.approx(4.0 * limit * (2.0 - limit) / 0.8, rel=10.0 / young)
    assert curve.table["cycles"][0] <= 8
