"""Parameter sweeps: a scene over a grid of values, a row of a table for each case.

``cases.py`` makes the scenes of the grid, ``values.py`` reads the values of the command line,
``worker.py`` plays one case, ``measure.py`` takes its numbers, ``processes.py`` shares the cases
among processes or ranks, ``folder.py`` keeps the finished ones, ``table.py`` is the result and
``sweep.py`` the whole.
"""
