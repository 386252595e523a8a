"""Gauss-Seidel iteration for one load step (section 2.2 of Ahn & Barber 2008).

1. ``sweeps.solve_step`` starts from the last state or a guess and evaluates the reactions (eq. 11).
2. A sweep visits every node. ``sweeps.NodeProblem.solve`` solves the node in its last state
   and changes the state until the node's inequalities hold; an open node that touches slips from
   ``NodeProblem.touch_down``. The reactions follow by columns of K.
3. Two accelerations leave the answer alone: slipping and open nodes are over-relaxed, and once no
   state changes, ``sweeps.solve_directly`` solves for all nodes at once in these states (polish).
4. The step is accepted when the last change (eq. 16) and the fresh residual are below their
   tolerances, or given up where the residual no longer falls.

``compliance_form`` writes the same step as the local frictional contact problem of other solvers.
"""
