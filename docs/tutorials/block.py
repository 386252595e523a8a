# %% [markdown]
# # The paper's block in 15 minutes
#
# An elastic block of height h and width 4h lies on a rigid plane with friction f = 0.35. A pressure acts on the middle of its top and
# cycles between 1 and 1/3 (Ahn & Barber 2008). You will run it, look at its zones, and find the two numbers that the paper ends with.
#
# This page is a notebook. In the project's folder, whose scenes it reads: `jupytext --to ipynb -o block.ipynb docs/tutorials/block.py`
# (`pip install jupytext notebook`), or `python docs/tutorials/block.py`.

# %%
import numpy as np

import receding_fenicsx as rf

scene = rf.read_scene("demos/block.toml", ["history.cycles=20"])
record = rf.run(scene)  # mesh, condense, 20 exact cycles; rf.run(scene, "folder") writes files too
print(len(record.x), "contact nodes,", record.n_events, "changes of state")

# %% [markdown]
# ## First loading
#
# The contact *recedes*: the block touches the plane all along before it is loaded, and lifts off at its ends as soon as it is pressed.
# While the load grows, the zones of stick, slip and separation do not depend on it.

# %%
first = record.at(cycle=0)
for name, start, end in first.zones:
    print(f"{name:14} {start:+.3f} to {end:+.3f}")
rf.figures.tractions(record, first).savefig("first_loading.png")

# %% [markdown]
# ## Unloading
#
# At a third of the load what was slipping sticks, or slips backwards from the edge of the contact inwards.

# %%
low = record.at(cycle=1, load="minimum")
print(", ".join(name for name, start, end in low.zones if end > 0))
rf.figures.zone_maps(record, 9).savefig("zones_of_cycle_9.png")

# %% [markdown]
# ## The steady cycle
#
# ![Zones in the steady cycle](../../demos/pictures/zones_steady.png)
#
# Stuck nodes remember where they stuck, so the steady cycle is approached slowly: slip per cycle falls like $N^{-3.1}$, and the
# dissipation tends to about 56 % of that of the first cycle. `until = "limit"` takes the limit itself.

# %%
slip = np.abs(record.cycles.slip_increment)
N = np.arange(4, 21)
nodes = (np.abs(record.x) >= 0.5) & (np.abs(record.x) <= 0.8)
nodes &= np.all(slip[N - 1] > 1e-9 * slip.max(), axis=0)
exponent = np.median(np.polyfit(np.log(N), np.log(slip[N - 1][:, nodes]), 1)[0])
long = rf.read_scene("demos/block.toml", ["history.cycles=200"])
limit = rf.evolve(rf.condense(long), long, until="limit")
ratio = limit.cycles.dissipation[-1] / limit.cycles.dissipation[0]
print(limit.limit)
print(f"slip per cycle falls like N^{exponent:.2f}; steady over first dissipation {ratio:.4f}")
assert abs(exponent + 3.1) < 0.1, "Fig. 8 of the paper: N^-3.1"
assert abs(ratio - 0.56) < 0.01, "section 3.2 of the paper: about 56 %"

# %% [markdown]
# ## How far to trust it
#
# The largest violation of the contact law, relative to the largest nodal force, and whether the path is proved to be the only one:

# %%
print(record.residual_max, record.uniqueness)
assert record.residual_max < 1e-11

# %% [markdown]
# Next: [your own body](own_body.py), or [which mesh gives my numbers to 1e-3?](../tolerance.md)
