"""Reduced models of joints: stiffness, mass, loads and contact, against what they are made from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.linalg import eigh

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.modal import mode_system
from receding_fenicsx.studies.joint.curve import _driven

pytestmark = pytest.mark.one_rank

BLOCK = Path(__file__).with_name("block.toml").read_text()
"""With the number of modes left open."""


def condensed(model: rf.ReducedModel, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K and the loads on given coordinates, the others free of forces."""
    rest = np.setdiff1d(np.arange(len(model.K)), keep)
    K, f = model.K, model.loads
    X = np.linalg.solve(K[np.ix_(rest, rest)], np.hstack([K[np.ix_(rest, keep)], f[:, rest].T]))
    reduced = K[np.ix_(keep, keep)] - K[np.ix_(keep, rest)] @ X[:, : len(keep)]
    return reduced, f[:, keep] - (K[np.ix_(keep, rest)] @ X[:, len(keep) :]).T


def test_statically_it_is_the_condensed_contact_and_its_mass_is_that_of_the_body() -> None:
    scene = rf.from_toml(BLOCK.format(count=3))
    model = rf.reduced_model(scene)
    whole = replace(scene, solver=replace(scene.solver, symmetry="none"))
    system = rf.given(rf.condense(whole, whole=True))
    m = 2 * system.n
    assert np.array_equal(model.C, np.eye(m, len(model.K)))
    K, f = condensed(model, np.arange(m))
    assert np.abs(K - system.K).max() < 1e-11 * np.abs(system.K).max()
    assert np.abs(f + system.r_star).max() < 1e-11 * np.abs(system.r_star).max()
    assert model.load_names == ("N",) and np.all(model.f == 0.4) and np.all(model.g0 == 0.0)
    # translations and the rotation about the middle of the edge
    zero, one = np.zeros(system.n), np.ones(system.n)
    parts = [[*one, *zero], [*zero, *one], [*zero, *model.points[:, 0]]]
    motions = np.pad(np.array(parts).T, ((0, 3), (0, 0)))
    assert np.abs(model.K @ motions).max() < 1e-9 * np.abs(model.K).max()
    mass = motions.T @ model.M @ motions
    # rho b h, and rho (b h^3 / 3 + h b^3 / 12) about the edge; the mass's centre lies above it
    assert np.diag(mass) == pytest.approx([4.0, 4.0, 2.0 * (2.0 / 3.0 + 8.0 / 12.0)], rel=1e-9)
    assert abs(mass[0, 2]) == pytest.approx(4.0 * 0.5, rel=1e-9)
    # a platen moves along with the translations
    pressed = BLOCK.replace("pressure = 0.01", "platen = true\nforce = [0.0, -0.01]")
    mass = motions.T @ rf.reduced_model(rf.from_toml(pressed.format(count=3))).M @ motions
    assert mass[:2, :2] == pytest.approx(4.0 * np.eye(2), abs=1e-8)
    assert np.abs(model.M[-3:, -3:] - np.eye(3)).max() < 1e-9
    assert np.diag(model.K)[-3:] == pytest.approx(model.omega**2, rel=1e-9)


def test_contact_nodes_that_a_support_holds_are_no_coordinates() -> None:
    scene, loads = rf.from_toml(BLOCK.format(count=3)), (rf.Load("T", "top", traction=(1.0, 0.0)),)
    supports = (rf.Support("xy", edge="left"),)
    history = replace(scene.history, load="N", constant={"T": 1.0})
    scene = replace(scene, loads=scene.loads + loads, supports=supports, history=history)
    system, model = rf.given(rf.condense(scene, whole=True)), rf.reduced_model(scene)
    free = np.flatnonzero(~system.held)
    K, f = condensed(model, np.arange(len(free)))
    assert len(model.K) == len(free) + 3 == 2 * system.n - 2 + 3
    assert np.abs(K - system.K[np.ix_(free, free)]).max() < 1e-11 * np.abs(system.K).max()
    assert f == pytest.approx(-system.r_star[:, free], abs=1e-11)
    assert np.array_equal(model.C[:, : len(free)], np.eye(2 * system.n)[:, free])


