"""Half widths of contact and stick below node spacing, from a record."""

from __future__ import annotations

from typing import Any

from receding_fenicsx.interface.zone_ends import (
    Tractions,
    ZoneEnd,
    contact_half_width_estimate,
    dundurs_beta,
    stick_half_width_estimate,
)
from receding_fenicsx.output.record import Record
from receding_fenicsx.scene import Material
from receding_fenicsx.scene_file import from_toml

AGAINST_X = ("top", "left")
"""Edges of a rectangle along which x runs against the tangential direction t = (n_y, -n_x)."""


def estimates(record: Record, row: int, beta: float | None = None) -> dict[str, Any]:
    """Estimate the half widths at a turning point.

    Args:
        record: the record.
        row: row of ``record.turning_points``.
        beta: Dundurs' constant, as :func:`contact_beta` gives it.

    Returns:
        ``contact_half_width_estimate`` and ``stick_half_width_estimate``, each with its value, an
        interval around it, and whether it was fitted (else it is the nodes' bracket).
    """
    at = tractions(record, row, beta)
    return {
        "contact_half_width_estimate": _shown(contact_half_width_estimate(at)),
        "stick_half_width_estimate": _shown(stick_half_width_estimate(at)),
    }


def tractions(record: Record, row: int, beta: float | None = None) -> Tractions:
    """What the ends of zones are fitted to, at a row of ``record.turning_points``."""
    table = record.turning_points
    return Tractions(
        record.x,
        record.weight,
        table.P[row],
        table.Q[row],
        table.state[row],
        record.f,
        beta,
        record.half,
        record.axisymmetric,
    )


def contact_beta(record: Record) -> float | None:
    """Dundurs' beta of a record's contact, with the sign that makes forward slip run towards x.

    None when the scene does not tell: a system made by hand, a mesh of the user's own (the side of
    its edge is not known here), or several contact edges.
    """
    if not record.scene_toml:
        return None
    scene = from_toml(record.scene_toml)
    if len(scene.contacts) != 1:
        return None
    contact = scene.contacts[0]
    body, edge = scene.find_edge(contact.edge)
    if body.mesh is not None:
        return None
    materials = [scene.material_of(body)]
    if contact.against is not None:
        materials.append(scene.material_of(scene.find_edge(contact.against)[0]))
    beta = dundurs_beta(*map(_constants, materials))
    return -beta if edge in AGAINST_X else beta


def _constants(material: Material) -> tuple[float, float, str]:
    return material.young, material.poisson, material.kinematics


def _shown(end: ZoneEnd) -> dict[str, Any]:
    return {
        "value": float(end.value),
        "interval": [float(end.low), float(end.high)],
        "fitted": end.fitted,
    }
