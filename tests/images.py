"""A scene in other units, mirrored, turned and shifted, or written otherwise, and its record."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.interface.law import MIRRORED

ROUND = ["bottom", "right", "top", "left"]
PLANE = {
    (1, 0): "width height span head_span nut_span size at travel initial_gap interference gap "
    "displacement shortening initial_slip average",
    (0, 1): "young young_2 shear pressure traction tension cohesion shear_limit yield_stress "
    "strength fatigue_limit",
    (-1, 1): "body_force normal tangential",
    (0.5, 1): "threshold",
}
POWERS = {key: powers for powers, keys in PLANE.items() for key in keys.split()}
"""Powers of a length and of a stress in the numbers of a scene."""
LUMPED = {"force": 1, "preload": 1, "x": 0, "y": 0, "stiffness": 0}
"""The power of a length for unit thickness; around a circle there is one more."""
ALONG_EDGE = "friction forward backward initial_gap interference cohesion shear_limit gap".split()
"""Profiles over the position along the edge; other ones are over the coordinates."""


@dataclass(frozen=True)
class Image:
    """The map x' = length * turn(mirror(x)) + shift, and a unit of stress.

    The mirror takes x for -x, a turn is of so many quarters counter-clockwise.
    """

    length: float = 1.0
    stress: float = 1.0
    quarters: int = 0
    mirror: bool = False
    shift: tuple[float, float] = (0.0, 0.0)
    axisymmetric: bool = False
    loads: dict[str, float] = field(default_factory=dict)
    """Factors of load factors."""

    @cached_property
    def turn(self) -> NDArray[np.int64]:
        """The orthogonal matrix of signs, in one place of each row."""
        quarter = np.array([[0, -1], [1, 0]])
        matrix = np.linalg.matrix_power(quarter, self.quarters)
        return np.asarray(matrix * [-1, 1]) if self.mirror else matrix

    @property
    def sign(self) -> int:
        """-1 where forward becomes backward."""
        return -1 if self.mirror else 1

    def factor(self, length: float, stress: int = 0, lumped: bool = False) -> float:
        """Factor of a quantity with these powers."""
        return self.length ** (length + (lumped and self.axisymmetric)) * self.stress**stress

    def place(self, point: Sequence[float]) -> tuple[float, ...]:
        """Image of a point."""
        return tuple((self.length * self.turn @ point + self.shift).tolist())

    def vector(self, parts: Sequence[Any]) -> tuple[Any, ...]:
        """Components of a vector of numbers, profiles or "free", turned."""
        turned = []
        for row in self.turn:
            k = int(np.flatnonzero(row)[0])
            part, sign = parts[k], int(row[k])
            if isinstance(part, dict):
                part = {"x": part["x"], "value": [sign * value for value in part["value"]]}
            elif part != "free":
                part = f"{sign}*({part})" if isinstance(part, str) else sign * part
            turned.append(part)
        return tuple(turned)

    def along(self, edge: str) -> int:
        """Sign of the positions along the image of an edge."""
        side = edge.rpartition(".")[2]
        if side not in (*ROUND, "far"):  # of a mesh file, with the body on its left
            return self.sign
        return int(self.turn[:, int(side in ("left", "right"))].sum())

    def edge(self, name: str) -> str:
        """Image of an edge of a rectangle, "NAME.edge"."""
        body, dot, side = name.rpartition(".")
        if side not in ROUND:
            return name
        at = ROUND.index(side)
        at = (-at if self.mirror else at) + self.quarters
        return f"{body}{dot}{ROUND[at % 4]}"

    def profile(self, value: Any, key: str, along: int, factor: float = 1.0) -> Any:
        """A profile times a factor, over the new coordinates or positions."""
        if isinstance(value, dict) and "forward" in value:
            ways = ["backward", "forward"] if self.mirror else ["forward", "backward"]
            return {
                new: self.profile(value[old], key, along)
                for new, old in zip(("forward", "backward"), ways, strict=True)
            }
        if isinstance(value, dict):
            x, y = (np.array(value[k]) for k in ("x", "value"))
            x, y = along * self.length * x, factor * y
            return {"x": x[::along].tolist(), "value": y[::along].tolist()}
        if not isinstance(value, str):
            return factor * value
        if key in ALONG_EDGE:
            old = {"x": f"(x*{along}/{self.length!r})"}
        else:
            back = {}
            for name, column in zip("xy", self.turn.T, strict=True):
                k = int(np.flatnonzero(column)[0])
                back[name] = f"(({'xy'[k]} - {self.shift[k]!r})*{column[k]}/{self.length!r})"
            old = back
        text = re.sub(r"\b[xy]\b", lambda m: old[m[0]], value)
        return f"{factor!r}*({text})"

    def of(self, value: Any, first: str = "") -> Any:
        """Image of a scene or a table of it; ``first`` is its first contact edge."""
        parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        first = first or parts["contacts"][0].edge
        along = self.along(parts.get("edge") or first)
        new: dict[str, Any] = {}
        for key, part in parts.items():
            power = POWERS.get(key, (0, 0))
            factor = self.factor(*power)
            if part is None or isinstance(part, bool | rf.Units) or part in ("", "ends", "corners"):
                continue
            if key == "material" and {m.name for m in value.materials} >= {
                body.name for body in value.bodies
            }:
                continue
            if dataclasses.is_dataclass(part):
                new[key] = self.of(part, first)
            elif isinstance(part, tuple) and part and dataclasses.is_dataclass(part[0]):
                new[key] = tuple(self.of(each, first) for each in part)
            elif key in ("points", "segment"):
                new[key] = tuple(self.place(point) for point in part)
            elif key == "point":
                new[key] = self.place(part) if isinstance(part, tuple) else part
            elif key in ("edge", "against", "head", "nut") and isinstance(part, str):
                new[key] = self.edge(part)
            elif key in LUMPED and key != "force":
                new[key] = self.factor(LUMPED[key], 1, lumped=True) * part
            elif key in ("traction", "displacement", "body_force", "force", "axis"):
                if key == "force":
                    factor = self.factor(1, 1, lumped=True)
                scaled = [p if p == "free" else self.profile(p, key, along, factor) for p in part]
                new[key] = self.vector(scaled)
            elif key.endswith("span") or key in ("at", "travel"):
                side = along if key in ("span", "at", "travel") else self.along(parts[key[:-5]])
                ends = side * factor * np.array(part)
                backward = side < 0 and key != "travel"
                ends = ends[::-1] if backward and isinstance(part, tuple) else ends
                new[key] = tuple(ends.tolist()) if isinstance(part, tuple) else float(ends)
            elif key == "initial_slip":
                new[key] = self.profile(part, "gap", along, self.sign * factor)
            elif key in (*POWERS, "friction", "thermal_strain") and part != ():
                new[key] = self.profile(part, key, along, factor)
        return replace(value, **(new | self.special(value)))

    def special(self, value: Any) -> dict[str, Any]:
        """What is more than a number, place or profile in a table."""
        odd = self.quarters % 2 == 1
        if isinstance(value, rf.Body) and value.mesh is None:
            raised = 0.5 * value.height if value.is_rectangle else 0.0
            x, y = self.place((value.position[0], value.position[1] + raised))
            wide, high = (self.length * size for size in (value.width, value.height))
            if value.is_half_plane:
                return {"position": (x, y), "height": value.height}
            wide, high = (high, wide) if odd else (wide, high)
            return {"position": (x, y - 0.5 * high), "width": wide, "height": high}
        if isinstance(value, rf.Material):
            turned = self.sign * value.angle + 90.0 * self.quarters
            return {"angle": turned if value.young_2 else 0.0}
        if isinstance(value, rf.Support) and odd:
            return {"fix": {"x": "y", "y": "x"}.get(value.fix, value.fix)}
        if isinstance(value, rf.Spring) and odd and value.point:
            stiffness = self.factor(0, 1, lumped=True)
            return {"x": stiffness * value.y, "y": stiffness * value.x}
        return {}

    def check(
        self, found: rf.Record, known: rf.Record, rel: float, rows: Any = slice(None)
    ) -> None:
        """Compare the record of an image, some rows of its turning points, with the scene's own."""
        a, b = found.turning_points, known.turning_points
        places = np.array([self.place(point) for point in known.points])
        apart = np.linalg.norm(found.points[None] - places[:, None], axis=2)
        apart[found.edge[None] != known.edge[:, None]] = np.inf
        at = np.argmin(apart, axis=1)
        assert apart.min(axis=1).max() < 1e-9 * np.abs(places).max()
        assert len(np.unique(at)) == len(at) == len(found.points)
        assert all(np.all(np.diff(found.x[found.edge == k]) > 0.0) for k in set(found.edge))

        def close(name: str, one: Any, two: Any, *scales: Any) -> None:
            size = max(np.abs(each).max(initial=0.0) for each in (two, *scales))
            assert np.shape(one) == np.shape(two), name
            assert np.abs(one - two).max(initial=0.0) <= rel * size + 1e-300, name

        long, stress = self.factor(1), self.factor(0, 1)
        force = self.factor(1, 1, lumped=True)
        sign, scales = self.sign, {"P": a.P, "Q": a.P, "v": a.w, "w": a.v, "p": a.p, "q": a.p}
        for key, factor in (
            *(("P", force), ("Q", sign * force), ("w", long), ("v", sign * long)),
            *(("p", stress), ("q", sign * stress)),
        ):
            close(key, getattr(a, key)[rows][:, at], factor * getattr(b, key), scales[key])
        state = b.state if sign > 0 else MIRRORED[b.state]
        # of nodes at both limits either is true
        assert np.mean(a.state[rows][:, at] == state) > 0.95
        assert found.scene is not None and known.scene is not None
        whole = isinstance(rows, slice)
        # load factors of bolts are lengths
        loads = dict.fromkeys((bolt.name for bolt in found.scene.bolts), long) | self.loads
        load = np.array([loads.get(name, 1.0) for name in known.load_names])
        order = [found.load_names.index(name) for name in known.load_names]
        close("load", a.load[rows][:, order], load * b.load)
        work = b.load_displacement * long * force / load
        close("load displacement", a.load_displacement[rows][:, order], work)
        for name in ("dissipation_first_loading", "released"):
            close(name, getattr(found, name), getattr(known, name) * long * force, 1e-6 * work)
        D = found.cycles.dissipation, known.cycles.dissipation * long * force
        close("dissipation", *D, 1e-6 * work)
        assert found.jumps == known.jumps and len(found.events.s) <= found.n_events
        assert found.steady.kind == known.steady.kind
        density = known.cycles.dissipation_density * long * stress
        close("density", found.cycles.dissipation_density[:, at], density, 1e-6 * long * stress)
        gain = sign * long * known.cycles.slip_increment
        close("gain", found.cycles.slip_increment[:, at], gain, a.v, a.w)
        forward, backward = (known.friction.backward, known.friction.forward)[::sign]
        close("f", found.friction.forward[at], backward)
        close("f", found.friction.backward[at], forward)
        close("g0", found.g0[at], long * known.g0)
        close("weight", found.weight[at], force / stress * known.weight)
        events = replace(found.events, load=found.events.load[:, order] / load)
        self._check_events(events, known.events, at, rel)
        mine, own = found.uniqueness, known.uniqueness
        # of paths beside a shear limit nothing is certified
        if mine and own and (found.shear_limit is None) == (known.shear_limit is None):
            assert (mine.certified, mine.solutions) == (own.certified, own.solutions)
            # that of half a body is among symmetric paths
            if np.isfinite(own.margin) and found.half == known.half:
                close("margin", mine.margin, own.margin)
        for name in dict.fromkeys(known.probes.names if known.probes else ()):
            one, two = found.probe(name), known.probe(name)
            near = np.array([self.place(point) for point in two.points])
            off = np.linalg.norm(one.points[None] - near[:, None], axis=2)
            near = off.argmin(axis=1)
            assert sorted(near) == [*range(len(one.points))], name
            close("probe", off.min(axis=1), 0.0 * near, 1e-2 * np.ptp(places))
            ends = [each.kind == "turning point" for each in (one, two)]
            u = long * two.displacement[ends[1]] @ self.turn.T
            close("u", one.displacement[ends[0]][rows][:, near], u)
            xx, yy, zz, xy = np.moveaxis(two.stress[ends[1]], -1, 0)
            s = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
            s = self.turn @ s @ self.turn.T
            s = np.stack([s[..., 0, 0], s[..., 1, 1], zz, s[..., 0, 1]], -1)
            close("stress", one.stress[ends[0]][rows][:, near], stress * s)
            if known.scene.fatigue and whole:
                self._check_fatigue(name, (found, known), near, close)
        along = np.array([self.along(contact.edge) for contact in known.scene.contacts])
        x = long * along[known.edge] * known.x
        # positions on a closed curve begin elsewhere
        if known.scene.body.mesh is None or np.ptp(found.x[at] - x) < rel * long:
            close("x", found.x[at], x)
            same = np.all(a.state[:, at] == state, axis=1) if whole else np.zeros(0, bool)
            self._check_summary((found, known), (same, along), rel)

    def _check_fatigue(self, name: str, records: Any, near: Any, close: Any) -> None:
        """Compare the fatigue parameters at a probe, and the cracks from its first point."""
        stress, long = self.factor(0, 1), self.factor(1)
        factors = {"fatemi_socie": 1.0, "ruiz_f1": long * stress**2, "ruiz_f2": long * stress**2}
        one, two = (rf.fatigue(record)[name] for record in records)
        assert one.keys() == two.keys()
        for key in two:
            close(key, one[key].value[near], factors.get(key, stress) * two[key].value)
        a, b = (rf.short_cracks(record).get(name) for record in records)
        if a and b:
            toughness = self.factor(0.5, 1)
            close("depth", np.append(a.depth, a.arrest), long * np.append(b.depth, b.arrest))
            close("opening", a.k_i, toughness * b.k_i)
            close("sliding", a.k_ii, self.sign * toughness * b.k_ii)

    def _check_summary(self, records: Any, where: Any, rel: float) -> None:
        """Compare what summaries tell of zones, ends and corners where the states are the same."""
        found, known = (rf.summarise(record)["turning_points"] for record in records)
        (same, along), number = where, len(set(records[1].edge.tolist()))
        for k in np.flatnonzero(np.repeat(same, number)):
            image = _told(known[k], self, int(along[k % number]))
            for (name, one), (other, two) in zip(_told(found[k], Image(), 1), image, strict=True):
                assert name == other and type(one) is type(two), (name, other)
                if isinstance(two, float):
                    assert abs(one - two) <= rel * (1.0 + 1e3 * abs(two)), name
                else:
                    assert one == two, name

    def _check_events(self, a: Any, b: Any, at: NDArray[np.int64], rel: float) -> None:
        """Compare the changes of each node; nodes that change together do so in any order."""
        for node in range(len(at)):
            one, two = np.flatnonzero(a.node == at[node]), np.flatnonzero(b.node == node)
            for key in ("old", "new"):
                state = getattr(b, key)[two]
                state = state if self.sign > 0 else MIRRORED[state]
                assert getattr(a, key)[one].tolist() == state.tolist(), (node, key)
            places = [np.column_stack([e.cycle, e.load])[k] for e, k in ((a, one), (b, two))]
            assert np.abs(places[0] - places[1]).max(initial=0.0) < 1e3 * rel, node


