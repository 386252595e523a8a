r"""Reduced models of a joint, fitted to its curve: sliders with springs in parallel.

A Jenkins element of stiffness k slips at the displacement $\phi$. With a density $\rho(\phi)$ of
stiffness the first loading and the loop between $\pm x$ are (Iwan 1966; Segalman 2005)

$$F(x) = \int_0^x \phi \rho \, d\phi + x \int_x^\infty \rho \, d\phi , \qquad
  D(x) = 4 \int_0^x (x - \phi)\, \phi \rho \, d\phi .$$

* Jenkins: $\rho = k_0 \delta(\infty) + \sum_i k_i \delta(\phi - \phi_i)$.
* Iwan's model of four parameters $F_S, K_T, \chi, \beta$: $\rho = R \phi^\chi$ below
  $\phi_{max}$ and $S \delta(\phi - \phi_{max})$, with
  $\beta = S (\chi + 1) / (R \phi_{max}^{\chi + 1})$.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError, NotConverged


@dataclass(frozen=True)
class JointFit:
    """A fitted model.

    Attributes:
        parameters: by name; arrays over the elements for Jenkins.
        dissipation_error: (n,) relative errors of D, in the order of the curve.
        stiffness_error: (n,) relative errors of the secant stiffness F(x)/x.
    """

    parameters: dict[str, Array]
    dissipation_error: Array
    stiffness_error: Array


def jenkins(x: Array, k: Array, phi: Array, k0: float = 0.0) -> tuple[Array, Array]:
    """Return F and D at displacement amplitudes x of elements in parallel with a spring k0."""
    over = np.maximum(np.subtract.outer(x, phi), 0.0)
    return k0 * x + np.minimum.outer(x, phi) @ k, 4.0 * over @ (k * phi)


def iwan(x: Array, F_S: float, K_T: float, chi: float, beta: float) -> tuple[Array, Array]:
    """Return F and D at displacement amplitudes x of Iwan's model of four parameters."""
    phi_max = F_S * (1.0 + beta) / (K_T * (beta + (chi + 1.0) / (chi + 2.0)))
    R = K_T * (chi + 1.0) / (phi_max ** (chi + 1.0) * (1.0 + beta))
    y = np.minimum(x, phi_max)
    F = K_T * y - R * y ** (chi + 2.0) / ((chi + 1.0) * (chi + 2.0))
    D = 4.0 * R * y ** (chi + 3.0) / ((chi + 2.0) * (chi + 3.0))
    # beyond phi_max all slip
    return np.where(x >= phi_max, F_S, F), D + 4.0 * np.maximum(x - phi_max, 0.0) * F_S


def fit_iwan(amplitude: Array, dissipation: Array, stiffness: Array, slip_force: float) -> JointFit:
    """Fit Iwan's model of four parameters to a curve by least squares of relative errors.

    ``amplitude`` are those of the force, ``dissipation`` is per cycle, positive, ``stiffness``
    secant, each (n,); ``slip_force`` is F_S, the force of macroslip. InputError: the curve does not
    determine the parameters. NotConverged: the fit did not converge.
    """
    x, F, D = _curve(amplitude, dissipation, stiffness)
    if not F.max() <= slip_force < np.inf:
        raise InputError(f"slip_force: must be finite, and at least the amplitude {F.max():g}")

    def named(p: Array) -> dict[str, float]:
        K_T, beta = np.exp(p[0]), np.exp(p[2])
        return {"F_S": slip_force, "K_T": float(K_T), "chi": float(p[1]), "beta": float(beta)}

    chi = np.clip(np.polyfit(np.log(x), np.log(D), 1)[0] - 3.0, -0.9, 0.9)
    starts = [[np.log(1.001 * np.max(F / x)), chi, beta] for beta in (0.0, -4.0, 4.0)]
    # of the logarithms of K_T and beta, and of the exponent chi, which must be above -1
    most = np.array([50.0, 0.999, 50.0])
    p = _least(lambda p: _errors(iwan(x, **named(p)), F, D), starts, (-most, most))
    errors = np.split(_errors(iwan(x, **named(p)), F, D), 2)
    return JointFit({k: np.array(v) for k, v in named(p).items()}, errors[1], errors[0])


