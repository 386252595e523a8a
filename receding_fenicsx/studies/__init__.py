"""Studies of a scene, each in a folder of its own.

1. ``run.run`` takes a scene from its mesh to its record, files and pictures; :mod:`accuracy`
   estimates the errors of its numbers and refines the mesh until a tolerance is met, ``starts``
   compares the limits of a history from many initial slips.
2. ``runner.run_study`` runs the ``cases`` of a study on one process or many, and continues an
   interrupted one. ``sweep`` runs a scene for many values of its keys, :mod:`joint` over the
   amplitude of a load.
3. :mod:`shakedown` finds the load range up to which slip ceases.
"""
