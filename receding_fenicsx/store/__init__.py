"""Files of a run: HDF5 records and systems, run folders, ``summary.json``, export to FCLIB.

1. ``workspace`` has what folders of runs, sweeps, curves, studies and exports share;
   ``run_folder.run_folder`` creates ``DIR.part`` and renames it to ``DIR`` at the end.
2. ``hdf5.write_system`` and ``hdf5.write_record`` write the condensed system and the record;
   ``hdf5.read_system`` and ``hdf5.read_record`` read them.
3. ``run_folder.write_summary`` and ``run_folder.read_summary`` are those of ``summary.json``.
4. ``fclib.export`` writes one load step for other solvers.
"""
