r"""Elastic half-planes without a mesh: stiffness of the surface nodes and fields inside.

Under tractions $q$, $p$ on its surface, a half-plane moves there by Flamant's solution, in the
directions $t$ along the surface and $n$ into the body,

$$v = -\int \left[ c_1 q \ln\frac{|x - s|}{d} + c_2\, p\, \mathrm{sgn}(x - s) \right] ds
      + \frac{Q}{2 \pi \mu} + a_t, \qquad
  w = -\int \left[ c_1 p \ln\frac{|x - s|}{d} - c_2\, q\, \mathrm{sgn}(x - s) \right] ds
      - \frac{P}{2 \pi \mu} + a_n + a_r x,$$

with $c_1 = (\kappa + 1) / (4 \pi \mu)$, $c_2 = (\kappa - 1) / (8 \mu)$, and $\kappa = 3 - 4 \nu$
in plane strain, $(3 - \nu) / (1 + \nu)$ in plane stress. The datum is the point at the depth $d$
below the middle of the contact: $a_t$, $a_n$ are its displacements under the resultants $Q$, $P$
in the middle, $a_r$ is the rotation of the far field. The constants are those of Johnson, Contact
Mechanics (1985), sections 2.2 to 2.4 and eq. (5.57).

1. `stiffness.surface_integrals` integrates $\ln|x - s|$ and $\mathrm{sgn}(x - s)$ over pairs of the
   hat functions $\varphi_i$ of the nodes: $\Lambda_{ij} = \iint \varphi_i \varphi_j \ln|x - s|$
   in closed form, or by Gauss's rule where elements are far apart.
2. `stiffness.compliance` makes $D$, symmetric and positive definite, of these and the material.
   Two half-planes have $D = D_a + D_b$, in which the coupling by $c_2$ has opposite signs: it
   vanishes exactly for equal materials (Dundurs' $\beta = 0$).
3. `stiffness.SurfaceStiffness` holds $A = B^T D^{-1} B$: tractions $\tau$ with
   $D \tau + B R a = B u$ carry the nodal forces $r = B^T \tau$. With $B_{ij} = \int \varphi_i N_j$
   (the work of $\tau$ on the displacement interpolated by shape functions $N_j$) this is a
   Galerkin method: symmetric on any nodes, which collocation is not. The error of its compliance of
   a wave of number $k$ is $+ (k h)^2 / 6$; that with the weights $B = \mathrm{diag}(m_i)$ is
   $- (k h)^2 / 6$, that of collocation $- (k h)^2 / 12$. On elements of order 1,
   $B_{ij} = \int (\varphi_i \varphi_j + \tfrac{1}{12} h^2 \varphi_i' \varphi_j') dx$ with the
   shortest length $h$ makes it one of order $(k h)^4$ where elements have this length.
4. `stiffness.condense_far_field` eliminates the free motions $a$ of the far field, where
   $R^T r$ balances the force $F$ far away:
   $K = A - A R (R^T A R)^{-1} R^T A$ and $r^* = -A R (R^T A R)^{-1} F$.
   $K$ is symmetric and $K R = 0$ to round-off; both do not depend on $d$ then.
5. `interior.point_values` evaluates stresses and displacements inside by closed integrals of
   piecewise linear tractions $p_i = P_i / m_i$, $q_i = Q_i / m_i$.

This room knows neither scenes nor finite elements; `bulk.half_planes` connects it to them.
"""
