"""Errors of a run's numbers by meshes of a family, and the mesh that meets a tolerance.

A family (``meshes``) holds the meshes of a scene whose sizes are all enlarged or reduced alike.

1. ``numbers.headline`` reads the numbers off a record: pressures, ends of zones, displacements of
   loads, values of probes, dissipations.
2. ``estimate.estimates_of`` estimates their errors from several meshes: the observed order, and the
   largest difference between two meshes that this order extrapolates. It says where a number does
   not converge in order.
3. ``study.errors_of_run`` (``run --error``) solves on three coarser meshes.
4. ``study.search`` (``run --tolerance``) begins with a coarse mesh. Where a sharp corner is in
   contact it begins anew with meshes graded towards corners (``meshes.graded_at_ends``). After each
   mesh ``study.next_elements`` chooses the next one by the errors and orders found so far; it ends
   when twice the estimate of each asked number is within the tolerance, when a number does not
   converge, or when the next mesh would exceed the budget or the memory.
5. In both ``study.Meshes`` keeps the finished meshes as cases in the run's folder.
6. ``meshes.refined_at_zone_ends`` places smaller elements where zones of a coarse run end.
"""
