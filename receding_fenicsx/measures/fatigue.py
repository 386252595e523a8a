r"""Fatigue parameters at the probes over the last cycle, exact at the events of the path.

Stresses are linear in the displacements and loads, and these are straight between events, so that
the extremes of a stress are at instants of the record. Planes have normals at an angle theta to x,
in the modelled plane; strains follow from Hooke's law.

* Smith, Watson and Topper: largest over planes of $\sigma_{n,max}\, \Delta\varepsilon_n / 2$.
* Fatemi and Socie: largest over planes of $\Delta\gamma / 2\, (1 + k\, \sigma_{n,max} / \sigma_y)$.
* Dang Van: largest over the instants of $\tau + \alpha\, p_h$ with half of Tresca's stress $\tau$
  of the deviator less the centre of the smallest sphere about the path of the deviator.
* Crossland: $\sqrt{J_{2,a}} + \alpha\, p_{h,max}$ with the radius of that sphere.
* Ruiz, at contact edges: $F_1 = \sigma_{t,max}\, (\tau \delta)_{max}$ and
  $F_2 = (\sigma_t \tau \delta)_{max}$ with the stress along the edge, the shear traction and the
  slip amplitude, half of the slip's range.

**Short cracks** along a probe line. A crack of depth a from the free surface of a half-plane,
perpendicular to it, in the stresses $\sigma(x)$ normal to its faces and $\tau(x)$ along them that
act without it has

$$K_I = 2 \sqrt{\frac a \pi} \int_0^1 \frac{1 + F(\xi)}{\sqrt{1 - \xi^2}}\, \sigma(a \xi)\, d\xi,$$

$K_{II}$ the same with $\tau$, and $F = (1 - \xi^2)(0.2945 - 0.3912 \xi^2 + 0.7685 \xi^4 -
0.9942 \xi^6 + 0.5094 \xi^8)$ (Hartranft and Sih 1973; Tada, Paris and Irwin). The contact is taken
not to change by the crack, and a crack with $K_I < 0$ to be closed.

It grows where $\Delta K_I$ exceeds $\Delta K_{th} \sqrt{a / (a + a_0)}$, El Haddad's form of the
diagram of Kitagawa and Takahashi, with $\pi a_0 = (\Delta K_{th} / (1.1215\,
\Delta\sigma_{fl}))^2$: in a uniform stress cracks of all depths grow above the range
$\Delta\sigma_{fl}$ of the fatigue limit, and short ones do not below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.probes import ProbeHistory, probe_names
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.tables import optional
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import FatigueOptions, Material, Scene


@dataclass(frozen=True)
class Parameter:
    """A fatigue parameter at the m points of a probe."""

    value: Array  # (m,) values
    angle: Array  # (m,) degrees in [0, 180) of the critical plane's normal to x; NaN without one


def fatigue_at(stress: Array, material: Material, options: FatigueOptions) -> dict[str, Parameter]:
    """Return the parameters of stress histories (n, m, 4), [s_xx, s_yy, s_zz, s_xy], by name.

    Compliances are those of the material; ``fatemi_socie`` needs the yield stress.
    """
    if material.young_2 is not None:
        raise InputError("fatigue_at: strains are those of an isotropic material; give one")
    young, nu, m = material.young, material.poisson, stress.shape[1]
    trace = stress[..., :3].sum(axis=-1)

    def normal(theta: Array) -> Array:
        return _normal(stress[..., None, :], np.cos(theta), np.sin(theta))

    def swt(theta: Array) -> Array:
        s_n = normal(theta)
        strain = ((1.0 + nu) * s_n - nu * trace[..., None]) / young
        return np.asarray(np.maximum(s_n.max(axis=0), 0.0) * np.ptp(strain, axis=0) / 2.0)

    def fatemi_socie(theta: Array) -> Array:
        shear = normal(theta + 0.25 * np.pi) - 0.5 * (stress[..., 0] + stress[..., 1])[..., None]
        opening = np.maximum(normal(theta).max(axis=0), 0.0) / (options.yield_stress or 1.0)
        strain = np.ptp(shear, axis=0) * (1.0 + nu) / young
        return np.asarray(strain * (1.0 + options.fatemi_socie * opening))

    pressure = trace / 3.0
    found = {"swt": _critical_plane(swt, m)}
    if options.yield_stress is not None:
        found["fatemi_socie"] = _critical_plane(fatemi_socie, m)
    # coordinates of the deviators whose length is the norm of tensors
    axes = np.array([[1, -1, 0, 0], [-1, -1, 2, 0], [0, 0, 0, 2]]) / np.sqrt([[2.0], [6.0], [2.0]])
    deviator = stress @ axes.T
    spheres = [smallest_sphere(deviator[:, k]) for k in range(m)]
    a, b, c = np.moveaxis(deviator - np.array([centre for centre, _ in spheres]), -1, 0)
    mean, radius = -b / np.sqrt(6.0), np.hypot(a, c) / np.sqrt(2.0)
    tresca = 0.5 * np.ptp([mean - radius, mean + radius, -2.0 * mean], axis=0)
    j2 = np.array([radius for _, radius in spheres]) / np.sqrt(2.0)
    values = {
        "dang_van": (tresca + options.dang_van * pressure).max(axis=0),
        "crossland": j2 + options.crossland * pressure.max(axis=0),
    }
    return found | {name: Parameter(value, np.full(m, np.nan)) for name, value in values.items()}


def _normal(stress: Array, c: Array | float, s: Array | float) -> Array:
    """Return the stresses normal to planes, of normals (c, s), from stresses (..., 4)."""
    s_xx, s_yy, _, s_xy = np.moveaxis(stress, -1, 0)
    return np.asarray(s_xx * c**2 + s_yy * s**2 + 2.0 * s_xy * s * c)


def _critical_plane(of_planes: Any, m: int) -> Parameter:
    """Return the largest value over planes of a function of angles (m, k), by ever finer angles."""
    theta, width = np.zeros(m), np.pi
    # planes of the first search; each of three further ones is 20 times finer around the best
    for count in (90, 41, 41, 41):
        steps = np.arange(count) / count if width == np.pi else np.linspace(-0.5, 0.5, count)
        angles = theta[:, None] + width * steps
        values = of_planes(angles)
        best = values.argmax(axis=1)[:, None]
        theta, value = (np.take_along_axis(a, best, axis=1)[:, 0] for a in (angles, values))
        width *= 2.0 / (count - 1)
    return Parameter(value, np.degrees(theta) % 180.0)


def smallest_sphere(points: Array) -> tuple[Array, float]:
    """Return centre and radius of the smallest sphere about points (n, 3).

    Points outside the sphere of a few others join them, the farthest first; of those few the
    smallest sphere through two to four that holds all is kept.
    """
    first = points[np.argmax(np.linalg.norm(points - points[0], axis=1))]
    kept = [first, points[np.argmax(np.linalg.norm(points - first, axis=1))]]
    centre, radius = 0.5 * (kept[0] + kept[1]), 0.5 * float(np.linalg.norm(kept[0] - kept[1]))
    scale = float(np.abs(points).max()) or 1.0
    while True:
        away = np.linalg.norm(points - centre, axis=1)
        far = int(np.argmax(away))
        if away[far] <= radius + 1e-10 * scale:
            return centre, radius
        kept.append(points[far])
        best: tuple[float, Array, list[Array]] = (np.inf, centre, kept)
        for size in (2, 3, 4):
            for some in combinations(kept, min(size, len(kept))):
                # through all of them, the centre in their plane
                edges = np.array(some[1:]) - some[0]
                half = 0.5 * (edges**2).sum(axis=1)
                middle = some[0] + np.linalg.lstsq(edges, half, rcond=None)[0]
                reach = float(np.linalg.norm(np.array(kept) - middle, axis=1).max())
                if reach < best[0] - 1e-13 * scale:
                    best = reach, middle, list(some)
        if best[0] <= radius:  # round-off
            return centre, float(away[far])
        radius, centre, kept = best


@dataclass(frozen=True)
class EdgeCrack:
    """Cracks from the first of m points to each of them, over n instants.

    Attributes:
        depth: (m,) distances from the first point.
        k_i: (n, m) stress intensity of opening, negative where the crack is pressed together.
        k_ii: (n, m) stress intensity of sliding.
        arrest: the least depth from which a crack does not grow: 0 if it does not begin to,
            infinite if it grows along all points, NaN without a threshold.
        threshold: (m,) range of K_I from which cracks grow, NaN without one.
    """

    depth: Array
    k_i: Array
    k_ii: Array
    arrest: float
    threshold: Array

    @property
    def delta_k(self) -> Array:
        """(m,) range of the stress intensity in which the crack is open."""
        return np.asarray(np.ptp(np.maximum(self.k_i, 0.0), axis=0))


def edge_crack(stress: Array, points: Array, options: FatigueOptions) -> EdgeCrack:
    """Return cracks along three or more points (m, 2) on a straight line from the surface inwards.

    Stresses (n, m, 4) of a cycle, [s_xx, s_yy, s_zz, s_xy], are linear between the points.

    Raises:
        InputError: the points are not on a straight line.
    """
    along = points - points[0]
    depth = np.linalg.norm(along, axis=1)
    if len(points) < 3 or not np.all(np.diff(depth) > 0.0):
        raise InputError("edge_crack: needs three points or more, from the surface inwards")
    t = along[-1] / depth[-1]
    if np.abs(along @ [-t[1], t[0]]).max() > 1e-6 * depth[-1]:
        raise InputError("edge_crack: the points are not on a straight line")
    (s, c), weights = t * [1.0, -1.0], _weights(depth)
    s_xx, s_yy, _, s_xy = np.moveaxis(stress, -1, 0)
    k_i = _normal(stress, c, s) @ weights.T
    k_ii = ((s_xx - s_yy) * c * t[0] + s_xy * (c * t[1] + s * t[0])) @ weights.T
    arrest, threshold = np.nan, np.full(len(depth), np.nan)
    if options.threshold is not None and options.fatigue_limit is not None:
        short = (options.threshold / (1.1215 * options.fatigue_limit)) ** 2 / np.pi
        threshold = options.threshold * np.sqrt(depth / (depth + short))
        lack = (threshold - np.ptp(np.maximum(k_i, 0.0), axis=0))[1:]
        k, arrest = int(np.argmax(lack > 0.0)), np.inf
        if lack[k] > 0.0:
            # between two points the lack is linear
            arrest = float(np.interp(0.0, lack[k - 1 : k + 1], depth[k : k + 2])) if k else 0.0
    return EdgeCrack(depth, k_i, k_ii, arrest, threshold)


def _weights(depth: Array) -> Array:
    """Return (m, m): the stress intensity at each depth of a unit stress at each point."""
    found = np.zeros((len(depth), len(depth)))
    at, gauss = np.polynomial.legendre.leggauss(8)
    for k in range(1, len(depth)):
        a = depth[k]
        ends = np.arcsin(depth[: k + 1] / a)  # xi = sin(theta)
        half = 0.5 * np.diff(ends)[:, None]
        sine = np.sin(0.5 * (ends[1:] + ends[:-1])[:, None] + half * at)
        series = np.polynomial.polynomial.polyval(
            sine**2, [0.2945, -0.3912, 0.7685, -0.9942, 0.5094]
        )
        value = 2.0 * np.sqrt(a / np.pi) * half * gauss * (1.0 + (1.0 - sine**2) * series)
        part = (a * sine - depth[:k, None]) / np.diff(depth[: k + 1])[:, None]
        found[k, :k] += (value * (1.0 - part)).sum(axis=1)
        found[k, 1 : k + 1] += (value * part).sum(axis=1)
    return found


def _asked(record: Record) -> tuple[Scene, FatigueOptions] | None:
    """Return the record's scene and its table [fatigue], None without one or without cycles."""
    scene = record.scene
    if scene is None or scene.fatigue is None or not len(record.cycles.dissipation):
        return None
    return scene, scene.fatigue


