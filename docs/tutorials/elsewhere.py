# %% [markdown]
# # Do you know this from elsewhere?
#
# Questions that users of general finite element programs ask, each with a problem that runs here. The threads are sources; they say nothing of
# present versions.
#
# ## Which penalty stiffness shall I take?
#
# None ([MOOSE #33356](https://github.com/idaholab/moose/issues/33356)): there is no penalty, no regularisation and no stick slope. The gap of a
# closed node is zero and a stuck node does not move, to round-off.

# %%
import numpy as np

import receding_fenicsx as rf

changes = ["mesh.contact_elements=40", "history.cycles=3"]
record = rf.run(rf.read_scene("demos/block.toml", changes))
closed = record.turning_points.P > 0
print("largest penetration:", abs((record.g0 + record.turning_points.w)[closed]).max())
assert abs((record.g0 + record.turning_points.w)[closed]).max() < 1e-12

# %% [markdown]
# ## Why does friction depend on the load step?
#
# A step satisfies the law at its end only. The exact path has no steps; load steps converge to it.


# %%
def first_cycle(*method):
    """Return the dissipation of the first cycle."""
    scene = rf.read_scene("demos/block.toml", [*changes, *method])
    return rf.run(scene).cycles.dissipation[0]


exact = first_cycle()
steps = [first_cycle('solver.method="gauss-seidel"', f"solver.steps_per_leg={n}") for n in (5, 40)]
print("error of 5 and 40 steps a leg:", steps / exact - 1.0)
assert abs(steps[1] / exact - 1.0) < 0.1 * abs(steps[0] / exact - 1.0)

# %% [markdown]
# ## Is the state right after a step was cut?
#
# Yes; elsewhere contact data of a failed attempt may survive ([MOOSE #7544](https://github.com/idaholab/moose/issues/7544)). A leg cut in two ends
# in the same state:

# %%
scene = rf.read_scene("demos/half_planes.toml", ["mesh.contact_elements=40"])
system = rf.condense(scene)
whole = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.3], [1.0, -0.3]]
cut = [*whole[:3], [1.0, 0.0123], [1.0, -0.3]]
ends = [
    rf.evolve(system, rf.History(("P", "Q"), np.array(rows), np.zeros((0, 2)))).turning_points
    for rows in (whole, cut)
]
print("change of the shear forces by a cut:", abs(ends[0].Q[-1] - ends[1].Q[-1]).max())
assert np.allclose(ends[0].Q[-1], ends[1].Q[-1], atol=1e-12)

# %% [markdown]
# ## It converged. Is the shear right?
#
# Every accepted answer carries the [residual](../theory.md#residual) of Coulomb's conditions node by node; a small last change is no small error, and
# a residual dominated by the pressure hides the shear ([Kratos #5030](https://github.com/KratosMultiphysics/Kratos/pull/5030),
# [#8078](https://github.com/KratosMultiphysics/Kratos/issues/8078)). Cattaneo and Mindlin's shear, for which the dissipation is known:

# %%
record = rf.run(rf.read_scene("demos/half_planes.toml"))
f, P, U, star = 0.5, 1.0, 0.6, 100.0 / (1.0 - 0.3**2)
known = (f * P) ** 2 / (np.pi * star) * (4 * (1 - U) * np.log(1 - U) + 4 * U - 2 * U**2)
print("residual", record.residual_max, "error of D", record.cycles.dissipation[-1] / known - 1.0)
assert record.residual_max < 1e-11
assert abs(record.cycles.dissipation[-1] / known - 1.0) < 1e-3

# %% [markdown]
# ## Why does the press-out force depend on the type of contact?
#
# Shaft 20/40.005, hub 40/60, length 19 mm, f = 0.1: in [CalculiX #98](https://github.com/Dhondtguido/CalculiX/issues/98) the force differs by more than
# two between types of contact. Lamé's pressure gives f p 2 pi R L = 1371 N; friction that hinders Poisson's strain adds a share in
# proportion to f.

# %%
A, B, C, L, E, f, depth = 10.0, 20.0, 30.0, 19.0, 196000.0, 0.1, 0.0025
p = depth * E / B / ((C**2 + B**2) / (C**2 - B**2) + (B**2 + A**2) / (B**2 - A**2))
known = f * p * 2.0 * np.pi * B * L
scene = rf.Scene(
    body=rf.Body(name="shaft", width=B - A, height=L, position=(0.5 * (A + B), 0.0)),
    others=(rf.Body(name="hub", width=C - B, height=L, position=(0.5 * (B + C), 0.0)),),
    material=rf.Material(E, 0.3, "axisymmetric"),
    mesh=rf.MeshOptions(contact_elements=16),
    contacts=(rf.Contact(edge="shaft.right", against="hub.left", friction=f, interference=depth),),
    loads=(rf.Load("push", "shaft.bottom", displacement=("free", 0.1)),),
    supports=(rf.Support("y", point=(C, 0.5 * L), body="hub"),),
    history=rf.HistoryOptions(kind="monotonic"),
)
force = rf.run(scene).turning_points.load_displacement[-1, 0] / 0.1
print(f"press-out force {force:.0f} N, closed form {known:.0f} N")
assert abs(force / known - 1.0) < 0.1 * f + 1e-3

# %% [markdown]
# ## Where is the frictional energy of a cycle?
#
# `record.cycles.dissipation`, and along the contact `record.cycles.dissipation_density`; the energy balance of every leg is checked.

# %%
print("dissipation", record.cycles.dissipation, "energy error", record.energy_error_max)
assert record.energy_error_max < 1e-9

# %% [markdown]
# ## How much will my joint damp?
#
# [`receding-fenicsx joint`](../joints.md), with an estimate of the discretisation error; below macroslip the dissipation grows as a power of the
# amplitude, 3 for two cylinders.

# %%
scene = rf.read_scene("demos/half_planes.toml", ["mesh.contact_elements=80"])
curve = rf.joint_curve(scene, "Q", np.geomspace(0.05, 0.1, 3))
print("exponent", curve.exponent, "D", curve.dissipation, "+-", curve.estimate)
assert np.all(np.diff(curve.dissipation) > 0.0)

# %% [markdown]
# ## Another start gave another answer. Which is right?
#
# Perhaps both. Every run says whether its path is certified to be the only one; `rf.branches` follows all ([uniqueness](../uniqueness.md)). One node
# with three answers:

# %%
node = rf.ContactSystem(
    x=np.zeros(1),
    points=np.zeros((1, 2)),
    weight=np.ones(1),
    K=np.array([[1.0, 0.9], [0.9, 1.0]]),
    r_star=np.array([[1.3, 1.0]]),
    load_names=("p",),
    f=np.array([1.5]),
    g0=np.zeros(1),
    held=np.zeros(2, dtype=bool),
    rigid=np.zeros((2, 0)),
)
tree = rf.branches(node, rf.History(("p",), np.array([[0.0], [1.0]]), np.zeros((0, 1)), 0))
print(tree)
assert len(tree) == 3 and tree.complete