def test_frequencies_of_the_stuck_block_come_from_above_with_more_modes() -> None:
    scene = rf.from_toml(BLOCK.format(count=3))
    loaded = replace(scene, history=replace(scene.history, constant={"N": 1.0}))
    _, omega = mode_system(_driven(loaded, "mode:3", np.ones(1)))
    held = rf.reduced_model(scene)
    assert held.omega == pytest.approx(omega, rel=1e-9)
    # free at its contact: from above, nearer with more modes
    free = [
        np.sqrt(np.maximum(eigh(model.K, model.M, eigvals_only=True)[3:6], 0.0))
        for model in (rf.reduced_model(rf.from_toml(BLOCK.format(count=k))) for k in (2, 8, 60))
    ]
    assert np.all(free[0] >= free[1] * (1.0 - 1e-9)) and np.all(free[1] >= free[2] * (1.0 - 1e-9))
    assert free[1] == pytest.approx(free[2], rel=0.02)


def test_of_a_stack_the_contacts_are_relative_displacements() -> None:
    two: Any = {"forward": 0.2, "backward": 0.1}
    scene = rf.Scene(
        body=rf.Body("upper", width=2.0, height=0.5, position=(0.0, 1.0)),
        others=(rf.Body("lower", width=2.0, height=1.0),),
        material=rf.Material(100.0, 0.2, density=1.0),
        materials=(rf.Material(200.0, 0.3, density=2.0, name="lower"),),
        mesh=rf.MeshOptions(8),
        contacts=(
            rf.Contact("upper.bottom", (-1.0, 0.5), friction=0.4, against="lower.top"),
            rf.Contact("lower.bottom", None, two, 1e-3),
        ),
        springs=(rf.Spring("upper.bottom", (0.5, 1.0), 50.0, 20.0, against="lower.top"),),
        loads=(rf.Load("N", "upper.top", pressure=0.01),),
    )
    model = rf.reduced_model(scene)
    whole = replace(scene, solver=replace(scene.solver, symmetry="none"))
    system = rf.given(rf.condense(whole, whole=True))
    below = system.edge == 1
    assert np.array_equal(model.f, np.where(below, 0.2, 0.4))
    assert np.array_equal(model.f_backward, np.where(below, 0.1, 0.4))
    assert np.array_equal(model.g0, np.where(below, 1e-3, 0.0))
    # beside the springs the upper edge is 1.5 long
    assert [model.weight[k].sum() for k in (below, ~below)] == pytest.approx([2.0, 1.5])
    assert np.array_equal(model.points, system.points)
    # any u of the contacts with the rest free of forces: the least energy under C q = u
    n, m = model.C.shape
    assert model.loads.shape == (1, m)  # those of the springs are in K
    bordered = np.block([[model.K, model.C.T], [model.C, np.zeros((n, n))]])
    rng = np.random.default_rng(5)
    u = rng.standard_normal(n)
    q = np.linalg.lstsq(bordered, np.concatenate([np.zeros(m), u]), rcond=1e-13)[0][:m]
    assert np.abs(model.C @ q - u).max() < 1e-9
    assert q @ model.K @ q == pytest.approx(u @ system.K @ u, rel=1e-8)


def test_the_command_writes_what_the_function_returns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = tmp_path / "block.toml", tmp_path / "block.h5"
    scene.write_text(BLOCK.format(count=2))
    assert cli.main(["export", str(scene), "--reduced", "--out", str(out)]) == 0
    said, model = capsys.readouterr().out, rf.reduced_model(rf.from_toml(scene.read_text()))
    told = f"{len(model.K)} coordinates, {len(model.points)} contact nodes, modes with the contact"
    assert said.startswith(told) and f"{model.omega[0]:.6g}, {model.omega[1]:.6g}, written" in said
    with h5py.File(out) as file:
        assert np.array_equal(file["M"], model.M) and np.array_equal(file["C"], model.C)
        assert "C q" in file.attrs["description"]
    assert cli.main(["export", str(scene), "--reduced", "--out", str(out)]) == 2
    with pytest.raises(rf.InputError, match="exists"):
        model.save(out)
