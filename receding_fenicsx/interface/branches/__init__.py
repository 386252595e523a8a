"""Several continuations of a contact, and the friction at which they may begin.

**Choices** (``choice.Chooser``), on the exact path, at every event and turning point:

1. The path finds consistent states as always (``exact.consistency``): the *first* continuation.
2. If the sets of states of the nodes on limits are definite (``uniqueness``), the rates are
   proved to be unique, and nothing is searched.
3. ``lcp.all_solutions`` finds all solutions of the rate problem of the nodes on limits. From rest,
   where all grows in proportion, it finds all solutions of the static problem.
4. Each is a continuation if its rates violate no limit. Where there are several, a rule takes one:
   the first, the one of least or most dissipation -Q dv (where Q = 0, of -dQ dv / 2), or the n-th.
   The choice is noted: ``choice.Choice``.

The rate problem is that of the instant: a path that could be left in a segment, between two
events, could be left at every instant of it. Such branches are followed from the segment's start.

**Critical friction** (``critical_friction``): the smallest common factor of all coefficients at
which a slip mode appears on a given contact, bounded from both sides.
"""
