"""Estimated errors of numbers from their values on several meshes.

With numbers a_0 of the finest mesh and a_1, a_2, ... of meshes coarser by r_1 < r_2 < ... (r_0 = 1)
three meshes i < j < k show the order p of

    |a_k - a_j| / |a_j - a_i| = (r_k^p - r_j^p) / (r_j^p - r_i^p),

and with the median p of all triples, limited to [1/2, 8/5], or to 7/4 on graded meshes, the error
of a_0 is taken to be

    e = max |a_i - a_j| / (r_j^p - r_i^p)  over all pairs of meshes.

The largest value is taken because numbers may agree on two meshes by chance. The limits are used
because zone ends move from node to node: differences are partly noise, and an order above that of
the elements is chance. Where a zone is one or two nodes wide numbers stay constant over several
meshes until it is resolved: there p is at most 1. Meshes of nearly the same size differ by noise
only and are not compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import brentq

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.probes import history_of, probe_names
from receding_fenicsx.evolution.record import DISSIPATION_ROUND_OFF, Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.measures.zone_ends import zone_end
from receding_fenicsx.interface.measures.zones import contact_zone, on_axis, stick_zone
from receding_fenicsx.measures.ends import contact_betas, corners_of, estimates_at, tractions
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.studies.accuracy.meshes import is_graded

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
    for name, moved in zip(
        record.load_names, record.turning_points.load_displacement.T, strict=True
    ):
        scale = float(np.abs(moved).max())
        if abs(moved[row]) > ROUND_OFF * scale:
            found[f"load_displacement[{name}]"] = Number(float(moved[row]), scale=scale)
    return found | dict(_of_probes(record, row)) | _energies(record)


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
        ("stick", stick_zone(x, state, record.friction.present)),
    ):
        if zone is None or zone[1] < 0:  # no such zone
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
        known_to = record.dissipation_round_off
        found["dissipation_first_cycle"] = Number(float(D[0]), known_to)
        found["dissipation_ratio"] = Number(float(D[-1] / D[0]), known_to / float(D[0]))
    return found


MIN_RATIO = 1.4
"""Smallest ratio of the sizes of two meshes that are compared."""
ORDERS = (0.5, 1.6)
"""Range of orders that an estimate assumes on equal elements."""


@dataclass(frozen=True)
class Level:
    """What a run on one mesh of a family found.

    Attributes:
        elements: contact elements, or their equivalent; meshes of a family have sizes ~ 1/elements.
        nodes: contact nodes.
        seconds: what the run took.
        numbers: its headline numbers.
        resolved: every zone is more than two nodes wide.
        sharp: a contact edge ends in a large pressure, at a sharp corner.
        graded: the mesh is graded towards the ends of the contact.
    """

    elements: int
    nodes: int
    seconds: float
    numbers: Mapping[str, Number]
    resolved: bool = True
    sharp: bool = False
    graded: bool = False


@dataclass(frozen=True)
class Estimate:
    """A number with its estimated error.

    Attributes:
        value: on the finest mesh; infinite where the number is singular there.
        error: estimated; NaN where nothing is known, infinite where the number does not converge.
        order: observed order, NaN where fewer than three meshes show it.
        size: what relative errors refer to.
    """

    value: float
    error: float
    order: float
    size: float

    @property
    def relative(self) -> float:
        """The error over the number's size."""
        return self.error / self.size if self.size > 0.0 else 0.0 * self.error


def estimates_of(levels: Sequence[Level]) -> dict[str, Estimate]:
    """Estimate the errors of all numbers of the finest of some meshes of one family."""
    finest, *coarser = sorted(levels, key=lambda level: -level.elements)
    found = {}
    for name, number in finest.numbers.items():
        if math.isinf(number.value):
            found[name] = Estimate(number.value, math.inf, math.nan, number.size)
            continue
        values = [(1.0, number.value)]
        for level in coarser:
            ratio = finest.elements / level.elements  # that of two steps of a search at most
            other = level.numbers.get(name)
            if other is not None and ratio <= 7.9 and math.isfinite(other.value):
                values.append((ratio, other.value))
        order = observed_order(values)
        if is_singular(values, order, number.size):
            error = math.inf
        else:
            # graded to sharp corners, orders are less disturbed
            resolved = 1.75 if finest.graded else ORDERS[1]
            most = resolved if finest.resolved else 1.0
            least = max(number.known_to, 1e-6 * number.size)
            error = max(estimated_error(values, order, most), least)
        found[name] = Estimate(number.value, error, order, number.size)
    return found


def estimated_error(
    values: Sequence[tuple[float, float]], order: float, most: float = ORDERS[1]
) -> float:
    """Return the estimated error of the first value; NaN when nothing is known of coarser meshes.

    The values are (r_k, a_k), r_k increasing from 1; the order, NaN for 1, is limited to ``most``.
    """
    p = min(max(1.0 if math.isnan(order) else order, ORDERS[0]), most)
    pairs = [(a, b) for a, b in combinations(values, 2) if b[0] >= MIN_RATIO * a[0]]
    return max((abs(a - b) / (s**p - r**p) for (r, a), (s, b) in pairs), default=math.nan)


def observed_order(values: Sequence[tuple[float, float]]) -> float:
    """Return the median order, -2 to 8, that triples of meshes show; NaN without one."""
    orders = []
    for (r, a), (s, b), (t, c) in combinations(values, 3):
        near, far = abs(a - b), abs(b - c)
        if s < MIN_RATIO * r or t < MIN_RATIO * s or near == far == 0.0:
            continue
        orders.append(_order((r, s, t), far / near if near > 0.0 else math.inf))
    return float(np.median(orders)) if orders else math.nan


