"""Quantities read from a record: half widths, stresses at corners, nodes at the friction limit.

Those of a single contact state are in :mod:`receding_fenicsx.interface.measures`.
"""
