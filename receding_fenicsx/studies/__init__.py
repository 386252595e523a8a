"""Studies of a scene in a run's folder.

``tolerance.within_tolerance`` refines the mesh until a tolerance is met; ``starts`` compares the
limits of a history from many initial slips.
"""
