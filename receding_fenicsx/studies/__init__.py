"""Studies of a scene, each in a folder of its own.

``run.run`` takes a scene from its mesh to its record, files and pictures; :mod:`accuracy` estimates
the errors of its numbers and chooses the mesh, ``starts`` compares limits from many initial slips.
``runner.run_study`` runs the cases of a study on one process or many: ``sweep`` over values of
keys, :mod:`joint` over the amplitude of a load, :mod:`shakedown` for the range up to which slip
ceases; :mod:`wear` grows the gap over many cycles.
"""
