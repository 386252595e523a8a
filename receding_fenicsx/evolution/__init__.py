"""Evolution of a condensed contact along a load history, into a record.

1. **Prepare**: :func:`~receding_fenicsx.evolution.problem.system_for` gives the system the friction
   and the gap of a scene; :func:`~receding_fenicsx.evolution.problem.problem_of_scene` or
   :func:`~receding_fenicsx.evolution.problem.problem_of_history` checks it with its history.
   :mod:`receding_fenicsx.evolution.histories` finds the corners of a harmonic history, and the
   shortenings of bolts.
2. **Start** from :func:`~receding_fenicsx.evolution.instants.rest_state`, or from the last cycle of
   a :class:`~receding_fenicsx.evolution.journal.JournalFolder`, with the solver that
   :func:`~receding_fenicsx.evolution.solvers.make_solver` makes.
3. **Trace cycle after cycle** in :func:`~receding_fenicsx.evolution.evolve.continue_history`:
   :meth:`~receding_fenicsx.evolution.run_state.RunState.trace_cycle` follows each leg by the solver
   and checks its energy identity (:func:`~receding_fenicsx.evolution.run_state.energy_error`). The
   finished cycle goes to the journal and to the watch for the steady state
   (:func:`~receding_fenicsx.evolution.instants.steady_watch`). At checkpoints the solver is
   replaced by a new one, so that a resumed run repeats an undisturbed one bit by bit.
4. **Record**: :func:`~receding_fenicsx.evolution.collect.record_of` mirrors the modelled nodes to
   the whole contact and returns the :class:`~receding_fenicsx.evolution.record.Record`.
5. **Read**: :meth:`~receding_fenicsx.evolution.record.Record.at` selects a stored instant;
   :func:`~receding_fenicsx.evolution.replay.instant_of` replays any other.
"""
