# %% [markdown]
# # A joint's damping, with an error
#
# Two bodies are clamped together and sheared to and fro. A small force slips at the edges of the contact only: *microslip*. How much does
# it dissipate per cycle, and how stiff is it, over the amplitude? The joint here is that of two cylinders, whose answer is known.

# %%
import numpy as np

import receding_fenicsx as rf

scene = rf.read_scene("demos/half_planes.toml")
curve = rf.joint_curve(scene, "Q", np.geomspace(0.1, 0.45, 5))
print("amplitude  dissipation   +- estimate  stiffness  Masing's rule")
for row in zip(
    curve.amplitude, curve.dissipation, curve.estimate, curve.stiffness, curve.masing, strict=True
):
    print("{:9.3f}  {:11.4e}  {:12.1e}  {:9.4f}  {:13.4e}".format(*row))

# %% [markdown]
# Each row is the limit of infinitely many cycles, and `estimate` its discretisation error from a mesh of half as many elements. Cattaneo
# and Mindlin: with $U = Q / (f P)$,
#
# $$D = \frac{f^2 P^2}{\pi E^*}\left[4 (1 - U) \ln(1 - U) + 4 U - 2 U^2\right].$$

# %%
f, P, star = 0.5, 1.0, 100.0 / (1.0 - 0.3**2)
U = curve.amplitude / (f * P)
known = (f * P) ** 2 / (np.pi * star) * (4 * (1 - U) * np.log(1 - U) + 4 * U - 2 * U**2)
print("true error over estimate:", abs(curve.dissipation - known) / curve.estimate)
assert np.all(abs(curve.dissipation - known) < 2.0 * curve.estimate)

# %% [markdown]
# Where contact and pressure do not change, Masing's rule predicts the same from the first loading alone. In most joints they do change,
# and the rule errs by a third or more:

# %%
print("Masing's defect", curve.masing_defect.max(), "exponent of the amplitude", curve.exponent)
assert curve.masing_defect.max() < 1e-6
rf.joint_figure(curve).savefig("joint.png")

# %% [markdown]
# Next: [bolts, vibration modes, Iwan's model](../joints.md).
