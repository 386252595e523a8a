r"""Shakedown limits: up to which load range does a closed frictional contact stop slipping?

Loads are $\lambda_m + \lambda\, \lambda_k$: a mean, and the corners $k = 1, \dots, V$ of a range
times $\lambda$. While all nodes touch ($w = -g_0$), eq. (11) gives the reactions to a residual slip
$v$, and the margins of the friction law are affine in $v$ and $\lambda$:

$$A_{ik} = [(K_{tt} + f K_{nt}) v + Q_m + f P_m + \lambda (Q_k + f P_k)]_i \ge 0, \qquad
  B_{ik} = [(f K_{nt} - K_{tt}) v + f P_m - Q_m + \lambda (f P_k - Q_k)]_i \ge 0 .$$

A slip that satisfies all of them is *safe* at $\lambda$: a contact that has it never slips.

1. :func:`~receding_fenicsx.interface.shakedown.margins.load_range` reads mean and range;
   :func:`~receding_fenicsx.interface.shakedown.margins.margins_of` builds the rows. Tangential
   displacements of nodes without friction ($Q = 0$) and both displacements of separated nodes
   ($Q = P = 0$) are eliminated; held nodes have no margins; friction may differ between the two
   directions. As $v$ is the same at all corners, only the corner with the smallest change can bind
   in a row, so that $2 N$ rows are left of $2 N V$.
   :func:`~receding_fenicsx.interface.shakedown.margins.prepared` refuses mean loads that no
   residual slip can hold.
2. :func:`~receding_fenicsx.interface.shakedown.limits.upper_limit`: $\lambda_2 = \max \lambda$ over
   $(v, \lambda)$, one linear program. Above it no start shakes down with the contact closed. Its
   $v$ is the safe slip, which holds for all smaller $\lambda$ too, as the range holds the mean.
3. :func:`~receding_fenicsx.interface.shakedown.limits.lower_limit`: $\lambda_1 = \min \lambda$ over
   nodes $i$ and corners $(k, l)$ with $A_{ik} = B_{il} = 0$ and all other margins not negative.
   Below it every start shakes down: proved for two nodes (Ahn, Bertocchi & Barber 2008) and, with
   $K_{tn} = 0$, for any number, where $\lambda_1 = \lambda_2$ (Klarbring, Ciavarella & Barber
   2007); else a conjecture. By the remark in 1. a node has one pair $(k, l)$ only, not $V^2$.
4. :func:`~receding_fenicsx.interface.shakedown.margins.minimise` solves each program by HiGHS,
   polishes the answer on the rows that bind, and accepts it if the margins hold to 1e-9 and the
   multipliers prove the value to 1e-8.
   :func:`~receding_fenicsx.interface.shakedown.margins.margin_residual` evaluates the
   margins of the safe slip once more, from $K$.
"""
