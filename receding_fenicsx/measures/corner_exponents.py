"""Stress exponents at corners in contact: closed form, fit, and where stresses are infinite."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import STATE_NAMES, State
from receding_fenicsx.interface.measures.power_fit import corner_exponent_fit
from receding_fenicsx.interface.measures.zone_ends import kolosov
from receding_fenicsx.interface.measures.zones import FRICTIONLESS_CONTACT
from receding_fenicsx.measures.half_widths import tractions
from receding_fenicsx.reference.corners import corner_exponent
from receding_fenicsx.scene.symmetry import edge_range


def corners_of(record: Record, row: int) -> dict[str, Any]:
    """Return the corners in contact at a turning point, and whether the pressure is singular there.

    Args:
        record: the record of one contact edge.
        row: row of ``record.turning_points``.

    Returns:
        ``corners``: for each the position, the state, the angle of the body, the exponent by the
        closed form (real part; None where no rectangle or half-plane touches a rigid plane) and
        the fitted one; ``p_max_singular`` where stresses are infinite. Nothing where no end
        of the contact edge touches.
    """
    at = tractions(record, row)
    found = []
    for k in record.corner_ends:
        side, state = (-1 if k == 0 else 1), State(int(at.state[k]))
        if state == State.SEPARATION or not at.P[k] > 0.0:
            continue
        angle = _angle(record, float(record.x[k]))
        fitted = corner_exponent_fit(at, side)
        exact = None if angle is None else _exponent(record, k, side, state, angle)
        slides = state == State.STICK and not record.friction[k].present
        found.append(
            {
                "x": float(record.x[k]),
                "state": FRICTIONLESS_CONTACT if slides else STATE_NAMES[state],
                "angle": angle,
                "exponent": exact,
                "fitted": fitted,
            }
        )
    if not found:
        return {}
    return {"corners": found, "p_max_singular": any(map(is_singular, found))}


def is_singular(corner: Mapping[str, Any]) -> bool:
    """Return whether stresses are infinite at a corner of :func:`corners_of`."""
    exact, fitted = corner["exponent"], corner["fitted"]
    if exact is None:
        # fitted exponent below which a corner counts as singular where no closed form is known
        return fitted is not None and fitted < -0.05
    return bool(exact < 0.0 and (fitted is None or fitted < 0.0))


def _angle(record: Record, x: float) -> float | None:
    """Return the angle of the body at an end of the contact, in degrees, where it is known."""
    scene = record.scene
    if scene is None:
        return None
    contact = scene.contacts[int(record.edge[0])]
    body, _ = scene.find_edge(contact.edge)
    orthotropic = scene.material_of(body).young_2 is not None
    if contact.against is not None or body.mesh is not None or orthotropic:
        return None
    if body.is_half_plane:
        return 180.0
    low, high = edge_range(scene, contact.edge)
    # distance from the end of a rectangle's edge, over its length, that is none
    near = 1e-9 * (high - low)
    return 90.0 if x < low + near or x > high - near else 180.0


def _exponent(record: Record, k: int, side: int, state: State, angle: float) -> float | None:
    """Return the real part of the exponent by the closed form."""
    scene = record.scene
    assert scene is not None
    body, edge = scene.find_edge(scene.contacts[int(record.edge[0])].edge)
    material = scene.material_of(body)
    kappa = kolosov(material.poisson, material.kinematics)
    if state == State.STICK and record.friction[k].present:
        return _real_part(angle, kappa, None)
    # t runs against x on the top and the left edge
    along = -side if edge in ("top", "left") else side
    outwards = along if state == State.FORWARD_SLIP else -along
    f = (
        float(record.friction[k].at_slip(np.asarray(int(state))))
        if record.friction[k].present
        else 0.0
    )
    return _real_part(angle, kappa, outwards * abs(f))


@cache
def _real_part(angle: float, kappa: float, slip: float | None) -> float | None:
    try:
        return corner_exponent(angle, kappa, slip).real
    except SolveError:
        return None
