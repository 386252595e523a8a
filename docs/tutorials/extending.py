# %% [markdown]
# # How do I extend it?
#
# Data and imports go one way: scene, mesh, bulk, condensed system, evolution, record, pictures.
#
# | folder | what it holds | needs |
# | --- | --- | --- |
# | `scene/` | what is modelled: dataclasses, TOML files, checks, histories, symmetry | NumPy |
# | `bulk/`, `half_plane/` | meshes, elasticity, loads, condensation, back-substitution | DOLFINx, PETSc, gmsh |
# | `interface/` | contact of a condensed body: law, exact path, Gauss-Seidel, complementarity, measures, shakedown, uniqueness | NumPy, SciPy, Numba |
# | `evolution/` | histories on a system: cycles, record, checkpoints, limits, branches | NumPy |
# | `studies/` | runs, sweeps, joints, shakedown, errors in space; `studies/runner.py` runs cases on one process or many and says how to write a study | all |
# | `output/`, `store/`, `exchange/` | figures, pictures, report; files; other programs | Matplotlib, PyVista, h5py |
# | `reference/` | closed forms and published values | SciPy |
#
# The [pages of the API](../../receding_fenicsx/__init__.pyi) have each folder with its modules and equations; `receding_fenicsx/__init__.pyi` lists
# the public names. The tests run the recipes below: what you can do with public names, then which files a change of the package touches.
#
# ## A condensed body from elsewhere
#
# A `ContactSystem` may come from any code. One node on a spring, pressed by 1 and pulled to and fro by 0.5:

# %%
import numpy as np

import receding_fenicsx as rf

stiffness, f, pull = 2.0, 0.3, 0.5
system = rf.ContactSystem(
    x=np.array([0.0]),
    points=np.array([[0.0, 0.0]]),
    weight=np.array([1.0]),
    K=np.diag([stiffness, 1.0]),  # order [v; w]
    r_star=np.array([[0.0, 1.0], [-1.0, 0.0]]),  # reactions [Q; P] to each load, node held
    load_names=("press", "pull"),
    f=np.array([f]),
    g0=np.array([0.0]),
    held=np.array([False, False]),
    rigid=np.zeros((2, 0)),
)
path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, pull]])
cycle = np.array([[1.0, pull], [1.0, -pull], [1.0, pull]])
history = rf.History(("press", "pull"), path, cycle, cycles=3)
record = rf.evolve(system, history)

# |Q| = f P while the spring moves between -(pull - f) / stiffness and its opposite
exact = 4.0 * f * (pull - f) / stiffness
assert np.allclose(record.cycles.dissipation, exact, rtol=1e-12)
assert record.steady.reached and record.steady.kind == "cyclic slip"

# %% [markdown]
# A body: [a tutorial](own_body.py) makes one by gmsh; `bulk/mesh/user_mesh.py` reads such files.
#
# ## A friction law
#
# Friction may differ from node to node and for the two directions of slip, Q = -f P and Q = +f_backward P:

# %%
from dataclasses import replace

forward, backward = 0.3, 0.1
directed = rf.evolve(replace(system, f_backward=np.array([backward])), history)

# Q runs between -0.3 and 0.1, the spring moves by (2 pull - 0.3 - 0.1) / stiffness each way
exact = (forward + backward) * (2.0 * pull - forward - backward) / stiffness
assert np.allclose(directed.cycles.dissipation, exact, rtol=1e-12)

# %% [markdown]
# In the package: the law in `interface/law.py` (`Friction`), fields of `ContactSystem` (`interface/system.py`), the key of `Contact`
# (`scene/model.py`) with its checks and its values at the nodes (`evolution/problem.py`), and `tests/equations.py`, which states the law once more,
# independently. The exact path needs limits that are linear in P and Q and do not depend on time; several
# of them, of which the lowest holds, are followed by `interface/shear_branches`.
#
# ## A load
#
# A load is a row of `r_star`: the reactions to it with all contact nodes held. A fluid pressure in the gap:

