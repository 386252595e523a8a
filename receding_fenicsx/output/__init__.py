"""Output of a run: files, figures, pictures of the body, tables and reports.

The rooms read a :class:`~receding_fenicsx.evolution.record.Record`; they compute no mechanics.

1. :mod:`storage`: ``hdf5.write_record``, ``hdf5.read_record`` and their like for systems,
   ``run_folder.run_folder``, ``summary_file.write_summary``, ``fclib.export``.
2. :mod:`plots`: ``figures.plot_all`` draws all figures of a record.
3. :mod:`snapshots`: ``draw.snapshots`` draws stresses on the deformed body, ``animation.animate``
   a film of a cycle.
4. :mod:`report`: ``summary.summarise``, ``text.run_table``, ``html.write_report``.
"""
