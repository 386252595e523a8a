"""Descriptions of a record for the screen: text, and HTML with zones for notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from receding_fenicsx.arrays import brief, described
from receding_fenicsx.evolution.moment import Moment, moment_of
from receding_fenicsx.evolution.record_data import RecordData
from receding_fenicsx.interface.law import STATE_NAMES, State

STATE_COLOURS = {
    State.STICK: "#c3cad3",
    State.SEPARATION: "#f6f6f6",
    State.FORWARD_SLIP: "#e69f00",
    State.BACKWARD_SLIP: "#0072b2",
}
"""Fill colour of each state."""
SHOWN_ZONES, SHOWN_EDGES = 8, 4
"""Numbers of items that a line names."""


def text_of(record: RecordData, title: str, edges: Mapping[str, RecordData]) -> str:
    """Return what a record, and each edge's by itself, is of, in at most 30 lines."""
    which = "half of the contact" if record.half else "the whole contact"
    points, samples, steady = record.turning_points, record.samples, record.steady
    D, load = record.cycles.dissipation, record.turning_points.load
    state = "steady state not reached"
    if steady.reached:
        state = f"steady state: {steady.kind} from cycle {steady.cycle}, period {steady.period}"
    dissipation = f"first loading {record.dissipation_first_loading:.6g}"
    if len(D):
        dissipation += f", cycle 1 {D[0]:.6g}, cycle {len(D)} {D[-1]:.6g}"
    sampled = list(map(str, np.unique(samples.cycle)))
    more = ", ..." if len(sampled) > 12 else ""
    in_cycles = f" in cycles {', '.join(sampled[:12])}{more}" if sampled else ""
    rows = [
        ("contact", f"{len(record.x)} nodes, x {brief(record.x)}; modelled: {which}"),
        ("edges", ", ".join(record.edge_names) or "-"),
        ("friction", brief(record.f)),
        *(
            (f"load {name}", f"{load[:, k].min():.6g} to {load[:, k].max():.6g}")
            for k, name in enumerate(record.load_names[:SHOWN_EDGES] if len(load) else ())
        ),
        ("cycles", f"{len(D)}, {state}"),
        ("dissipation", dissipation),
        ("turning points", f"{len(points.s)}"),
        ("samples", f"{len(samples.s)}{in_cycles}"),
        ("events", f"{record.n_events}, kept {len(record.events.s)}"),
        ("residual", f"{record.residual_max:.1e}, energy error {record.energy_error_max:.1e}"),
    ]
    if record.uniqueness is not None:
        found = record.uniqueness
        sure = "certified" if found.certified else "not certified"
        if found.certified and not found.first_loading_proved:
            sure += " after the first loading"
        rows.append(("only path", f"{sure}, friction margin {found.margin:.3g}"))
    if steady.change.size:
        rows.append(("last change", f"{steady.change[-1]:.1e} of the largest force"))
    if record.jumps:
        rows.append(("jumps", f"{record.jumps}, energy released {record.released:.3g}"))
    for name, at in _last_turning_points(edges):
        zones = [f"{zone} {a:.4g} to {b:.4g}" for zone, a, b in at.zones[:SHOWN_ZONES]]
        rest = len(at.zones) - SHOWN_ZONES
        rows.append((name, " | ".join(zones) + (f" | {rest} more" if rest > 0 else "")))
    return described(f"Record of {title or 'an untitled scene'}, method {record.method}", rows)


def html_of(text: str, edges: Mapping[str, RecordData]) -> str:
    """Return a description with a strip of zones for each of an edge's last turning points."""
    colours = {name: STATE_COLOURS[state] for state, name in STATE_NAMES.items()}
    strips = ""
    for name, at in _last_turning_points(edges):
        length = 0.01 * (at.zones[-1][2] - at.zones[0][1]) or 1.0
        boxes = "".join(
            f'<i title="{escape(zone)}: {a:.4g} to {b:.4g}" style="flex:{(b - a) / length:.6g};'
            f'outline:1px solid;background:{colours.get(zone, STATE_COLOURS[State.STICK])}"></i>'
            for zone, a, b in at.zones
        )
        label = f'<span style="flex:none;width:16em">{escape(name)}</span>'
        strips += f'<div style="display:flex">{label}{boxes}</div>'
    legend = " ".join(
        f'<span style="border-left:1em solid {colour}">&nbsp;{name}</span>'
        for name, colour in colours.items()
    )
    return f"<div><pre>{escape(text)}</pre>{strips}{legend}</div>"


def _last_turning_points(edges: Mapping[str, RecordData]) -> list[tuple[str, Moment]]:
    """Return the turning points of the last cycle on the first contact edges, with their names."""
    found = []
    for edge, part in list(edges.items())[:SHOWN_EDGES]:
        points = part.turning_points
        last = points.cycle.max(initial=0)
        for row in np.flatnonzero(points.cycle == last)[:SHOWN_EDGES]:
            at = moment_of(part, points, int(row))
            where = f"cycle {last}, leg {at.leg}"
            found.append((f"{where}, {edge}" if len(edges) > 1 else where, at))
    return found
