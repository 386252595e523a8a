"""Tolerances that several modules share, each relative to a scale of its own."""

ON_LIMIT = 1e-12
"""Distance from a limit, over the largest nodal force so far, up to which a node is on it."""

STEP_ON_LIMIT = 1e-10
"""The same at the ends of load steps, whose forces are less exact."""

ACCEPTED_RESIDUAL = 1e-11
"""Residual of the contact law, evaluated afresh, over the largest nodal force, that is accepted."""

ROUND_OFFS = 32.0
"""Round-offs of a force that an accepted residual may consist of where nothing better can be had:
nearly incompressible bodies."""

RATE_TOLERANCE = 1e-11
"""Rate over the Euclidean norm of all rates (as forces) below which it counts as zero."""

SAME_RATES = 1e-7
"""Difference of rates, over the largest, below which two sets of states are one solution."""

SAME_MARGIN = 1e-9
"""Relative difference of margins of uniqueness that is not resolved."""

SIMULTANEOUS = 1e-9
"""Part of a leg within which events, or choices between continuations, count as simultaneous: all
nodes on limits are looked at."""

END_TOLERANCE = 1e-13
"""Part of a leg before its end in which events are left to the next leg: round-off decides there
whether a closed cycle returns to where it reversed or just past it."""

JUMP_STEP = 1e-7
"""Part of a leg beyond a jump at which the state after it is solved for: at the jump itself the
state before is still an equilibrium."""

REMAINING_LOAD = 1e-9
"""Load, as a part of the leg's first load, at which a leg to complete unloading stops."""

UNLOADING_ROUND_OFF = 1e-9
"""Part of a leg before its end at no load within which changes of state are round-off."""

SLIP_ROUND_OFF = 1e-12
"""Slip over the elastic displacement F / K_ii of a node under the largest nodal force F below which
it is round-off: the node does not slip."""

NO_STIFFNESS = 1e-11
"""Part of the largest local stiffness up to which one is round-off of none."""

RIGID_TOLERANCE = 1e-8
"""Distance from a unit rigid motion within which a motion of the contact is rigid."""

RESULTANT = 1e-13
"""Resultant along a rigid motion, over the sum of all held reactions, that is none."""

TOO_FAR = 1e10
"""Displacement along a rigid motion, as a force over the largest nodal force, beyond which the
round-off of a stiffness that vanishes carries the loads, and nothing else does."""

TOO_FAR_ON_SPRINGS = 1e12
"""The same for any displacement: that of soft springs, whose stiffness is more than round-off."""

STEADY_TOLERANCE, LIMIT_CYCLE_TOLERANCE = 1e-8, 1e-10
"""Change of the forces over a cycle, over the largest, below which the cycle is steady; the same of
the limit of infinitely many cycles. Defaults of ``[solver] steady_tolerance``."""
