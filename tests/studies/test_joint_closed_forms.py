"""Joints whose dissipation is known: a strip on a wall, two clamped beams, one node."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.studies.joint.fits import _least, iwan, jenkins

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

ROOT = Path(__file__).parents[2]
STRIP = ROOT / "tests" / "trials" / "strip_on_wall.toml"
BEAMS = ROOT / "tests" / "trials" / "goodman_klumpp.toml"

HEIGHT, YOUNG, LIMIT = 0.125, 1.0, 0.5 * 0.001
"""Strip: height, Young's modulus, limit q = f p of the traction."""


def test_a_strip_on_a_wall_obeys_shear_lag_to_second_order() -> None:
    """With u = F^2/(2 q E A) cycles 0..F dissipate F^3/(12 q E A), first loadings twice that."""
    scene = rf.read_scene(STRIP, ["mesh.contact_elements=80"])
    system = rf.given(rf.condense(scene, whole=True))
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
    fp, height, young = 0.3 * 0.01, 1.0, 1000.0
    V, slip = 2.0 * 0.004 * height, 4.0 * height * fp / 3.0
    D = 8.0 * fp * length**3 * (V - slip) / (young * height**2)
    found = rf.evolve(rf.given(rf.condense(scene)), scene).cycles.dissipation
    assert found[-1] == pytest.approx(D, rel=2e-4)
    assert np.ptp(found) < 1e-10 * D and len(found) == 100


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
        loads=(rf.Load("N", "top", pressure=2.5), rf.Load("Q", body_force=(1.0, 0.0))),
        # of its history only the other loads' factors count
        history=rf.HistoryOptions(constant={"N": 0.4}),
    )
    curve = rf.given(rf.joint_curve(scene, "Q", [1.0]))
    limit = 0.35 * (2.0 - 0.2 * 1.4)
    assert curve.kind == ("cyclic slip",)
    assert curve.dissipation == pytest.approx(4.0 * limit * (2.0 - limit) / 0.8, rel=10.0 / young)
    assert curve.table["cycles"][0] <= 8


def played(k: np.ndarray, phi: np.ndarray, k0: float, x: float) -> tuple[float, float]:
    """Return the force at +x and the work of a loop, element by element in small steps."""
    path = np.concatenate([np.linspace(0, x, 2001), np.linspace(x, -x, 4001)[1:]])
    path = np.concatenate([path, np.linspace(-x, x, 4001)[1:]])
    F, slid = np.zeros(len(path)), np.zeros(len(k))
    for i, u in enumerate(path):
        slid = np.clip(slid, u - phi, u + phi)
        F[i] = k0 * u + k @ (u - slid)
    u, f = path[2000:], F[2000:]
    return F[2000], float(0.5 * np.sum(np.diff(u) * (f[1:] + f[:-1])))


def test_jenkins_elements_slip_as_played_step_by_step() -> None:
    k, phi = np.array([2.0, 0.7, 1.1]), np.array([0.1, 0.35, 0.8])
    for x in (0.05, 0.2, 0.5, 1.2):
        F, D = played(k, phi, 0.3, x)
        force, loop = jenkins(np.array([x]), k, phi, 0.3)
        assert force[0] == pytest.approx(F, rel=1e-12)
        assert loop[0] == pytest.approx(D, rel=2e-3, abs=1e-12)


@pytest.mark.parametrize("chi", [-0.6, -0.2, 0.0])
def test_iwans_model_is_the_integral_over_its_density(chi: float) -> None:
    F_S, K_T, beta = 3.0, 5.0, 0.4
    phi_max = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    R = K_T * (chi + 1) / (phi_max ** (chi + 1) * (1 + beta))
    S = R * phi_max ** (chi + 1) / (chi + 1) * beta

    # its elements of Jenkins, the last one with all of S
    cuts = phi_max * np.linspace(0.0, 1.0, 4001) ** (1.0 / (chi + 1.0))
    k = np.append(np.diff(R * cuts ** (chi + 1) / (chi + 1)), S)
    phi = np.append(0.5 * (cuts[1:] + cuts[:-1]), phi_max)
    x = np.array([0.2, 0.9, 1.5]) * phi_max
    for found, known in zip(iwan(x, F_S, K_T, chi, beta), jenkins(x, k, phi, 0.0), strict=True):
        assert found == pytest.approx(known, rel=1e-5)
    assert iwan(np.array([2 * phi_max]), F_S, K_T, chi, beta)[0][0] == F_S
    small = iwan(np.array([1e-9]), F_S, K_T, chi, beta)[0][0]
    assert small == pytest.approx(K_T * 1e-9, rel=1e-3)