def _order(sizes: tuple[float, float, float], ratio: float) -> float:
    """Return the order at which differences between three sizes have a ratio."""
    r, s, t = sizes

    def excess(p: float) -> float:
        if abs(p) < 1e-9:
            return math.log(t / s) / math.log(s / r) - ratio
        return (t**p - s**p) / (s**p - r**p) - ratio

    low, high = -2.0, 8.0
    if excess(low) >= 0.0 or excess(high) <= 0.0:
        return low if excess(low) >= 0.0 else high
    return float(brentq(excess, low, high))


def is_singular(values: Sequence[tuple[float, float]], order: float, size: float) -> bool:
    """Return whether a number moves in one direction without converging in order."""
    chain = [values[0]]
    for value in values[1:]:
        if value[0] >= MIN_RATIO * chain[-1][0]:
            chain.append(value)
    steps = np.diff([a for _, a in chain])
    one_way = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    return order < 0.2 and one_way and abs(steps[0]) > 1e-3 * size  # not of two meshes: no order


# -- the numbers that are asked for ------------------------------------------------------------


def asked_numbers(scene: Scene, levels: Sequence[Level]) -> dict[str, Estimate]:
    """Return the estimates of the numbers that were asked for, on the last of some meshes."""
    every = estimates_of(levels)
    wanted = scene.accuracy.numbers
    if not wanted:
        # ends of zones are known to a part of the node spacing, the pressure may be infinite
        local = ("half_width", "_left", "_right", "largest_pressure")
        return {n: e for n, e in every.items() if not n.partition("[")[0].endswith(local)}
    found = {n: e for n, e in every.items() if n in wanted or n.partition("[")[0] in wanted}
    # also by the name in front of brackets
    have = [{each for n in level.numbers for each in (n, n.partition("[")[0])} for level in levels]
    for name in wanted:
        if name not in have[-1]:
            if len(have) > 1 and name not in have[-2]:
                known = f"it has {', '.join(every)}"
                raise InputError(f"[accuracy] numbers: the run has no '{name}'; {known}")
            found[name] = Estimate(math.nan, math.nan, math.nan, 1.0)
    return found


def nonconvergence(way: Sequence[Mapping[str, Estimate]]) -> str:
    """Return why no mesh will do: a number does not converge on two meshes running."""
    if len(way) < 2:
        return ""
    now, before = way[-1], way[-2]
    names = [n for n in now if n in before and now[n].error == before[n].error == math.inf]
    infinite = [n for n in names if now[n].value == before[n].value == math.inf]
    if infinite:
        why = "singular, stresses are infinite at a corner in contact"
        return f"{', '.join(infinite)} does not converge: {why}; ask for other numbers"
    if not names:
        return ""
    they = f"{', '.join(names)} {'does' if len(names) == 1 else 'do'} not converge in order"
    return f"{they} (singular, or the mesh is far from resolving it); ask for other numbers"


# -- what a run says of its mesh -----------------------------------------------------------------


def level_of(record: Record | None, elements: int, seconds: float = 0.0) -> Level:
    """Return what a record says of its mesh; nothing on ranks without a record."""
    if record is None:
        return Level(elements, 0, seconds, {})
    resolved, sharp = narrowest_zone(record) > 2, False
    for part in record.by_edge().values():
        table = part.turning_points
        ends = table.p[:, part.corner_ends].max(axis=1, initial=0.0)
        mean = table.P.sum(axis=1) / part.weight.sum()
        sharp |= bool(np.any((mean > 0.0) & (ends > 1.5 * mean)))
    graded = record.scene is not None and is_graded(record.scene)
    return Level(elements, len(record.x), seconds, headline(record), resolved, sharp, graded)


def narrowest_zone(record: Record) -> int:
    """Count the nodes of the narrowest zone at turning points of cycles 0, 1 and the last.

    Stuck nodes at their friction limit are no zone of their own, nor are negligible zones.
    """
    table = record.turning_points
    rows = np.isin(table.cycle, (0, 1, table.cycle.max(initial=0)))
    P, state = table.P[rows], table.state[rows]
    margin = np.minimum(*record.friction.margins(table.Q[rows], P))
    round_off = 1e-9 * P.max(axis=1, initial=0.0)[:, None]
    # whether a stuck node at its limit slips is round-off
    at_limit = record.friction.present & (state == State.STICK) & (margin <= round_off)
    n, share = len(record.x), record.weight / record.weight.mean()
    narrowest = n
    for own, none in zip(state, at_limit, strict=True):
        ends = np.flatnonzero(np.diff(own[~none], prepend=-1, append=-1))
        # nodes at a graded corner are so close that a zone there has no part in the numbers
        seen = np.diff(np.append(0.0, np.cumsum(share[~none]))[ends]) > 0.1
        narrowest = min(narrowest, int(np.diff(ends)[seen].min(initial=n)))
    return narrowest


def shown(estimates: dict[str, Estimate]) -> dict[str, dict[str, Any]]:
    """Return estimates for the summary: None where not known."""
    keys = ("value", "error", "relative", "order", "size")
    return {
        name: {key: v if math.isfinite(v := getattr(e, key)) else None for key in keys}
        | {"converges": None if math.isnan(e.error) else e.error < math.inf}
        for name, e in estimates.items()
    }


def warning(record: Record | None) -> dict[str, str]:
    """Return the summary's warning about zones that a mesh does not resolve."""
    nodes = narrowest_zone(record) if record is not None else math.inf
    if nodes > 2:
        return {}
    return {
        "errors_warning": (
            f"a zone of stick, slip or separation is {nodes} node{'s' * (nodes > 1)} wide at the "
            "end of a leg: this mesh does not resolve it, and numbers that depend on it do not "
            "converge in order but in stairs; use more contact elements"
        )
    }
