"""Meshes of the bodies with named edges: rectangles meshed by gmsh, or files of the user.

The steps of `meshing.make_meshes`, all but the last on rank 0:

1. A rectangle: `rectangle.rectangle_mesh` chooses coordinates along the contact edge and into the
   depth and the positions that need vertices; gmsh meshes the half of `meshes/rectangle.geo`, and
   `snap` moves its nodes to their exact places. A file: `user_mesh.read_user_meshes` runs gmsh in a
   process of its own. With `mesh.refine`, `grading.graded` places the vertices of contact edges.
2. `contact_edges.find_interfaces` finds the facets of each contact, of two bodies those that match.
3. The facets are tagged by edge and contact, and DOLFINx distributes the mesh (`BodyMesh`).
"""
