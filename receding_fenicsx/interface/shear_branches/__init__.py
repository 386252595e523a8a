r"""Paths of a contact with a shear limit $t$ or a cohesion $c$, from branch to branch of its law.

In contact the limits of $Q$ are

$$-\min(f_\mathrm{forward} P + c\,m,\ t\,m) \le Q \le \min(f_\mathrm{backward} P + c\,m,\ t\,m)$$

with the weight $m$ of the node; an open node has $Q = 0$.

1. **Cones** (`cones`: `Cones.coulomb`). In one set of branches the margins are

   $$A = Q + c_A P + d_A, \qquad B = c_B P + d_B - Q ,$$

   those of a cone for reactions that have a constant force in addition, one more load of factor 1.
   So every method for Coulomb friction follows it. The shear limit is in use in one direction at
   most: the other one keeps its friction, so that $A$ and $B$ tell both $Q$ and $P$.
2. **Other margins** (`Cones.other_margins`). Those of the branches that are not in use are linear
   between two events. The first that reaches zero ends the piece; its branch is used from there
   (`path`: `BranchedPath`). A slipping node goes on slipping on the other branch or sticks: the
   rates decide in the new branches. Where no rates lead on there, the branches of other nodes are
   changed instead (`path`: `Tried`).
3. **Bonds.** Cohesion acts while a node touches. A node that opens under shear loses a force at
   once: no quasi-static path leads on, the contact jumps. Of a few nodes that touch without a
   force all sets of bonds are tried.
4. **Load steps.** A step is solved in the branches that limit $Q$ at its end; one in which a bond
   forms or breaks is followed exactly.
"""