def fatigue(record: Record) -> dict[str, dict[str, Parameter]]:
    """Return the parameters of the record's scene at its probes, by probe and name."""
    if (asked := _asked(record)) is None:
        return {}
    scene, options = asked
    found = {}
    for name in probe_names(record):
        probe = record.probe(name)
        stress = _cycle_stress(record, probe)
        found[name] = fatigue_at(stress, _material_of(scene, name), options)
        if next(p for p in scene.probes if p.name == name).edge is not None:
            found[name] |= _ruiz(record, probe, len(record.cycles.dissipation))
    return found


def life_by_pylife(record: Record, curve: Mapping[str, float]) -> dict[str, Array]:
    """Return the cycles at the points of each probe by a line of pylife, which must be installed.

    The ``curve`` is the line as pylife's WoehlerCurve has it: ``k_1``, ``k_2``, ``SD``, ``ND`` and
    others. Its stress is sqrt(E swt), Smith's, Watson's and Topper's; the scene of the record needs
    a table [fatigue].
    """
    optional("pylife.materiallaws")
    woehler = optional("pandas").Series(dict(curve)).woehler
    found = {}
    for name, parameters in fatigue(record).items():
        young = _material_of(given(record.scene), name).young
        found[name] = np.asarray(woehler.cycles(np.sqrt(young * parameters["swt"].value)))
    return found


