"""Frictional receding contact of elastic bodies under cyclic loading, with FEniCSx.

The way from a scene to what happens on it::

    scene = read_scene("block.toml", ["history.cycles=20"])  # TOML, with changes
    record = run(scene)                                      # the whole way, in memory
    record = run(scene, "results/mine")                      # the same, written and drawn

or step by step, to play other histories, frictions and gaps on the same body::

    system = condense(scene, whole=True)              # K, r_star on the contact nodes (eq. 11)
    record = evolve(system, scene)                    # or another scene of the same body

What a :class:`Record` holds is asked for by names, and drawn::

    low = record.at(cycle=9, load="minimum")          # low.x, low.p, low.q, low.v, low.w, low.zones
    record.cycles.dissipation                         # a value a cycle, from cycle 1
    record.to_pandas()                                # or to_xarray(), to_table()
    figures.tractions(record, low)                    # a Matplotlib figure
    figures.zone_maps(record, 9)
    figures.hysteresis(record)

Signs and symbols are those of Ahn & Barber (2008): ``v, w`` tangential and normal displacement,
``Q, P`` tangential and normal reaction on the body, ``P > 0`` compression; "load" is a load factor.
"""

import os
from typing import TYPE_CHECKING, Any

# The interface's dense matrices are small: with the default number of threads their products and
# solves were measured up to 70 times slower than with one. The libraries read this once, when NumPy
# loads them; what the user has set wins.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

if TYPE_CHECKING:
    from receding_fenicsx.evolution.evolve import evolve as evolve
    from receding_fenicsx.evolution.record import Record as Record
    from receding_fenicsx.interface.system import ContactSystem as ContactSystem
    from receding_fenicsx.output.plots import figures
    from receding_fenicsx.output.storage.hdf5 import read_record as read_record
    from receding_fenicsx.scene.history import History as History
    from receding_fenicsx.scene.history import from_scene as history_from_scene
    from receding_fenicsx.scene.model import Scene as Scene
    from receding_fenicsx.scene.toml_file import read_scene as read_scene
    from receding_fenicsx.scene.toml_file import to_toml as to_toml
    from receding_fenicsx.study import condense as condense
    from receding_fenicsx.study import run as run

__version__ = "0.1.0"

# No module that needs DOLFINx, MPI or a display is loaded before it is asked for.
_PLACES = {
    "Scene": "scene.model",
    "read_scene": "scene.toml_file",
    "to_toml": "scene.toml_file",
    "History": "scene.history",
    "history_from_scene": "scene.history",
    "ContactSystem": "interface.system",
    "evolve": "evolution.evolve",
    "Record": "evolution.record",
    "read_record": "output.storage.hdf5",
    "condense": "study",
    "run": "study",
}

__all__ = [
    "ContactSystem",
    "History",
    "Record",
    "Scene",
    "condense",
    "evolve",
    "figures",
    "history_from_scene",
    "read_record",
    "read_scene",
    "run",
    "to_toml",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    from importlib import import_module

    if name == "figures":
        return import_module(f"{__name__}.output.plots.figures")
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    known = {"history_from_scene": "from_scene"}.get(name, name)
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), known)
