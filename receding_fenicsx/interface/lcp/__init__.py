"""Linear complementarity problems of contact.

1. ``contact.solve_states`` eliminates the freedoms whose states are known and pairs slip and gap of
   each undecided node with its margins A, B and its pressure P.
2. ``lemke.solve`` tries Lemke's method with several covering vectors.
3. Where that fails and few nodes are undecided, all sets of states are tried; failure then proves
   that there is no solution.
4. ``all_solutions.all_solutions(system, r0, undecided, open_dofs)`` finds all solutions instead of
   one: ``.states`` (k, N), a row for each, and ``.complete`` where there are no others.
"""
