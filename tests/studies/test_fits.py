"""Fits of reduced joint models against curves of their own closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import receding_fenicsx as rf
from receding_fenicsx.studies.joint.fits import iwan, jenkins

pytestmark = pytest.mark.one_rank


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

    def integral(of: str, x: float) -> float:
        weigh = {"F": lambda p: min(p, x), "D": lambda p: 4 * max(x - p, 0) * p}[of]
        # x = y^m takes the singularity away
        m = 1 / (chi + 1)
        part = quad(
            lambda y: weigh(y**m) * R * m,
            0,
            phi_max ** (1 / m),
            points=[min(x, phi_max) ** (1 / m)],
        )
        return part[0] + S * weigh(phi_max)

    for x in (0.2 * phi_max, 0.9 * phi_max, 1.5 * phi_max):
        F, D = iwan(np.array([x]), F_S, K_T, chi, beta)
        assert F[0] == pytest.approx(integral("F", x), rel=1e-7)
        assert D[0] == pytest.approx(integral("D", x), rel=1e-7)
    assert iwan(np.array([2 * phi_max]), F_S, K_T, chi, beta)[0][0] == F_S
    small = iwan(np.array([1e-9]), F_S, K_T, chi, beta)[0][0]
    assert small == pytest.approx(K_T * 1e-9, rel=1e-3)


@pytest.mark.parametrize(
    "true",
    [(3.0, 5.0, -0.4, 0.5), (2e4, 1e8, -0.1, 3.0), (1.0, 1.0, -0.7, 0.05)],
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
    assert fit.parameters["k"] == pytest.approx(k, rel=1e-6)
    assert fit.parameters["phi"] == pytest.approx(phi, rel=1e-6)
    assert fit.parameters["k0"] == pytest.approx(k0, rel=1e-6)
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


def test_curves_that_cannot_be_fitted_are_refused() -> None:
    x = np.linspace(0.5, 1.0, 6)
    with pytest.raises(rf.InputError, match="have to be positive"):
        rf.fit_iwan(x, 0 * x, x, 2.0)
    with pytest.raises(rf.InputError, match="at least the amplitude"):
        rf.fit_iwan(x, x, x, 0.9)
    with pytest.raises(rf.InputError, match="at least 4"):
        rf.fit_jenkins(x[:3], x[:3], x[:3], 1)
    with pytest.raises(rf.InputError, match="must be 1 to 5"):
        rf.fit_jenkins(x, x, x, 6)
