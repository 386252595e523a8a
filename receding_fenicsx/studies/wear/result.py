"""Result of a wear study: the contact over the cycles, table, summary, figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.measures.fatigue import fatigue_summary
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.report.contact import CRITERIA
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.studies.wear.steps import NodePairs, Row

COLUMNS = (
    *("cycles", "depth_max", "width", "volume", "dissipation"),
    *("contact_half_width", "stick_half_width"),
)
"""Columns of ``wear.csv``."""


class WearStudy:
    """The contact over the cycles: n rows, from 0 cycles, and the N nodes of the whole contact.

    Attributes:
        model: the mechanics.
        system: the unworn contact.
        rows: (n,) rows of :func:`~receding_fenicsx.studies.wear.steps.row_type`.
        end: why the last row is the last one.
        coarse: the study on a coarser mesh at the same cycles, where one fits.
        x: (N,) positions along the contact edge.
        cycles: (n,) numbers of cycles.
        depth: (n, N) depth that both bodies have lost together.
        depth_of_bodies: (n, 2, N) depth that each body has lost.
        pressure: (n, N) contact pressure at the turning point with the largest normal force.
        slip: (n, N) sliding distance of a cycle.
        zone: (n, N) state over a whole cycle: separation, stick, or (forward) slip.
        dissipation_per_cycle: (n,) dissipation of the limit cycle.
        dissipation: (n,) dissipation since the start.
        volume: (n,) worn volume of both bodies; of a plane problem that of unit thickness.
        depth_max: (n,) largest depth.
        width: (n,) width of the scar, the nodes deeper than a thousandth of the largest depth.
        contact_half_width: (n,) half the length that touches in a cycle; a radius where that begins
            on the axis.
        stick_half_width: (n,) half the length that sticks throughout a cycle.
        volume_estimate: (n,) estimated error of the volume by the steps and the mesh.
        depth_estimate: (n,) that of the largest depth; infinite at an end of a contact edge, whose
            corner makes it grow with every finer mesh.
    """

    def __init__(
        self,
        model: NodePairs,
        rows: Sequence[Row],
        share: float,
        end: str,
        coarse: WearStudy | None = None,
    ) -> None:
        """Collect the rows; ``share`` is the part of the wear that the first body takes."""
        self.model, self.system, self.end, self.coarse = model, model.whole.system, end, coarse
        self.rows: NDArray[Any] = np.stack(rows)
        row, system, mirror = self.rows, self.system, mirror_of(self.system)
        self.x, weight = mirror.odd(system.x), mirror.total(system.weight)
        self.cycles: Array = row["cycles"]
        self.depth, self.slip = mirror.even(row["depth"]), mirror.even(row["path"])
        self.depth_of_bodies = np.array([share, 1.0 - share])[:, None] * self.depth[:, None]
        if model.carried:
            self.depth_of_bodies = mirror.even(row["worn"])
        self.pressure = mirror.total(row["P"]) / np.where(weight > 0.0, weight, np.inf)
        self.zone: NDArray[np.int8] = row["zone"][:, mirror.index]
        self.dissipation_per_cycle = mirror.factor * row["energy"].sum(axis=1)
        self.dissipation = mirror.factor * row["dissipated"]
        self.volume = mirror.factor * (row["depth"] @ system.weight)
        self.depth_max = self.depth.max(axis=1)
        length = lengths(system)
        self.width = ((self.depth > 1e-3 * self.depth_max[:, None]) & (self.depth > 0.0)) @ length
        self.contact_half_width = 0.5 * ((self.zone != State.SEPARATION) @ length)
        self.stick_half_width = 0.5 * ((self.zone == State.STICK) @ length)
        by_mesh = np.zeros(len(rows))
        if coarse is not None and len(rows) > 1:
            # errors are of first order at zone ends; a single change may be small by chance
            ratio = (len(self.x) - 1) / (len(coarse.x) - 1)
            same = np.searchsorted(coarse.cycles, self.cycles[1:], side="right") - 1
            volume = np.abs(1.0 - coarse.volume[same] / self.volume[1:])
            depth = np.abs(1.0 - coarse.depth_max[same] / self.depth_max[1:])
            by_mesh[1:] = np.maximum(volume, depth) / (ratio - 1.0)
        steps: Array = row["estimate"]
        self.volume_estimate = mirror.factor * (steps @ system.weight) + by_mesh * self.volume
        # the deepest point lies between nodes: a parabola through three of them is deeper
        beside = np.pad(self.depth, ((0, 0), (1, 1)), mode="reflect")
        deepest = self.depth.argmax(axis=1)[:, None]
        bend = np.take_along_axis(np.abs(np.diff(beside, 2)), deepest, 1)[:, 0] / 8.0
        at_corner = ends_of_edges(system)[row["depth"].argmax(axis=1)] & (self.depth_max > 0.0)
        error = steps.max(axis=1) + by_mesh * self.depth_max + bend
        self.depth_estimate = np.where(at_corner, np.inf, error)

    @property
    def last(self) -> dict[str, float]:
        """The last row of ``wear.csv``."""
        return {name: float(getattr(self, name)[-1]) for name in COLUMNS}

    def record(self, row: int) -> Record:
        """Return the record of the cycle of a row: all that a run knows of the worn contact."""
        if self.model.carried:
            raise InputError("wear: profiles that a stroke carries along have no single cycle")
        return self.model.record(self.rows[row])

    def fatigue(self) -> list[dict[str, Any]]:
        """Return the fatigue parameters at some of the cycles, evenly by the depth."""
        scene = known_scene(self.system.scene_toml) if self.system.scene_toml else None
        if scene is None or scene.fatigue is None or self.model.carried:
            return []
        return [
            {"cycles": float(self.cycles[k]), **fatigue_summary(self.record(k))["fatigue"]}
            for k in self.shown(11)
        ]

    def shown(self, count: int) -> NDArray[np.int64]:
        """Return at most so many rows, the first and the last one among them, evenly by depth."""
        wanted = np.linspace(0.0, self.depth_max[-1], count)
        nearest = [np.argmin(np.abs(self.depth_max - value)) for value in wanted]
        return np.unique([*nearest, len(self.rows) - 1])

    def summary(self) -> dict[str, Any]:
        """Return the content of ``wear.json`` but for the scene and the costs."""
        profile = ("depth", "depth_of_bodies", "pressure", "slip")
        return {
            "end": self.end,
            "steps": len(self.rows) - 1,
            **self.last,
            "estimates": {
                "depth_max": float(self.depth_estimate[-1]),
                "volume": float(self.volume_estimate[-1]),
            },
            "carried": self.model.carried,
            "fatigue": self.fatigue(),
            "dissipation_per_cycle": self.dissipation_per_cycle.tolist(),
            "profile": {"x": self.x.tolist()}
            | {name: getattr(self, name)[-1].tolist() for name in profile},
        }

    def arrays(self) -> dict[str, Any]:
        """Return the contents of ``wear.csv`` and ``wear.npz``, fields over cycles and nodes."""
        names = ("x", "cycles", "depth", "depth_of_bodies", "pressure", "slip", "zone")
        more = ("dissipation_per_cycle", "volume", "volume_estimate")
        fields = {name: getattr(self, name) for name in names + more}
        return {"wear.csv": {name: getattr(self, name) for name in COLUMNS}, "wear.npz": fields}

    def __repr__(self) -> str:
        """Return the last row, its estimates, and the end."""
        last, by = self.last, " (steps)" if self.coarse is None else " (steps, mesh)"
        contact, stick = last["contact_half_width"], last["stick_half_width"]
        rows = [
            ("end", self.end),
            ("depth", f"{last['depth_max']:.6g} +- {self.depth_estimate[-1]:.1g}{by}"),
            ("volume", f"{last['volume']:.6g} +- {self.volume_estimate[-1]:.1g}{by}"),
            ("scar", f"{last['width']:.6g} wide"),
            ("half widths", f"contact {contact:.6g}, stick {stick:.6g}"),
            ("dissipation", f"{last['dissipation']:.6g}"),
        ]
        return described(f"Wear: {last['cycles']:.6g} cycles in {len(self.rows) - 1} steps", rows)


def lengths(system: ContactSystem) -> Array:
    """Return the length to each node of the whole contact, as zones end midway between nodes."""
    mirror = mirror_of(system)
    same = np.diff(system.edges[mirror.index]) == 0
    half = np.where(same, 0.5 * np.diff(mirror.odd(system.x)), 0.0)
    return np.append(half, 0.0) + np.append(0.0, half)


def ends_of_edges(system: ContactSystem) -> NDArray[np.bool_]:
    """Return which nodes are ends of contact edges, (N,), but not on an axis of symmetry."""
    apart = np.diff(system.edges, prepend=-1, append=-1) != 0
    found = apart[:-1] | apart[1:]
    if system.half or system.axisymmetric:
        found &= np.abs(system.points[:, 0]) > 1e-9 * np.abs(system.points).max()
    return found


# -- figures --------------------------------------------------------------------------------------


@mpl.rc_context(style.RC)
def figures(study: WearStudy) -> dict[str, Figure]:
    """Draw a study: profiles and zones, and fatigue parameters where there are some."""
    found = {"profiles.png": _profiles(study), "zones.png": _zones(study)}
    fatigue = study.fatigue()
    return found | ({"fatigue.png": fatigue_figure(fatigue)} if fatigue else {})


def _profiles(study: WearStudy) -> Figure:
    """Draw worn depth and pressure over x at some numbers of cycles, evenly by the depth."""
    figure = style.new_figure(style.COLUMN, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for row, colour in zip(study.shown(5), style.SERIES_COLOURS, strict=False):
        upper.plot(study.x, study.pressure[row], color=colour)
        label = f"{study.cycles[row]:,.0f} cycles"
        lower.plot(study.x, -study.depth[row], color=colour, label=label)
    upper.set(ylabel="$p$", ylim=(0.0, None))
    lower.set(xlabel="$x$", ylabel="worn depth, downwards", xlim=_seen(study))
    figure.legend(loc="outside lower center", ncols=3)
    return figure


@mpl.rc_context(style.RC)
def fatigue_figure(found: list[dict[str, Any]]) -> Figure:
    """Draw what :meth:`WearStudy.fatigue` returns, each parameter over its value at the start."""
    figure = style.new_figure(style.COLUMN, 2.8)
    axes = figure.subplots()
    cycles = [one["cycles"] for one in found]
    for name, marker, colour in zip(
        found[0]["parameters"], "os^vDx", style.SERIES_COLOURS, strict=False
    ):
        value = np.array([one["parameters"][name]["max"] for one in found])
        if value[0] > 0.0:
            look = {"marker": marker, "mfc": "none", "color": colour, "label": CRITERIA[name]}
            axes.plot(cycles, value / value[0], **look)
    axes.set(xlabel="cycles", ylabel="worst value over that at the start", ylim=(0.0, None))
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def _zones(study: WearStudy) -> Figure:
    """Draw stick, slip and separation over the cycles upwards."""
    x, cycles = study.x, np.append(study.cycles, study.cycles[-1])
    edges = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    figure = style.new_figure(style.COLUMN, 3.2)
    axes = figure.subplots()
    style.state_mesh(axes, edges, cycles, study.zone)
    axes.set(xlabel="$x$", ylabel="cycles", xlim=_seen(study))
    if cycles[-1] > 0.0:
        axes.set_yscale("symlog", linthresh=max(1.0, 1e-3 * cycles[-1]))
    patches = style.state_patches(np.unique(study.zone))
    for patch in patches:  # of a whole cycle, which slips both ways
        patch.set_label(str(patch.get_label())[3:].removeprefix("forward "))
    figure.legend(handles=patches, loc="outside upper center", ncols=len(patches))
    return figure


def _seen(study: WearStudy) -> tuple[float, float]:
    """Return the ends of what touches in any row, with some room."""
    touches: Array = study.x[np.any(study.zone != State.SEPARATION, axis=0)]
    if not len(touches):
        touches = study.x
    room = 0.1 * float(np.ptp(touches))
    return float(touches.min()) - room, float(touches.max()) + room
