# %% [markdown]
# # Your own body from gmsh
#
# Any plane body that gmsh can mesh is a scene. Name each edge that you use as a physical curve, and the body as a physical surface. Here a
# trapezium stands on its long side and is pressed on its short one.

# %%
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

Path("trapezium.geo").write_text("""
DefineConstant[top = {1.0}, contact_elements = {40}];
Point(1) = {-1, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {top, 1, 0}; Point(4) = {-top, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1 : 4}; Plane Surface(1) = {1};
Transfinite Curve{1} = contact_elements + 1;
MeshSize{3, 4} = 0.1;
Physical Curve("foot") = {1}; Physical Curve("head") = {3}; Physical Curve("free") = {2, 4};
Physical Surface("body") = {1};
""")

# %% [markdown]
# `contact_elements` comes from the scene, other constants from `parameters`. The load is 1 on the head of length 2 top.

# %%
scene = rf.from_toml(
    """
[body]
mesh = "trapezium.geo"
parameters = {top = 0.5}
[mesh]
contact_elements = 40
[contact]
edge = "foot"
friction = 0.35
[[load]]
name = "p0"
edge = "head"
pressure = 1.0
[history]
cycles = 3
""",
    folder=Path.cwd(),
)
record = rf.run(scene)
for name, start, end in record.at(cycle=0).zones:
    print(f"{name:14} {start:+.3f} to {end:+.3f}")

# %% [markdown]
# ## Check it
#
# The reactions carry the pressure on the head, exactly; a shape or a load that is misspelt would not pass. Then ask for the error of the numbers:
# `rf.run(scene, "folder", rf.RunOptions(error=True))` solves on coarser meshes too.

# %%
P = record.turning_points.P[0]
print("resultant", P.sum(), "residual", record.residual_max)
assert np.isclose(P.sum(), 1.0, rtol=1e-9)
assert record.residual_max < 1e-11

# %% [markdown]
# Next: [several bodies and edges](../bodies.md), [rotation, heat, fits, springs, bolts](../loads.md).