def _told(value: Any, image: Image, along: int, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values of a turning point of a summary, those of its image in its order."""
    if isinstance(value, dict) and "q_min" in value:
        ends = sorted(image.sign * value[name] for name in ("q_min", "q_max"))
        value = value | {"q_min": ends[0], "q_max": ends[1]}
    if isinstance(value, dict):
        for name, part in value.items():
            if name not in ("edge", "load"):
                yield from _told(part, image, 1 if "half_width" in name else along, name)
    elif isinstance(value, list):
        # along the image of an edge what was last may be first
        name = value[:1] if key == "zones" and isinstance(value[0], str) else []
        for part in [*name, *value[len(name) :][::along]]:
            yield from _told(part, image, along, key)
    elif isinstance(value, str):
        ways = {"forward slip": "backward slip", "backward slip": "forward slip"}
        yield key, ways.get(value, value) if image.sign < 0 else value
    elif isinstance(value, float) and key not in ("angle", "exponent", "fitted"):
        traction = key[:2] in ("p_", "q_")
        side = along if key in ("x", "value", "interval", "zones") else 1
        yield key, value * (image.factor(0, 1) if traction else side * image.factor(1))
    else:
        yield key, value


def played(scene: rf.Scene) -> rf.Record:
    """The record of a scene, on this rank alone."""
    return rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)


def image_for(scene: rf.Scene, number: int) -> Image:
    """Units, turn, mirror and shift that a scene allows, by a number."""
    if scene.axisymmetric:  # upside down
        return Image(0.9, 7.0, 2, True, (0.0, 0.3), True)
    if any(body.is_half_plane for body in scene.bodies):
        return Image(0.9, 7.0, 2, False, (0.1, 0.3))
    return Image(0.9, 7.0, 1 + number % 3, number % 2 == 0, (0.1, 0.3))
