"""Errors of a run's numbers by meshes of a family, and the mesh that meets a tolerance.

``estimate.headline`` reads the numbers off a record, and ``estimate.estimates_of`` estimates their
errors from several meshes of one family (``meshes``), whose sizes are all enlarged or reduced
alike. ``run --error`` solves on three coarser meshes (``study.errors_of_run``). ``run --tolerance``
begins with a coarse mesh (``study.search``), anew with graded ones where a sharp corner is in
contact, and chooses each next mesh by the errors and orders found so far.
``meshes.refined_at_zone_ends`` places smaller elements where zones of a coarse run end.
"""