# %%
fluid = np.concatenate([np.zeros(system.n), -system.weight])
wet = replace(
    system,
    r_star=np.vstack([system.r_star, fluid]),
    load_names=(*system.load_names, "fluid"),
)
path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.4]])
record = rf.evolve(wet, rf.History(wet.load_names, path, np.zeros((0, 3))))
assert np.allclose(record.turning_points.P[:, 0], [1.0, 0.6])

# %% [markdown]
# In the package: a field of `Load` in `scene/options.py` with its text and checks, its nodal forces in `bulk/loads.py`, its symmetry in
# `scene/symmetry.py`, and a patch test.
#
# ## A solver
#
# An object with the two methods of the protocol `rf.Solver`. Here every load step is one static problem:


# %%
class StaticSteps:
    """Load steps, each of them one static problem with slip counted from its start."""

    def __init__(self, system, options):
        self.system, self.steps = system, options.steps_per_leg
        self.exact = rf.SOLVERS["events"](system, options)

    def trace_leg(self, start, ends, force_scale, samples=0):
        leg = rf.Leg(start, np.zeros(self.system.n), force_scale=force_scale)
        loads = np.linspace(*ends, self.steps + 1)
        for k in range(self.steps):
            part = self.static_leg(leg.end, (loads[k], loads[k + 1]), leg.force_scale)
            leg.dissipation = leg.dissipation + part.dissipation
            leg.work += part.work
            leg.residual = max(leg.residual, part.residual)
            leg.end, leg.force_scale = part.end, part.force_scale
            leg.samples.append(((k + 1) / self.steps, part.end))
        return leg

    def static_leg(self, start, ends, force_scale):
        leg = self.exact.static_leg(start, ends, force_scale)
        Q, slip = 0.5 * (start.Q + leg.end.Q), leg.end.v - start.v
        leg.dissipation = -np.where(leg.end.state == rf.State.SEPARATION, 0.0, Q * slip)
        leg.work = 0.5 * sum(ends) @ self.system.r_star @ (leg.end.u - start.u)
        return leg


rf.SOLVERS["static steps"] = StaticSteps
try:
    stepped = rf.evolve(system, history, rf.SolverOptions(method="static steps", steps_per_leg=200))
finally:
    del rf.SOLVERS["static steps"]
exact = rf.evolve(system, history).cycles.dissipation
assert np.allclose(stepped.cycles.dissipation, exact, rtol=1e-2)
assert stepped.residual_max < 1e-12

# %% [markdown]
# In the package: a folder beside `interface/exact/`, a line in `SOLVERS` of `evolution/solvers.py`, and the choices of `SolverOptions.method`.
#
# ## A figure
#
# A figure is a function of a `Record`; registered, `rf.plot` draws it for every record that has its data, and the report has its caption.

# %%
import matplotlib as mpl


def friction_used(record, moment):
    """Draw |Q| over its limit f P along the contact."""
    with mpl.rc_context(rf.style.RC):
        figure = rf.style.new_figure(rf.style.COLUMN, 2.4)
        axes = figure.subplots()
        used = abs(moment.Q) / np.where(moment.P > 0.0, record.f * moment.P, np.inf)
        axes.plot(record.x, used, "o-", color=rf.style.SERIES_COLOURS[0])
        axes.set(xlabel="$x$", ylabel="$|Q|/(f P)$")
    return figure


record = rf.evolve(system, history)
friction_used(record, record.at(cycle=3)).savefig("friction_used.png")


# %%
def end_of_last_cycle(record):
    """Return the moment to draw; None where there are no cycles."""
    return record.at(cycle=-1) if len(record.cycles.dissipation) else None


rf.figures.figure("friction_used", needs=end_of_last_cycle, caption="|Q| over its limit.")(
    friction_used
)

# %% [markdown]
# ## A record column
#
# What follows from stored values needs no change of the record:

# %%
table = record.to_table("turning_points")
limit = record.f[table["node"]] * table["P"]
table["friction used"] = abs(table["Q"]) / np.where(limit > 0.0, limit, np.inf)
assert table["friction used"].max() < 1.0 + 1e-12

# %% [markdown]
# In the package: a field of `States`, `Events` or `Cycles` in `evolution/record_data.py`, its value in `evolution/collect.py`, and in
# `store/hdf5.py` a value for files that lack it.