def fit_jenkins(amplitude: Array, dissipation: Array, stiffness: Array, count: int) -> JointFit:
    """Fit Jenkins elements in parallel, and a spring, by least squares of relative errors.

    F and D are linear in the stiffnesses, which are not negative: they follow for each set of slip
    displacements, which are searched from twelve starts; the least of the minima found may not be
    the least of all. The curve and errors are as of :func:`fit_iwan`; ``count`` is the number of
    elements.
    """
    x, F, D = _curve(amplitude, dissipation, stiffness)
    if not 1 <= count < len(x):
        raise InputError(f"count: must be 1 to {len(x) - 1} for {len(x)} amplitudes, not {count}")

    def model(p: Array) -> tuple[Array, Array, Array]:
        phi = np.exp(p)
        parts = [jenkins(x, unit, phi) for unit in np.eye(count)]
        rows = [np.concatenate([f / F, d / D]) for f, d in parts]
        rows.append(np.concatenate([x / F, np.zeros(len(x))]))
        k = nnls(np.column_stack(rows), np.ones(2 * len(x)))[0]
        return k, *jenkins(x, k[:-1], phi, k[-1])

    # the first element slips at every amplitude, as D is positive
    starts = [
        np.log(np.geomspace(low * x.min(), high * x.max(), count + 1)[:count])
        for low in (0.5, 0.7, 0.95)
        for high in (0.3, 0.5, 0.7, 0.9)
    ]
    # one that slips later is a spring, of one that slips far earlier only the force is seen
    # least slip displacement of a Jenkins element, over the smallest amplitude
    limits = np.log(0.05 * x.min()), np.log(x.max())
    p = np.sort(_least(lambda p: _errors(model(p)[1:], F, D), starts, limits))
    k, *found = model(p)
    errors = np.split(_errors(found, F, D), 2)
    return JointFit({"k": k[:-1], "phi": np.exp(p), "k0": k[-1]}, errors[1], errors[0])


def _curve(amplitude: Array, dissipation: Array, stiffness: Array) -> tuple[Array, Array, Array]:
    """Return amplitudes of displacement, of force, and dissipation."""
    F, D, k = (np.asarray(part, dtype=float) for part in (amplitude, dissipation, stiffness))
    if F.ndim != 1 or not F.shape == D.shape == k.shape or len(F) < 4:
        raise InputError("fit: needs three arrays of one length, at least 4")
    if not all(np.all(np.isfinite(part) & (part > 0.0)) for part in (F, D, k)):
        raise InputError("fit: amplitudes, dissipation and stiffness have to be positive")
    return F / k, F, D


def _errors(model: Sequence[Array], F: Array, D: Array) -> Array:
    """Return the relative errors of F and D."""
    return np.concatenate([model[0] / F - 1.0, model[1] / D - 1.0])


def _least(
    errors: Callable[[Array], Array], starts: Sequence[Sequence[float]], bounds: tuple[Any, Any]
) -> Array:
    """Return the parameters of least squares within bounds, from several starts."""
    accuracy: dict[str, Any] = {"jac": "3-point", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    # "dogbox" comes to solutions on bounds, as of an element that slips early, where "trf" creeps
    way: dict[str, Any] = {"method": "dogbox", "x_scale": "jac", "bounds": bounds}
    runs = [least_squares(errors, at, **way, **accuracy) for at in starts]
    found = sorted((run for run in runs if run.success), key=lambda run: run.cost)
    if not found:
        raise NotConverged("fit: did not converge; use fewer elements or more amplitudes")
    for run in found:
        size = np.linalg.svd(run.jac, compute_uv=False)
        # a parameter without effect, as of an element of no stiffness, is no fit of all of them
        # sensitivity of relative errors, over the largest or 1, below which it is not determined
        if size[-1] > 1e-7 * max(1.0, size[0]):
            return np.asarray(run.x)
    raise InputError("fit: the curve does not determine all parameters; give more of them")
