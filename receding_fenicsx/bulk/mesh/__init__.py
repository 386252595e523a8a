"""Meshes of the bodies with named edges: rectangles meshed by gmsh, or files of the user.

The steps of `meshing.make_meshes`, all but the last on rank 0; `meshing.raw_meshes` takes the first
two:

1. A rectangle: `rectangle.make_frame` chooses coordinates along the contact edge and into the
   depth, `find_marks` the positions where loads, contact and supports need vertices. gmsh
   (`user_mesh.gmsh_model`) meshes the half of `meshes/rectangle.geo`; `rectangle.snap` moves its
   nodes to their exact places, `mirror` adds the other half.
2. A file: `user_mesh.read_user_meshes` runs gmsh in a process of its own, once for all bodies that
   are surfaces of the file, and checks cells and groups; `curved_edges.arcs_of` keeps the true
   curves of curved edges for the resultants of loads.
   With `mesh.refine` the vertices of contact edges are where `grading.graded` puts them, and
   elements around them as small as it asks; a file is meshed again (`grading.mesh_refined`).
3. `contact_edges.find_interfaces` finds the facets of each contact, of two bodies those that match.
4. The facets are tagged by edge and contact, and DOLFINx distributes the mesh (`BodyMesh`).

Meshes on rank 0 are `raw_mesh.RawMesh`, straight edges `raw_mesh.Line`.
"""
