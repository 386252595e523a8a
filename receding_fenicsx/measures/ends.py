"""Fits at the ends of a contact: half widths, and exponents of stress at corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import STATE_NAMES, State
from receding_fenicsx.interface.measures.tractions import Tractions
from receding_fenicsx.interface.measures.zone_ends import (
    ZoneEnd,
    contact_half_width_estimate,
    corner_exponent_fit,
    dundurs_beta,
    kolosov,
    stick_half_width_estimate,
    zone_ends,
)
from receding_fenicsx.interface.measures.zones import (
    FRICTIONLESS_CONTACT,
    contact_half_width,
    stick_half_width,
)
from receding_fenicsx.reference.corners import corner_exponent
from receding_fenicsx.scene.symmetry import edge_range


def half_width_estimates(record: Record, row: int, betas: tuple[float, ...] = ()) -> dict[str, Any]:
    """Estimate the half widths of one contact edge at a row of ``record.turning_points``.

    Of two possible values of Dundurs' constant, see :func:`contact_betas`, the interval contains
    the results of both, and the value is their mean. Returned are ``contact_half_width_estimate``
    and ``stick_half_width_estimate``, each with its value, an interval around it, and whether it
    was fitted (else the interval is that between nodes); None if there is no such half width.
    """
    return estimates_at(record, row, [tractions(record, row, beta) for beta in betas or (None,)])


def estimates_at(record: Record, row: int, found: Sequence[Tractions]) -> dict[str, Any]:
    """Return :func:`half_width_estimates` of tractions, one for each value of Dundurs' constant."""
    estimates = {"contact": contact_half_width_estimate, "stick": stick_half_width_estimate}
    ends = {name: [estimate(at) for at in found] for name, estimate in estimates.items()}
    bears = _bears(record, row)
    return {
        f"{name}_half_width_estimate": _shown(of) if bears and np.isfinite(of[0].value) else None
        for name, of in ends.items()
    }


def half_widths(record: Record, row: int) -> dict[str, float | None]:
    """Return the half widths at a turning point, to within a node spacing, or None.

    A contact without force has none; its states are the limit of those under a load.
    """
    x, state, axis = record.x, record.turning_points.state[row], record.begins_on_axis
    contact = contact_half_width(x, state, axis)
    stick = stick_half_width(x, state, record.friction.present, axis)
    widths = {"contact_half_width": contact, "stick_half_width": stick}
    bears = _bears(record, row)
    return {key: width if bears and np.isfinite(width) else None for key, width in widths.items()}


def _bears(record: Record, row: int) -> bool:
    """Return whether the contact carries a force at a turning point."""
    P = np.abs(record.turning_points.P)
    # part of the record's largest nodal force below which a force is round-off
    return bool(P[row].max(initial=0.0) > 1e-12 * P.max(initial=0.0))


def estimated_ends(record: Record, row: int, betas: tuple[float, ...] = ()) -> list[dict[str, Any]]:
    """Estimate the boundaries between zones, from left to right.

    Arguments and values are those of :func:`half_width_estimates`.
    """
    found = [zone_ends(tractions(record, row, beta)) for beta in betas or (None,)]
    return [_shown(ends) for ends in zip(*found, strict=True)]


def tractions(record: Record, row: int, beta: float | None = None) -> Tractions:
    """Return the data of fits of zone ends, at a row of ``record.turning_points``."""
    table = record.turning_points
    forces = table.P[row], table.Q[row], table.state[row]
    law, half, radius = record.friction, record.half, record.radius
    return Tractions(record.x, record.weight, *forces, law, beta, half, radius)


