r"""Limit of infinitely many cycles, found after a part of them.

The slow tail towards the steady state comes from nodes that drift: they slip once a cycle, in one
direction, less each time, until they only touch their friction limit. While the events of a cycle
keep their order all that comes is an affine map of the last cycle, and its limit is known. From top
to bottom:

1. **When** (`search.LimitSearch`): after cycle 2, then 3, 4, 6, 8, 12, ... of a history with
   `until = "limit"`. Everything follows from the finished cycles alone, with solvers of its own, so
   that a resumed run repeats it bit by bit and a failed search leaves no trace.
2. **Trace** the last cycle once more (`tail.trace`): its events, and the rates between them. In
   given states the rates $q$ do not depend on the displacements, so that a change $S$ of the
   quantities $y = [v, g, A, B]$ changes at events only, each of which moves by $\delta s$:
   $$q_l\, \delta s = -S_l, \qquad S \leftarrow S + (q^- - q^+)\, \delta s ,$$
   one triangular system for all events of the cycle (`tail.TracedCycle.events`).
3. **Follow** all cycles to come by this map to their limit (`tail.follow`), and check that each of
   them has the same events: in the same order, with no gap and no margin below zero. A rigid walk
   that each cycle adds (ratchetting) changes no quantity, and needs nothing of its own.
4. **Play** one cycle of each other order in which nodes are released on the way (`search._tail`).
5. **Check**: one full cycle is played from the limit, with the residuals and energies of any other.
   It is accepted only if it repeats itself as a steady cycle does
   (:class:`~receding_fenicsx.interface.measures.steady.SteadyWatch`). Nodes that drifted, and slip
   nowhere in the limit, stick there.
"""
