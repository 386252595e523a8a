r"""Uniqueness of a path: one solution of every rate problem, or several.

1. **Instants** (`instants.instants`). The rates are decided anew at the start of a leg and
   wherever states change. All nodes on a limit there are undecided together, whether the path
   changes their states or not: at the start they are read from the state, at events the path notes
   them (`exact.segments.tied`). A slipping node, one that begins to slip, or a stuck one at its
   friction limit may slip or stick; one without gap and pressure may do anything. Only instants
   that were not met before are looked at.
2. **Certificate of a set of states** (`certificate.Certificate`). Separated nodes, and tangential
   freedoms without friction, are condensed out of K. On the slipping nodes, with $Q = -c P$, $c =
   f_\mathrm{forward}$ in forward and $-f_\mathrm{backward}$ in backward slip, $S = \mathrm{sign}\,
   c$ and $C = \mathrm{diag}(c)$, slip rates $z = S \dot v$ and rates $y$ of the active margin
   satisfy
   $$y = q + M z,\quad y \ge 0,\ z \ge 0,\ y \cdot z = 0, \qquad M = S (K_{tt} + C K_{nt}) S .$$
   If the symmetric part of M is positive definite there is one solution for every q, hence for
   every load rate.
3. **Touching nodes** (`Sides.explicit`). A node with neither gap nor pressure is given each side:
   open, forward, backward (a node without friction: closed, open). If all these sets of states are
   definite there is one solution: with friction reduced to t f, $0 \le t \le 1$, every piece of the
   piecewise linear law keeps a positive determinant, so that the number of solutions is that
   without friction, one.
4. **Few factorisations** (`certificate.certify`). Sets of states of a leg are certified together,
   by one matrix that contains them all: nodes that slip in given directions, and nodes that open;
   nodes that touch may slip the other way too. A group that fails is halved. A set in a pattern
   that was certified before needs no more work.
5. **Margin** (`Certificate.margin`). All friction may grow by
   $$\varphi = 1 / \lambda_\mathrm{max}(-\mathrm{sym}(C K_{nt}), K_{tt}),$$
   the smallest over the sets of states. Sets whose margin is larger than ``LARGE_MARGIN`` are
   measured at the ends of legs only, where slip zones are largest.
6. **Doubt** (`UniquenessWatch._doubt`). Where a set is not definite: all solutions for the load
   rate, by `interface.lcp.all_solutions`. The instant is certified if it has exactly one. Where a
   free body carries no contact force under some load, nothing determines its place: not certified.
7. **Static problems** (`watch.solutions_from_rest`). From rest without gaps, and after an initial
   slip, all nodes are on all limits. All sets of states of few nodes are tried; for more nodes
   other solutions are looked for, and not excluded.

What is certified holds for a half model among mirror-symmetric paths, and with load steps for the
states at their ends.
"""