def short_cracks(record: Record) -> dict[str, EdgeCrack]:
    """Return the cracks along the segments of the record's probes, each from its first point."""
    if (asked := _asked(record)) is None:
        return {}
    scene, options = asked
    names = [p.name for p in scene.probes if p.segment and len(p.coordinates) > 2]
    probes = [record.probe(name) for name in names]
    return {p.name: edge_crack(_cycle_stress(record, p), p.points, options) for p in probes}


def _cycle_stress(record: Record, probe: ProbeHistory) -> Array:
    """Return the stresses (n, m, 4) over the last cycle."""
    rows = probe.cycle == len(record.cycles.dissipation)
    if record.limit is None or not record.limit.jumped:
        rows[max(int(np.argmax(rows)) - 1, 0)] = True  # it begins where the one before ends
    return probe.stress[rows]


def _material_of(scene: Scene, name: str) -> Material:
    """Return the material at a probe."""
    probe = next(probe for probe in scene.probes if probe.name == name)
    if probe.edge is not None:
        return scene.material_of(scene.find_edge(probe.edge)[0])
    owner = next((body for body in scene.bodies if body.name == probe.body), scene.body)
    return scene.material_of(owner)


def _ruiz(record: Record, probe: ProbeHistory, cycle: int) -> dict[str, Parameter]:
    """Return Ruiz's parameters at the nodes of a contact edge."""
    apart = np.linalg.norm(probe.points[:, None] - record.points[None], axis=2)
    node = apart.argmin(axis=1)
    tables = record.turning_points, record.samples
    rows = [np.flatnonzero(table.cycle == cycle) for table in tables]

    def both(key: str) -> Array:
        parts = zip(tables, rows, strict=True)
        return np.concatenate([getattr(table, key)[row] for table, row in parts])

    start = record.start_row(cycle)
    v = both("v")[:, node]
    if start is not None:
        v = np.vstack([v, record.turning_points.v[start, node]])
    touches = np.any(both("P")[:, node] > 0.0, axis=0)
    slip = np.where(touches, 0.5 * np.ptp(v, axis=0), 0.0)
    # the instants at which tractions and stresses are both known
    known = {(leg, s): k for k, (leg, s) in enumerate(zip(both("leg"), both("s"), strict=True))}
    at = np.flatnonzero((probe.cycle == cycle) & (probe.kind != "event"))
    same = [known[leg, s] for leg, s in zip(probe.leg[at], probe.s[at], strict=True)]
    q = np.abs(both("q")[:, node])[same]
    along = np.gradient(probe.points, axis=0)
    c, s = (along / np.linalg.norm(along, axis=1)[:, None]).T
    tension = np.maximum(_normal(probe.stress[at], c, s), 0.0)
    none = np.full(len(node), np.nan)
    values = tension.max(axis=0) * q.max(axis=0), (tension * q).max(axis=0)
    return {f"ruiz_f{k}": Parameter(value * slip, none) for k, value in enumerate(values, 1)}


