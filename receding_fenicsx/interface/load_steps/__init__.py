r"""Evolution along a leg in load steps by Gauss-Seidel, section 2 of the paper.

A step satisfies the contact law at its end only. Where the quasi-static path ends inside a step,
the end of the step is another equilibrium, at a finite distance however small the step is. No step
may pass over such a jump, so that each one is compared with the exact path. The method of
`path.GaussSeidelPath`, from top to bottom:

1. **Leg** (`GaussSeidelPath.trace_leg`). The leg is divided into equal load steps, and cut
   at complete unloading: a step across it would keep slip that unloading undoes. A body with gaps
   that carries nothing first rolls to where it rests (`exact.free_motions.at_rest`).
2. **Equilibrium** (`GaussSeidelPath.advance`). A step beyond the load at which
   no reactions balance the loads (`interface.equilibrium.furthest`) is an error.
3. **Sweeps** (`GaussSeidelPath.attempt`, `gauss_seidel.sweeps.solve_step`). With the load at
   the end of the step, $r = \sum_k \lambda_k r^*_k + K u$, node after node is solved with the slip
   of the step in place of the slip rate (eqs. 14, 15), until the displacements settle (eq. 16) and
   the residual of the contact law is small.
4. **Straight path** (`GaussSeidelPath._is_straight`). If load, $u$ and $r$ change in
   proportion over the step and both of its ends satisfy the law in the end's states, the straight
   line is a quasi-static path: the step is accepted. Every step without change of state passes.
5. **Exact path** (`GaussSeidelPath._walk`). Otherwise the path through the step is followed from
   event to event (`interface.exact`).
   * It leads through, and the step ends near it, $|u_\mathrm{step} - u_\mathrm{exact}| \le \tfrac12
     |u_\mathrm{exact} - u_\mathrm{start}|$: accepted, the difference is the error of the step in
     time. If not, sweeps start again from the exact end; after that the step is halved. Where
     sweeps stall, and at a complete unloading, the exact path is taken.
   * It ends inside: it is taken up to there, and a step of $10^{-9}$ of the leg decides. If the
     displacements change by a finite amount, the body jumps.
6. **Jump** (`GaussSeidelPath.advance`). Before a jump counts, the exact path is followed
   from the start of the leg: where that continues, the jump was an error of the steps in time, and
   it is taken instead. A jump is an error, or (`on_jump = "static"`) a static problem just beyond,
   whose released energy is recorded apart.
7. **Sums** (`system`: `Leg.add`). The dissipation of a step is
   $$D = -\sum_i \tfrac12 (Q_i^\mathrm{old} + Q_i^\mathrm{new}) (v_i^\mathrm{new} -
     v_i^\mathrm{start}),$$
   where $v^\mathrm{start}$ is the point of first contact, and $Q^\mathrm{old} = 0$, for a node that
   touches down; the work of the loads takes the mean load of the step. Events are the changes of
   state seen at the ends of steps, or at their places where the exact path was taken.
"""
