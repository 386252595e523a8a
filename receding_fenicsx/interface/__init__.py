r"""Frictional contact of a condensed body; NumPy and SciPy only, no finite elements, no MPI.

Numbers of equations are those of Ahn & Barber (2008). With the tangential and normal displacements
$v_i, w_i$ of the $N$ contact nodes, the reactions $Q_i, P_i$ on the body, the gap $g_i = g_{0,i} +
w_i$ (the paper's is $w_i$, on a plane that fits the body) and the coefficients of friction
$f_i$ (equal for both directions here; ``law`` has both),

$$r = \sum_k \lambda_k r^*_k + K u, \qquad (11)$$

$$r = \begin{Bmatrix} Q \cr P \end{Bmatrix}, \quad
  u = \begin{Bmatrix} v \cr w \end{Bmatrix}, \quad
  K = \begin{bmatrix} K_{tt} & K_{tn} \cr K_{nt} & K_{nn} \end{bmatrix}, \quad
  K_{tn} = K_{nt}^T \qquad (12, 13)$$

where $\lambda_k$ are the load factors and $r^*_k$ the reactions to load $k$ with all contact nodes
held. Each node is in one of four states:

| state | holds | on condition of | numbers |
| --- | --- | --- | --- |
| 1 stick | $g = 0,\ \dot v = 0$ | $P > 0,\ -fP \le Q \le fP$ | (4), (5) |
| 2 separation | $P = Q = 0$ | $g \ge 0$ | (6), (7) |
| 3 forward slip | $g = 0,\ Q = -fP$ | $P > 0,\ \dot v > 0$ | (8), (9) |
| 4 backward slip | $g = 0,\ Q = +fP$ | $P > 0,\ \dot v < 0$ | (10) |

**Load steps** (`gauss_seidel`, sections 2.1 and 2.2 of the paper): over a step $\dot v_i$ becomes
$v_i(t_{j+1}) - v_i(t_j)$ (14, 15), nodes are solved one by one, and the sweeps stop when the
largest relative change of a displacement $\mathcal{E} < \mathcal{E}_0$ (16) and the residual
below is small.

**Exact path** (`exact`): between two changes of state all is linear along a leg
of the load path, so there is no step. With the load $\lambda(s)$ the rates solve (11),

$$\dot r = \sum_k \dot\lambda_k r^*_k + K \dot u,$$

with (4), (6), (9) and (10) for nodes inside their conditions; nodes that stand on a limit satisfy
a linear complementarity problem. The path goes to the nearest $s$ at which a condition would be
violated. Both factors of the dissipation of a piece are linear, so

$$D = -\sum_i \int Q_i \, \dot v_i \, ds
    = -\sum_i \tfrac12 (Q_i^{a} + Q_i^{b}) (v_i^{b} - v_i^{a})$$

over slipping nodes is exact, and each leg must satisfy the energy identity

$$D + \Delta\, \tfrac12 u^T K u + \int \sum_k \lambda_k\, r_k^{*T} \dot u \, ds = 0 .$$

**Residual** of every accepted answer, with the local stiffness $k_i = K_{ii}$ and the slip $\Delta
v_i$ of the step or piece, over the largest nodal force so far:

$$\max_i \left\lbrace \left| P_i - \max(0,\, P_i - k_i g_i) \right|,\
  \left| Q_i - \mathrm{clip}(Q_i - k_i \Delta v_i,\, -f_i P_i^+,\, f_i P_i^+) \right|
  \right\rbrace .$$

**Steady state** (`measures.steady`): $A_n = \max |r_n - r_{n-T}| / \max |r|$ over a period
of $T = 1$ or 2 cycles below a tolerance for two periods running.
"""
