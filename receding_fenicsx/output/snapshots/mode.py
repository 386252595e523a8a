"""Picture of a slip mode: the body deformed by it, its stress, assumed directions of slip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from receding_fenicsx.bulk.fields import gather_fields, solve_fields
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.branches.critical_friction import CriticalFriction
from receding_fenicsx.interface.law import Friction, State
from receding_fenicsx.interface.system import ContactState
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots.colours import quantity_of
from receding_fenicsx.output.snapshots.draw import draw_sheets, sheets_of
from receding_fenicsx.output.snapshots.layout import layout_of
from receding_fenicsx.output.snapshots.render import find_renderer
from receding_fenicsx.output.snapshots.view import Units, units_of, view_of

if TYPE_CHECKING:
    from receding_fenicsx.bulk.stack import Stack


def draw(bulk: Stack, critical: CriticalFriction | None, file: Path) -> Path | None:
    """Draw the body deformed by a mode (rank 0's), without loads, at the mode's friction.

    Raises:
        InputError: there is no mode, or the body's contact nodes are not those of the mode.
    """
    n, none = len(bulk.contact.x), np.zeros(len(bulk.scene.load_names))

    def checked() -> CriticalFriction:
        found = given(critical)
        if len(found.signs) != n or not found.mode.any():
            raise InputError(
                f"slip mode: a mode of the scene's {n} contact nodes is needed, not one of "
                f"{len(found.signs)} with largest entry {np.abs(found.mode).max():g}"
            )
        find_renderer()
        return found

    critical = bulk.comm.bcast(on_root(bulk.comm, checked))
    signs = critical.signs
    force = np.abs(critical.reactions).reshape(2, n).max(axis=0)
    slips = np.where(signs > 0.0, State.FORWARD_SLIP, State.BACKWARD_SLIP)
    # reaction over the largest one below which a node without a direction of slip is open
    stays = np.where(force > 1e-9 * force.max(), State.STICK, State.SEPARATION)
    states = np.where(signs != 0.0, slips, stays).astype(np.int8)
    state = ContactState(critical.mode, critical.reactions, states)
    now = Instant(0, 0, 0.0, none, critical.mode[:n], state)
    parts = gather_fields(solve_fields(bulk, none, critical.mode))

    def page() -> Path:
        fields = given(parts)
        view = view_of(bulk, fields, now, Units(units_of(bulk, [fields], none).factor, 1.0, ""))
        f = [critical.factor * c for c in (view.f.forward, view.f.backward)]
        text = rf"changes in a slip mode, slip as assumed, $\varphi$ = {critical.factor:.4g}"
        sheets = sheets_of(
            [replace(view, caption=text, f=Friction(*f))], quantity_of("von_mises"), layout_of(view)
        )
        with mpl.rc_context(style.RC):
            for sheet in draw_sheets(sheets):
                style.save(sheet, file)
        return file

    return on_root(bulk.comm, page)
