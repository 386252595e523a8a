# %% [markdown]
# # Fretting of a cylinder by half-planes
#
# A cylinder is pressed on a half-plane of the same material and sheared to and fro by less than the friction force. A body that is large
# against its contact needs no mesh: its stiffness is Flamant's solution.

# %%
import numpy as np

import receding_fenicsx as rf

scene = rf.read_scene("demos/half_planes.toml")
record = rf.run(scene)
R, P, Q, f = 100.0, 1.0, 0.3, 0.5
star = 100.0 / (1.0 - 0.3**2)  # E* of two bodies with E = 200, nu = 0.3
a = np.sqrt(4.0 * P * R / (np.pi * star))  # Hertz
print("Hertz's half width", a)

# %% [markdown]
# ## Partial slip
#
# The middle sticks, the edges slip. Cattaneo and Mindlin: the stick zone has the half width $c = a \sqrt{1 - Q / (f P)}$.

# %%
sheared = record.at(cycle=0)  # pressed, then sheared by Q
for name, start, end in sheared.zones:
    print(f"{name:14} {start:+.3f} to {end:+.3f}")
(stick,) = [end - start for name, start, end in sheared.zones if name == "stick"]
c = a * np.sqrt(1.0 - Q / (f * P))
spacing = record.x[1] - record.x[0]
print(f"half width of stick {0.5 * stick:.4f}, closed form {c:.4f}, node spacing {spacing:.4f}")
assert abs(0.5 * stick - c) < spacing
rf.figures.tractions(record, sheared).savefig("fretting.png")

# %% [markdown]
# ![Shear tractions of two sheared cylinders: dots on the closed form](../../demos/pictures/cattaneo_mindlin.png)
#
# ## Dissipation per cycle
#
# It drives fretting wear. It is exact between changes of state; what remains is the error of the mesh.

# %%
U = Q / (f * P)
known = (f * P) ** 2 / (np.pi * star) * (4 * (1 - U) * np.log(1 - U) + 4 * U - 2 * U**2)
print("dissipation", record.cycles.dissipation[-1], "closed form", known)
assert abs(record.cycles.dissipation[-1] / known - 1.0) < 1e-3

# %% [markdown]
# A bulk `tension` of the lower body in phase with Q moves the stick zone, loads out of phase make it walk: `demos/fretting.toml` and
# [half-planes](../half_planes.md).
