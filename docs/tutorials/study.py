# %% [markdown]
# # A study in Python, without a file
#
# How does the dissipation of a clamped block under a shear force of 0.3 of its pressing force depend on friction? The scene is built in Python; one condensed
# system serves all frictions.

# %%
import matplotlib.pyplot as plt
import numpy as np

import receding_fenicsx as rf

scene = rf.Scene(
    body=rf.Body(width=2.0, height=1.0),
    material=rf.Material(young=1.0, poisson=0.3),
    mesh=rf.MeshOptions(contact_elements=32),
    contacts=(rf.Contact(friction=0.34),),
    loads=(
        rf.Load("P", "top", platen=True, force=(0.0, -1.0)),
        rf.Load("Q", "top", platen=True, force=(1.0, 0.0)),
    ),
    history=rf.HistoryOptions(
        kind="table",
        columns=("P", "Q"),
        rows=((1.0, 0.0), (1.0, 0.3)),
        cycle_rows=((1.0, -0.3), (1.0, 0.3)),
        cycles=100,
        until="limit",
    ),
)
print(rf.to_toml(scene))  # the same as a file

# %% [markdown]
# ## One table
#
# `rf.sweep` runs the scene for every combination of values; `measure` gives the columns. The last cycle is the limit of infinitely many.


# %%
def numbers(record: rf.Record) -> dict[str, float | str]:
    """Return the columns of the table."""
    return {"D": record.cycles.dissipation[-1], "steady": record.steady.kind}


friction = [0.31, 0.32, 0.34, 0.4]
table = rf.sweep(scene, {"contact.friction": friction}, measure=numbers)
print(table)
print(table["D"])

# %%
figure, axes = plt.subplots()
axes.plot(friction, table["D"], "o-")
axes.set(xlabel="coefficient of friction", ylabel="dissipation per cycle")
figure.savefig("study.png")

# %% [markdown]
# ## Scaling
#
# All stresses are proportional to the load, and dissipation to its square over Young's modulus: a study in units of one's own needs no
# other run.

# %%
twice = rf.from_toml(rf.to_toml(scene), ["load.P.force=[0, -2]", "load.Q.force=[2, 0]"])
once, doubled = (rf.run(s).cycles.dissipation[-1] for s in (scene, twice))
print("ratio of dissipations", doubled / once)
assert np.isclose(doubled, 4.0 * once, rtol=1e-9)
assert np.all(np.diff(table["D"]) < 0.0), "more friction, less slip"

# %% [markdown]
# Next: [sweeps on many processes](../sweeps.md), [how do I extend it?](extending.py)
