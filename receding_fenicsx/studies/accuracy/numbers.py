"""Headline numbers of a record, whose errors are estimated.

Of several contact edges, loads and probes each has numbers of its own, with its name in brackets:
``stick_half_width[blade.left]``, ``load_displacement[F]``, ``probe_sxx[corner]``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.evolution.probes import history_of, probe_names
from receding_fenicsx.evolution.record import DISSIPATION_ROUND_OFF, Record
from receding_fenicsx.interface.measures.zone_ends import zone_end
from receding_fenicsx.interface.measures.zones import NO_NODES, contact_zone, on_axis, stick_zone
from receding_fenicsx.measures.corner_exponents import corners_of
from receding_fenicsx.measures.half_widths import contact_betas, estimates_at, tractions

ROUND_OFF = 1e-10
"""Size of a number, over its scale, below which it is round-off: zero by symmetry."""


@dataclass(frozen=True)
class Number:
    """A headline number.

    Attributes:
        value: its value; infinite where it is singular.
        known_to: what it is known to on its own mesh.
        scale: what its relative error refers to; 0 stands for the value itself.
    """

    value: float
    known_to: float = 0.0
    scale: float = 0.0

    @property
    def size(self) -> float:
        """What the relative error refers to."""
        return self.scale or abs(self.value)


def headline(record: Record) -> dict[str, Number]:
    """Return the headline numbers that a record has.

    Those of an instant are at the end of cycle 0; where that is without load, at the turning point
    of the largest normal force.
    The centre pressure is that on the axis, extrapolated, if the contact edge begins there, else
    that at the middle of the edge. Ends of zones are the fitted ones where they can be fitted.
    """
    first = np.flatnonzero(record.turning_points.cycle == 0)
    if not len(first):
        return {}
    force = record.turning_points.P[first].sum(axis=1)
    row = int(first[-1] if force[-1] > ROUND_OFF * force.max() else first[np.argmax(force)])
    edges = record.by_edge()
    found: dict[str, Number] = {}
    for edge, part in edges.items():
        behind = f"[{edge}]" if len(edges) > 1 else ""
        found |= {f"{name}{behind}": number for name, number in _of_edge(part, row)}
    return found | dict(_of_loads(record, row)) | dict(_of_probes(record, row)) | _energies(record)


def _of_edge(record: Record, row: int) -> Iterator[tuple[str, Number]]:
    """Yield pressures and ends of zones of one contact edge."""
    x, table = record.x, record.turning_points
    p = table.p[row]
    axis = record.begins_on_axis
    centre = on_axis(x, p) if axis else np.interp(0.5 * (x[0] + x[-1]), x, p)
    mean = float(table.P[row].sum() / record.weight.sum())
    if not mean > 0.0:
        return
    middle = 0 if axis else int(np.searchsorted(x, 0.5 * (x[0] + x[-1])))
    scale = max(abs(float(centre)), mean)
    yield "centre_pressure", Number(float(centre), _scatter(record, p, middle), scale)
    singular = corners_of(record, row).get("p_max_singular", False)
    largest, known_to = float(p.max()), _scatter(record, p, int(p.argmax()))
    yield "largest_pressure", Number(math.inf if singular else largest, known_to)
    found = [tractions(record, row, beta) for beta in contact_betas(record) or (None,)]
    length = float(x[-1] - x[0])
    for name, width in estimates_at(record, row, found).items():
        if width is not None and width["value"] > 0.0:
            low, high = width["interval"]
            known_to = _known_to(low, high, width["fitted"])
            yield name.removesuffix("_estimate"), Number(width["value"], known_to, 0.5 * length)
    if record.half or axis:
        return
    state = table.state[row]
    for name, zone in (
        ("contact", contact_zone(x, state)),
        ("stick", stick_zone(x, state, record.friction.mean)),
    ):
        if zone is None or zone == NO_NODES:
            continue
        for side, last, sign in (("left", zone[0], -1), ("right", zone[1], 1)):
            ends = [zone_end(at, last, sign, name == "stick") for at in found]
            value = float(np.mean([end.value for end in ends]))
            known_to = max(_known_to(end.low, end.high, end.fitted) for end in ends)
            yield f"{name}_{side}", Number(value, known_to, length)


def _known_to(low: float, high: float, fitted: bool) -> float:
    """Return what the end of a zone is known to: fitted ones to a third of half the interval."""
    return float(0.5 * (high - low)) * (1.0 / 3.0 if fitted else 1.0)


def _scatter(record: Record, p: Array, node: int) -> float:
    """Return half the largest second difference near a node: on linear elements p zigzags."""
    if record.scene is None or record.scene.mesh.degree > 1:
        return 0.0
    near = p[max(node - 4, 0) : node + 5]
    return float(0.5 * np.abs(np.diff(near, 2)).max(initial=0.0))


def _of_loads(record: Record, row: int) -> Iterator[tuple[str, Number]]:
    """Yield the work-conjugate displacement of each load."""
    moved = record.turning_points.load_displacement
    for k, name in enumerate(record.load_names):
        scale = float(np.abs(moved[:, k]).max())
        if abs(moved[row, k]) > ROUND_OFF * scale:
            yield f"load_displacement[{name}]", Number(float(moved[row, k]), scale=scale)


def _of_probes(record: Record, at: int) -> Iterator[tuple[str, Number]]:
    """Yield the largest displacements and stresses of each probe."""
    for name in probe_names(record):
        history = history_of(record, name)
        row = np.flatnonzero(history.kind == "turning point")[at]
        for values, keys in (
            (history.displacement[row], ("ux", "uy")),
            (history.stress[row], ("sxx", "syy", "szz", "sxy")),
        ):
            scale = float(np.abs(values).max())
            for k, key in enumerate(keys):
                value = float(values[np.argmax(np.abs(values[:, k])), k])
                if abs(value) > ROUND_OFF * scale:
                    yield f"probe_{key}[{name}]", Number(value, scale=scale)


def _energies(record: Record) -> dict[str, Number]:
    """Return the dissipations that are more than round-off."""
    D, table = record.cycles.dissipation, record.turning_points
    rows = table.cycle == 0
    found = {}
    work = table.P[rows].sum(axis=1).max() * np.abs(table.v[rows]).max()
    if record.dissipation_first_loading > DISSIPATION_ROUND_OFF * work:
        found["dissipation_first_loading"] = Number(float(record.dissipation_first_loading))
    if record.dissipates:
        found["dissipation_first_cycle"] = Number(float(D[0]))
        found["dissipation_ratio"] = Number(float(D[-1] / D[0]))
    return found
