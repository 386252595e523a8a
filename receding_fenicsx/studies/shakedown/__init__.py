r"""Shakedown of a scene: limits of a load range, their diagram, and steady states of many starts.

1. :func:`~receding_fenicsx.studies.shakedown.study.shakedown` condenses the scene and finds both
   limits of its table [shakedown] (:mod:`receding_fenicsx.interface.shakedown`). The programs of
   the nodes are shared among the ranks.
2. The contact edge of a finite body has ends. There the continuum slips at any range, while the
   nodes of a mesh do not: the limits are found on a second, coarser mesh too.
3. :func:`~receding_fenicsx.studies.shakedown.study.limits_at` finds the limits over one of the
   mean loads (a diagram of Bree's kind). The multipliers of one mean load prove bounds for all
   others.
4. Where a node unloads at the upper limit, the contact may open and close instead of slipping, and
   linear programs no longer decide.
   :mod:`~receding_fenicsx.studies.shakedown.exact_cycles` then plays exact cycles from rest and
   from the safe slip, and bisects; it finds a motion round a larger range by a mixed-integer
   program (:mod:`receding_fenicsx.interface.shakedown.opening`), and plays exact
   cycles from its slip to verify it.
5. :func:`~receding_fenicsx.studies.starts.steady_states` plays one history from many
   initial slips and collects dissipation, kind and slipping nodes of each steady state.
6. The study writes ``shakedown.json``, ``safe_slip.csv`` (a profile for ``history.initial_slip``)
   and the diagram.
"""
