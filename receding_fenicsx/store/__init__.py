"""Files of a run: HDF5 records and systems, run folders, ``summary.json``, export to FCLIB.

``workspace`` has what folders of runs, sweeps, curves, studies and exports share;
``run_folder.run_folder`` creates ``DIR.part`` and renames it to ``DIR`` at the end.
"""