def averaged(value: Array, points: Array, length: float) -> Array:
    """Return the largest mean of values over a length along points, ends with less room cut."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    integral = make_interp_spline(along, value, k=1).antiderivative()
    low = np.clip(along - 0.5 * length, 0.0, max(along[-1] - length, 0.0))
    high = np.minimum(low + length, along[-1])
    return np.asarray((integral(high) - integral(low)) / (high - low))


def life(swt: float, young: float, options: FatigueOptions) -> float | None:
    """Return the cycles N of Basquin's and Coffin and Manson's line for a parameter of Smith et al.

    swt = s^2 / E (2 N)^(2 b) + s e (2 N)^(b + c); infinite beyond 10^15 cycles, None without a
    line.
    """
    if options.strength is None:
        return None
    a, b, c = options.strength, options.strength_exponent, options.ductility_exponent

    def excess(log: float) -> float:
        twice = 2.0 * 10.0**log
        line = a**2 / young * twice ** (2.0 * b) + a * options.ductility * twice ** (b + c)
        return float(line - swt)

    if excess(15.0) >= 0.0:
        return float("inf")
    return 10.0 ** float(brentq(excess, -1.0, 15.0)) if excess(-1.0) > 0.0 else 0.1


def fatigue_summary(record: Record, coarse: Record | None = None) -> dict[str, Any]:
    """Return the key "fatigue" of the summary: the worst point of each parameter.

    ``coarse`` is the record of a mesh of half as many elements. At edges of the contact errors fall
    with the square root of the element size: the difference over sqrt(2) - 1 is the estimate.
    """
    every, asked = fatigue(record), _asked(record)
    if not every or asked is None:
        return {}
    scene, options = asked
    names = dict.fromkeys(name for parameters in every.values() for name in parameters)
    other = {} if coarse is None else fatigue_summary(coarse)["fatigue"]["parameters"]
    found: dict[str, Any] = {}
    for name in names:
        here = {probe: p[name] for probe, p in every.items() if name in p}
        probe = max(here, key=lambda probe: float(here[probe].value.max()))
        value, angle = here[probe].value, here[probe].angle
        points = record.probe(probe).points
        k = int(value.argmax())
        x, y = points[k].tolist()
        row: dict[str, Any] = {"max": float(value[k]), "x": x, "y": y, "probe": probe}
        row |= {"angle": float(angle[k]), "estimate": None}
        if name in other:
            row["estimate"] = abs(row["max"] - other[name]["max"]) / (np.sqrt(2.0) - 1.0)
        if options.average is not None and len(points) > 1:
            row["averaged"] = float(averaged(value, points, options.average).max())
        if name == "swt":
            young = _material_of(scene, probe).young
            row["life"] = life(row.get("averaged", row["max"]), young, options)
        found[name] = row
    if options.threshold is None:
        return {"fatigue": {"parameters": found}}
    cracks = {
        name: {
            "arrest": crack.arrest,
            "depth": crack.depth.tolist(),
            "delta_k_i": crack.delta_k.tolist(),
            "delta_k_ii": np.ptp(crack.k_ii, axis=0).tolist(),
        }
        for name, crack in short_cracks(record).items()
    }
    return {"fatigue": {"parameters": found, "cracks": cracks}}
