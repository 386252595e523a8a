r"""Loads of joints: body forces, thermal strains, interference.

A body force $b$ has the nodal forces $f_i = \int N_i\, b \, dV$. A thermal strain
$\varepsilon^\theta = \alpha\, \Delta T\, 1$ in $\sigma = C (\varepsilon - \lambda\,
\varepsilon^\theta)$ has those of the stress that would hold it,
$f_i = \int C \varepsilon^\theta : \varepsilon(N_i) \, dV$ (`domain_forces`). Both are forces to
the condensation: they alter $r^*$ alone, and their work-conjugates are $f \cdot u$: for the thermal
strain $\int E / (1 - 2 \nu)\, \alpha \Delta T\, \mathrm{tr}\, \varepsilon \, dV$ (plane stress
$E / (1 - \nu)$). Where stresses are evaluated, the load's factor times $\varepsilon^\theta$ is
subtracted from the strain (`thermal`); on elements of order 1, whose strain is that of the cell's
midpoint, at the midpoint.

Springs add their part to $A$ and hold the rigid motions that they resist (`springs`); those between
bodies close the factors of unit loads, after the bodies are joined (`links`). An
interference alters $r^*$ by $K s$, after the bodies are joined (`interference`); bolts
close a load's force by their law, a change of $K$ and $r^*$ by rank one each (`bolts`).
"""
