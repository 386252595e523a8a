"""A coarse block, instants of a scene and what its pictures show; on any number of ranks."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.output.snapshots.view import View, view_of
from receding_fenicsx.pictures import picture_body

COMM = MPI.COMM_WORLD
BLOCK = Path(__file__).parents[1] / "demos" / "block.toml"


def small_block(symmetry: str = "auto") -> rf.Scene:
    """The paper's block on a coarse mesh, for one cycle."""
    text = ["mesh.contact_elements=16", "history.cycles=1", f'solver.symmetry="{symmetry}"']
    return rf.read_scene(BLOCK, text)


def instant_of_row(scene: rf.Scene, row: int = 1) -> tuple[rf.Record, Instant]:
    """The record of a scene and one of its turning points, on every rank."""
    system = rf.condense(scene, COMM)

    def make() -> tuple[rf.Record, Instant]:
        whole = rf.given(system)
        record = rf.evolve(whole, scene)
        table, state = record.turning_points, turning_point(record, whole, row)
        cycle, leg = int(table.cycle[row]), int(table.leg[row])
        return record, Instant(cycle, leg, 1.0, table.load[row], state.v, state)

    return COMM.bcast(rf.on_root(COMM, make))


def view_at(scene: rf.Scene, now: Instant) -> tuple[View, Fields] | None:
    """What a picture of an instant shows, and the fields behind it; on rank 0."""
    with picture_body(scene, COMM) as bulk:
        found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
        return None if found is None else (view_of(bulk, found, now), found)
