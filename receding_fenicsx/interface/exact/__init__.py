r"""Exact evolution along a straight leg of the load path, from one change of state to the next.

With the load factors $\lambda(s) = (1 - s)\, a + s\, b$, $0 \le s \le 1$, eq. (11) reads $r =
\sum_k \lambda_k r^*_k + K u$. In given states of all nodes it is linear in the load, so that there
are no load steps. The method, from top to bottom:

1. **What kind of leg** (`path`: `EventPath.trace_leg`). A leg from rest is solved as in 9, one
   through complete unloading is cut there, as in 10. A body with gaps that carries nothing first
   rolls to where it rests under the load (`free_motions.at_rest`). All others are followed from
   event to event (`walk.Walk`) by one compiled loop (`kernel.follow`), which works on the arrays of
   a tableau and a memory (`loop.Loop`), and asks where it cannot go on by itself: for rates that
   are not those of the tableau, for states where changing them one by one does not end, for a
   choice where a path branches, for round-off to be removed.
2. **Quantities** (`segments`: `Segments.values`). Each node has $v$, the gap $g = g_0 + w$ and the
   margins to both friction limits,
   $$A = Q + f_\mathrm{forward} P, \qquad B = f_\mathrm{backward} P - Q ,$$
   collected in the vector $y = [v, g, A, B]$. Where a node has no friction, $P$ replaces $A$.
3. **Rates** (`Segments.at`). In every state two quantities of a node have zero rate; solving
   $\dot r = \sum_k \dot\lambda_k r^*_k + K \dot u$ gives the other two:

   | state | zero rates | conditions |
   | --- | --- | --- |
   | stick | $\dot v, \dot w$ | $A \ge 0,\ B \ge 0$ |
   | forward slip | $\dot A, \dot w$ | $\dot v \ge 0,\ B \ge 0$ |
   | backward slip | $\dot B, \dot w$ | $\dot v \le 0,\ A \ge 0$ |
   | separation | $\dot A, \dot B$ | $g \ge 0$ |

   `tableau.Tableau` holds the map from inputs (zero rates) and loads to outputs. A change of state
   exchanges an input with an output, a rank-one update of `pivot_matrix.Matrix`: with the
   column $C$, the row $R$ and the pivot $D$ where they meet,
   $$T \leftarrow T - (C + e_i)(R - e_j) / D .$$
   Columns of nodes that stick throughout are left out, and added when one is to be exchanged.
   `balance.BalanceCheck` measures whether the rates satisfy the equation above; if not, they are
   refined. Rates of known states are stored (`kernel_data.Memory`), and turn round with the loads.
4. **Consistent states** (`kernel.turned`, `consistency`: `ConsistentStates.decide`). At the start
   of a leg and after an event, nodes on a limit may go either way. Nodes whose rates violate a
   condition change state, all at first, then the worst one; if a set of states returns, the linear
   complementarity problem of the rates decides (`interface.lcp`).
5. **Next event** (`kernel.looked`). A quantity $y_j \ge 0$ that falls reaches zero
   after
   $$\Delta s_j = -y_j / \dot y_j .$$
   The smallest one is the event: $y \leftarrow y + \dot y\, \Delta s$, the node changes state
   (`kernel.put`), and 4 is checked. The leg ends at $s = 1$.
   In states that have been left by an event before, that one is tried first: all other quantities
   must stay positive up to it.
6. **Integrals** (`kernel.advanced`). Between two events $a$ and $b$ forces
   and displacements are linear, so that the dissipation and the work of the loads are exactly
   $$D = -\sum_i \tfrac12 (Q_i^a + Q_i^b)(v_i^b - v_i^a), \qquad
     W = \sum_k \tfrac12 (\lambda_k^a + \lambda_k^b)\, r^*_k \cdot (u^b - u^a) .$$
   The balance of forces is followed from event to event.
7. **Round-off** (`Walk._balanced`, `Walk._refined`). Where the imbalance of $y$ has
   grown it is removed by iterative refinement, at an event in the states on the way there (a node
   keeps the forces with which it lands), and at the end of a leg where forces that vanish are
   more than round-off: by the tableau, or by a factor of the states there (`loop.ActiveSets`). The
   reactions of the end are evaluated afresh and its residual is checked.
8. **No continuation** (`jumps`). Where no states are consistent, `jumps.explain`
   says whether the body lifts off, slides or jumps. A jump is an error, or (`on_jump = "static"`) a
   static problem at a load just beyond, which releases the energy
   $$E = -\Delta (\tfrac12 u^T K u) - \sum_k \lambda_k\, r^*_k \cdot \Delta u .$$
   How far equilibrium exists at all is a linear program (`interface.equilibrium`), solved where
   rates alone do not decide or the contact forces of the end do not prove equilibrium.
9. **First loading** (`rest.load_from_rest`). From rest without gaps all grows in
    proportion to the load: one static problem, with the slip counted from the start
    (`static.solve_static`: Newton's method on sets of states, Gauss-Seidel, linear
    complementarity, Newton's method from several starts), dissipation $-\tfrac12 Q \cdot \Delta v$.
10. **Complete unloading** (`rest`). Where all loads vanish on a free body without gaps, $P = Q
    = 0$ and $K u = 0$: all nodes reach all limits together. The leg stops at a remaining load of
    $10^{-9}$, its end is set to the rigid sliding reached, and the next leg is a first loading.

Names used throughout: `load` and `direction` (n_loads,) are load factors and their change along a
leg, `state` and `before` (N,) states now and on the way to the present place, `y` and `q` (4N,)
quantities and their rates, `r` (2N,) reactions, `start` and `end` states of the contact, slip being
counted from the start, `force_scale` the largest nodal force of the history so far; `segments`
belongs to one condensed body, `system` is in the 2N form.
"""
