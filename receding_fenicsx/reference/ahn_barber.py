"""Published values of Ahn & Barber (2008), and comparison of a record with them.

Source: Y. J. Ahn, J. R. Barber, Response of frictional receding contact problems to cyclic loading,
International Journal of Mechanical Sciences 50 (2008) 1519-1525.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx.interface.law import STATE_NAMES, State
from receding_fenicsx.interface.measures.steady import slip_exponents
from receding_fenicsx.interface.measures.zones import zones
from receding_fenicsx.scene.model import Scene

if TYPE_CHECKING:
    from receding_fenicsx.evolution.record import Record

DISSIPATION_RATIO = 0.56
"""Section 3.2: steady dissipation per cycle is "approximately 56%" of that of the first cycle."""
DISSIPATION_TOLERANCE = 0.01
"""Tolerance of "approximately 56%"."""
SLIP_EXPONENT = -3.1
"""Section 3.2, Fig. 8: slip increment per cycle ~ N^-3.1 at a representative node."""
SLIP_TOLERANCE = 0.1
"""Tolerance of the exponent, which is given with two digits for one node."""
SLIP_CYCLES = (4, 20)
"""Cycles N of the fit: earlier ones do not follow a power law, later increments are small."""
SLIP_NODES = (0.5, 0.8)
"""Range of |x| / h of the nodes of the fit, which slip in each of these cycles."""
SLIP_FLOOR = 1e-9
"""Part of the largest increment below which an increment is round-off."""
SCENE_TOLERANCE = 1e-6
"""Largest difference of the numbers of a scene from those of the paper."""


def is_papers_block(scene: Scene) -> bool:
    """Return whether a scene is the paper's block cycled between p0 and p0/3 (sections 2, 3.2)."""
    body, material, history = scene.body, scene.material, scene.history
    if len(scene.contacts) != 1 or len(scene.loads) != 1 or scene.preloads or scene.supports:
        return False
    contact, load = scene.contacts[0], scene.loads[0]
    span = load.span or (-0.5 * body.width, 0.5 * body.width)
    return (
        body.shape == "rectangle"
        and body.mesh is None
        and material.kinematics == "plane strain"
        and (contact.edge, contact.span, load.edge) == ("bottom", None, "top")
        and history.kind == "cyclic"
        and history.initial_slip is None
        and _close(contact.initial_gap, 0.0)
        and _close(contact.friction, 0.35)
        and _close(material.poisson, 0.3)
        and isinstance(load.pressure, float | int)
        and load.pressure > 0.0
        and _close(body.width / body.height, 4.0)
        and _close(span[0] / body.height, -1.0)
        and _close(span[1] / body.height, 1.0)
        and _close(history.minimum / history.maximum, 1.0 / 3.0)
    )


def paper_table(record: Record) -> list[dict[str, Any]]:
    """Compare a record of the paper's block with the paper.

    Args:
        record: any record.

    Returns:
        Rows ``{"quantity", "paper", "ours", "agrees"}``; "ours" and "agrees" are None if there are
        too few cycles. Empty if the record is not of the paper's block.
    """
    scene = record.scene
    if scene is None or not is_papers_block(scene):
        return []
    rows = [_loading_zones(record), _unloading_zones(record)]
    rows += [_dissipation(record), _exponent(record, scene.body.height)]
    return [dict(zip(("quantity", "paper", "ours", "agrees"), row, strict=True)) for row in rows]


Row = tuple[str, str | float, str | float | None, bool | None]

STICK, OPEN, FORWARD, BACKWARD = (
    STATE_NAMES[s] for s in (State.STICK, State.SEPARATION, State.FORWARD_SLIP, State.BACKWARD_SLIP)
)
LOADING = [OPEN, BACKWARD, STICK, FORWARD, OPEN]
"""First loading from x < 0 to x > 0 (section 3, Fig. 4): both slips are outwards."""
UNLOADING_HALF = [STICK, FORWARD, STICK, BACKWARD, OPEN]
"""Unloading from the centre to x > 0 (section 3.1, Fig. 5); the mirror image on the other half."""


def _loading_zones(record: Record) -> Row:
    table = record.turning_points
    row = int(np.flatnonzero(table.cycle == 0)[-1])
    found = [name for name, _, _ in zones(record.x, table.state[row])]
    return (
        "zones on first loading, from x < 0 to x > 0",
        "stick, flanked by forward and backward slip, then separation",
        ", ".join(found),
        found == LOADING,
    )


def _unloading_zones(record: Record) -> Row:
    table = record.turning_points
    rows = np.flatnonzero((table.cycle == 1) & (table.leg == 0))
    quantity = "zones on first unloading to p0/3, from the centre to x > 0 (mirrored on x < 0)"
    if not len(rows):
        return quantity, ", ".join(UNLOADING_HALF), None, None
    found = [name for name, _, _ in zones(record.x, table.state[rows[0]])]
    middle = len(found) // 2
    swap = {FORWARD: BACKWARD, BACKWARD: FORWARD}
    mirrored = [swap.get(name, name) for name in found[::-1]] == found
    right = found[middle:]
    return (
        quantity,
        ", ".join(UNLOADING_HALF),
        ", ".join(right) + ("" if mirrored else " (not mirrored)"),
        mirrored and right == UNLOADING_HALF,
    )


def _dissipation(record: Record) -> Row:
    D = record.cycles.dissipation
    quantity = "dissipation of the last cycle over that of the first"
    if len(D) < SLIP_CYCLES[1] or not D[0] > 0.0:
        return quantity, DISSIPATION_RATIO, None, None
    ratio = float(D[-1] / D[0])
    agrees = abs(ratio - DISSIPATION_RATIO) <= DISSIPATION_TOLERANCE
    return quantity, DISSIPATION_RATIO, ratio, agrees


def _exponent(record: Record, height: float) -> Row:
    slip = record.cycles.slip_increment
    quantity = "exponent of the slip increment per cycle over N (median of nodes)"
    if len(slip) < SLIP_CYCLES[1]:
        return quantity, SLIP_EXPONENT, None, None
    distance = np.abs(record.x) / height
    rows = np.abs(slip[SLIP_CYCLES[0] - 1 : SLIP_CYCLES[1]])
    moving = np.all(rows > SLIP_FLOOR * np.abs(slip).max(), axis=0)
    nodes = (distance >= SLIP_NODES[0]) & (distance <= SLIP_NODES[1]) & moving
    if not np.any(nodes):
        return quantity, SLIP_EXPONENT, None, None
    found = float(np.median([fit.exponent for fit in slip_exponents(slip, SLIP_CYCLES, nodes)]))
    return quantity, SLIP_EXPONENT, found, abs(found - SLIP_EXPONENT) <= SLIP_TOLERANCE


def _close(value: object, wanted: float) -> bool:
    return isinstance(value, float | int) and abs(value - wanted) <= SCENE_TOLERANCE