@pytest.mark.parametrize(
    "true", [(3.0, 5.0, -0.4, 0.5), (2e4, 1e8, -0.1, 3.0), (1.0, 1.0, -0.7, 0.05)]
)
def test_iwans_parameters_are_recovered(true: tuple[float, ...]) -> None:
    F_S, K_T, chi, beta = true
    phi_max = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    x = np.geomspace(0.02, 0.8, 15) * phi_max
    F, D = iwan(x, *true)
    fit = rf.fit_iwan(F, D, F / x, F_S)
    for name, value in zip(("F_S", "K_T", "chi", "beta"), true, strict=True):
        assert fit.parameters[name] == pytest.approx(value, rel=1e-9), name
    assert max(np.abs(fit.dissipation_error).max(), np.abs(fit.stiffness_error).max()) < 1e-12


def test_elements_of_jenkins_are_recovered() -> None:
    k, phi, k0 = np.array([3.0, 1.0]), np.array([0.2, 1.1]), 0.5
    x = np.linspace(0.25, 3.0, 25)
    F, D = jenkins(x, k, phi, k0)
    fit = rf.fit_jenkins(F[::-1], D[::-1], (F / x)[::-1], 2)
    for name, known in {"k": k, "phi": phi, "k0": k0}.items():
        assert fit.parameters[name] == pytest.approx(known, rel=1e-6), name
    assert np.abs(fit.dissipation_error).max() < 1e-8


@pytest.mark.parametrize("model", ["jenkins", "iwan"])
def test_errors_of_a_fit_are_those_of_its_model_point_by_point(model: str) -> None:
    x = np.geomspace(0.1, 1.0, 9)
    F, D = iwan(x, 2.0, 4.0, -0.3, 1.0)
    # no model meets this curve, and its points come in no order
    F, D = F * (1.0 + 0.02 * np.sin(7 * x)), D * (1.0 + 0.1 * np.cos(5 * x))
    mixed = np.random.default_rng(3).permutation(len(x))
    x, F, D = x[mixed], F[mixed], D[mixed]
    fit = rf.fit_jenkins(F, D, F / x, 2) if model == "jenkins" else rf.fit_iwan(F, D, F / x, 2.5)
    law: Any = jenkins if model == "jenkins" else iwan
    force, loop = law(x, **fit.parameters)
    assert fit.stiffness_error == pytest.approx(force / F - 1.0, abs=1e-12)
    assert fit.dissipation_error == pytest.approx(loop / D - 1.0, abs=1e-12)
    assert np.abs(fit.stiffness_error).max() > 1e-3 < np.abs(fit.dissipation_error).max()


def test_a_fit_of_six_elements_to_a_noisy_curve_gives_each_a_part() -> None:
    random = np.random.default_rng(8)
    x = np.geomspace(0.1, 1.0, 12) * random.uniform(0.5, 1.5)
    F, D = iwan(x, 2.0, 4.0, random.uniform(-0.6, 0.0), random.uniform(0.1, 2.0))
    F, D = (part * (1.0 + noise * random.normal(size=12)) for part, noise in ((F, 0.02), (D, 0.1)))
    found = rf.fit_jenkins(F, D, F / x, 6).parameters["k"]
    assert found.min() > 1e-3 * found.sum()


def test_least_squares_without_effect_of_a_parameter_are_passed_over() -> None:
    def errors(p: Array) -> Array:
        return np.array([p[0] + 2.0, 0.0, 0.1] if p[0] < 0.0 else [p[0] - 2.0, p[1] - 1.0, 0.2])

    assert _least(errors, [[-1.0, 0.0], [1.0, 0.0]], (-4.0, 4.0)) == pytest.approx([2.0, 1.0])
