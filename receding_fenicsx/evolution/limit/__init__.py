r"""Limit of infinitely many cycles, found after a few of them.

The slow tail towards the steady state comes from nodes that drift: they slip once a cycle, in one
direction, less each time, until they only touch their friction limit. All others slip both ways or
open, and forget what was before, or stick for good. The limit, from top to bottom:

1. **When** (`jump.LimitSearch`): after cycle 2, then 4, 8, ... of a history with
   `until = "limit"`. Everything follows from the finished cycles alone, with solvers of its own, so
   that a resumed run repeats it bit by bit and a failed search leaves no trace.
2. **Sort** (`sorting.sort_nodes`): play one cycle; nodes that slip both ways or open stay free, all
   others are frozen, those that slip one way drift.
3. **Freeze** (`frozen.Frozen`): a frozen node is held tangentially. The shift $x_d$ of a drifting
   node is one more load with the reactions $K_d$, so that one set of rates serves for all shifts.
4. **Play** until the cycle repeats itself (`newton.approach`), and read the smallest margins $A_i$
   and $B_i$ of the frozen nodes at its events and corners. The limit is
   $$\min\big(A_i, \max(k_i x_i, -B_i)\big) = 0 ,$$
   that is $x_i > 0$ only where $A_i = 0$, $x_i < 0$ only where $B_i = 0$, and $A_i, B_i \ge 0$.
5. **Newton** on its pieces. In given states the rates $q$ do not depend on the shifts, so that the
   derivative $S$ of all quantities changes at events only, each of which moves by $\delta s$:
   $$q_l\, \delta s = -S_l, \qquad S \leftarrow S + (q^- - q^+)\, \delta s ,$$
   one triangular system for all events (`frozen_cycle.FrozenCycle.events`). A margin that is
   smallest at an event moves with it, by its own rate times $\delta s$ (`newton.margin_rows`). What
   the nodes have still to forget of the cycle's start follows likewise (`Frozen.to_forget`).
6. **Sort again** (`search.find_limit`): frozen nodes that open or violate both margins are freed,
   those that violate one drift. Newton's method goes on from the cycle at hand, with the rates of
   the sets of states that are known (`frozen_segments.FrozenSegments`).
7. **Come there** (`drifts.has_settled`): slip does not go back, so that a limit beyond which some
   node slips while others still drift is none. It is kept while cycles are played, until what all
   nodes lack of it shrinks in one shape: near the limit the map from cycle to cycle is piecewise
   linear and homogeneous, and keeps that shape. Refused is also one in which a free node has come
   to rest: where it rests depends on cycles that were not played.
8. **Check** (`jump.LimitSearch`): one full cycle is played from the state found, no node frozen,
   with the residuals and energies of any other. It is accepted only if it repeats itself as a
   steady cycle does (:class:`~receding_fenicsx.interface.measures.steady.SteadyWatch`). Where
   round-off alone tells whether nodes stick or slip at its end, they stick (`ends`).
9. **Walk** (`walking.find_walk`): where most nodes slipped along one rigid motion in the last
   cycle, a state is searched for first whose cycle repeats itself but for such a motion. Every
   node slips then, and none is frozen.
10. **Uniqueness** (`uniqueness.is_unique`): whether the derivatives of the margins in the drifts
   are a P-matrix. This is about the drifts from one start.
11. **Other starts** (`starts.steady_states`): the limits from many initial slips.

:func:`~receding_fenicsx.evolution.limit.search.find_limit` takes a system, a state at the start of
a cycle and the loop, and returns the limit that belongs to it, whatever the state came from.
"""