def contact_betas(record: Record) -> tuple[float, ...]:
    """Return Dundurs' beta of a contact edge, with the sign that belongs to slip towards +x.

    On a user's mesh of a body of revolution both signs are possible, because x is the radius.
    Without a scene, for several contact edges together, for bodies of several materials and
    orthotropic ones, none is returned.
    """
    numbers = set(record.edge.tolist())
    scene = record.scene
    if scene is None or len(numbers) != 1:
        return ()
    contact = scene.contacts[numbers.pop()]
    body, edge = scene.find_edge(contact.edge)
    bodies = [scene.find_edge(e)[0] for e in (contact.edge, contact.against) if e is not None]
    materials = [scene.material_of(each) for each in bodies]
    several = any(len(scene.surface_materials(each)) > 1 for each in bodies)
    if several or any(material.young_2 is not None for material in materials):
        return ()
    beta = dundurs_beta(*((m.young, m.poisson, m.kinematics) for m in materials))
    if body.mesh is not None:
        # x runs along t
        return (beta, -beta) if scene.axisymmetric and beta != 0.0 else (beta,)
    # edges of a rectangle whose x is opposite to the tangential direction t = (n_y, -n_x)
    return (-beta,) if edge in ("top", "left") else (beta,)


def _shown(ends: Sequence[ZoneEnd]) -> dict[str, Any]:
    interval = min(float(end.low) for end in ends), max(float(end.high) for end in ends)
    value = sum(float(end.value) for end in ends) / len(ends)
    return {"value": value, "interval": [*interval], "fitted": all(end.fitted for end in ends)}


def corners_of(record: Record, row: int) -> dict[str, Any]:
    """Return the corners in contact at a row of ``record.turning_points``, if there are any.

    Of each of ``corners`` the position, the state, the angle of the body, the exponent by the
    closed form (real part; None where no rectangle or half-plane touches a rigid plane) and the
    fitted one; ``p_max_singular`` where stresses are infinite.
    """
    at = tractions(record, row)
    found = []
    for k in record.corner_ends:
        side, state = (-1 if k == 0 else 1), State(int(at.state[k]))
        if state != State.SEPARATION and at.P[k] > 0.0:
            angle, exact = _closed_form(record, k, side, state)
            slides = state == State.STICK and not record.friction[k].present
            name = FRICTIONLESS_CONTACT if slides else STATE_NAMES[state]
            fits = {"exponent": exact, "fitted": corner_exponent_fit(at, side)}
            found.append({"x": float(record.x[k]), "state": name, "angle": angle, **fits})
    if not found:
        return {}
    return {"corners": found, "p_max_singular": any(map(is_singular, found))}


def is_singular(corner: Mapping[str, Any]) -> bool:
    """Return whether stresses are infinite at a corner of :func:`corners_of`."""
    exact, fitted = corner["exponent"], corner["fitted"]
    if exact is None:
        return fitted is not None and fitted < -0.05  # below the uncertainty of fits of 0
    return bool(exact < 0.0 and (fitted is None or fitted < 0.0))


def _closed_form(
    record: Record, k: int, side: int, state: State
) -> tuple[float | None, float | None]:
    """Return angle in degrees and real part of the exponent at an end, where they are known."""
    scene, law = record.scene, record.friction[k]
    if scene is None:
        return None, None
    contact = scene.contacts[int(record.edge[0])]
    body, edge = scene.find_edge(contact.edge)
    material = scene.material_of(body)
    if contact.against is not None or body.mesh is not None or material.young_2 is not None:
        return None, None
    angle, kappa = 180.0, kolosov(material.poisson, material.kinematics)
    if not body.is_half_plane:
        low, high = edge_range(scene, contact.edge)
        # an end this near to that of a rectangle's edge is its corner
        near = 1e-9 * (high - low)
        angle = 180.0 if low + near <= record.x[k] <= high - near else 90.0
    if state == State.STICK and law.present:
        return angle, _real_part(angle, kappa, None)
    # t runs against x on the top and the left edge
    along = -side if edge in ("top", "left") else side
    outwards = along if state == State.FORWARD_SLIP else -along
    f = abs(float(law.at_slip(np.asarray(int(state))))) if law.present else 0.0
    return angle, _real_part(angle, kappa, outwards * f)


@cache
def _real_part(angle: float, kappa: float, slip: float | None) -> float | None:
    try:
        return corner_exponent(angle, kappa, slip).real
    except SolveError:
        return None
