"""Frictional receding contact of elastic bodies under cyclic loading, with FEniCSx.

One import is enough; ``__init__.pyi`` lists all public names, loaded when they are first used::

    import receding_fenicsx as rf

From a scene to its results in one call::

    scene = rf.read_scene("block.toml", ["history.cycles=20"])  # a TOML file, with changes
    record = rf.run(scene)                                      # in memory
    record = rf.run(scene, "results/mine")                      # also files, figures, report

or in steps, to apply other histories, frictions and gaps to the same condensed body::

    system = rf.condense(scene, whole=True)           # K and r_star on the contact nodes, eq. (11)
    record = rf.evolve(system, scene)                 # or another scene of the same body

A :class:`Record` returns values by name, tables and figures::

    low = record.at(cycle=9, load="minimum")          # low.x, low.p, low.q, low.v, low.w, low.zones
    record.cycles.dissipation                         # one value for each cycle, from cycle 1
    record.to_pandas()                                # or to_xarray(), to_table()
    rf.figures.tractions(record, low)                 # a Matplotlib figure; or zone_maps, ...

One scene over a grid of values, a row of a table for each case::

    table = rf.sweep(scene, {"contact.friction": [0.2, 0.4], "history.minimum": [0.0, 0.5]})
    table["dissipation_last_cycle"], table.grid("steady"), table.to_pandas()

Signs and symbols are those of Ahn & Barber (2008): ``v, w`` tangential and normal displacement,
``Q, P`` tangential and normal reaction on the body, ``P > 0`` compression; "load" is a load factor.
"""

import os

import lazy_loader

# The interface's dense matrices are small: with the default number of threads their products and
# solves were measured up to 70 times slower than with one. The libraries read this once, when NumPy
# loads them; what the user has set wins.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

__version__ = "1.0.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
