"""Output of a run: figures, pictures of the body, tables and reports.

The rooms read a :class:`~receding_fenicsx.evolution.record.Record`; they compute no mechanics.

1. :mod:`plots`: ``figures.plot_all`` draws all figures of a record.
2. :mod:`snapshots`: ``draw.snapshots`` draws stresses on the deformed body, ``draw.animate``
   a film of a cycle.
3. :mod:`report`: sections (``summary.SECTIONS``), as ``summary.summarise``,
   ``summary.run_table`` and ``html.write_report``.
"""
