r"""Shakedown of a scene: limits of a load range, their diagram, and exact cycles.

``study.shakedown`` finds both limits of the table [shakedown] (:mod:`interface.shakedown`) on the
scene's mesh and on a coarser one, as at free ends of a contact edge the continuum slips at any
range, and over one of the mean loads (a diagram of Bree's kind). Where a node unloads at the upper
limit, linear programs no longer decide: ``exact_cycles`` plays cycles from rest and from the safe
slip, and bisects; a mixed-integer program finds a larger range with opening nodes, which exact
cycles verify.
"""
