"""Meshes of a scene's bodies, rectangles and files; no communication.

Of a rectangle gmsh sees lengths in units of its depth below the contact edge, so that a scene whose
lengths are multiplied by a power of two has the same mesh to the bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from receding_fenicsx.bulk.mesh.gmsh_model import geo_path, gmsh_model, mesh_of
from receding_fenicsx.bulk.mesh.graded_edges import grade_half
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, with_radii
from receding_fenicsx.bulk.mesh.rectangle import (
    EDGE_NAMES,
    Frame,
    HalfMesh,
    Marks,
    find_marks,
    make_frame,
    mirror,
    places_of,
    snap,
)
from receding_fenicsx.bulk.mesh.user_mesh import read_user_meshes
from receding_fenicsx.errors import SolveError
from receding_fenicsx.scene.model import Body, Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.rectangle_edges import EDGES, edge_points, is_cylinder, is_horizontal

GMSH_TYPES = {"triangle": 2, "quadrilateral": 3}


def raw_meshes(scene: Scene, half: bool) -> list[RawMesh]:
    """Mesh or read the bodies of a scene; the surfaces of one file together, if none is refined."""
    found: dict[str, RawMesh] = {}
    for body in scene.bodies:
        if body.mesh is None:
            found[body.name] = _rectangle(scene, body, half)
        elif body.name not in found:
            file = body.mesh, body.parameters
            others = () if scene.mesh.refine else scene.others
            alike = [body, *(b for b in others if b != body and (b.mesh, b.parameters) == file)]
            meshes = read_user_meshes(alike, part_of(scene, body).mesh, scene.axisymmetric)
            for each, mesh in zip(alike, meshes, strict=True):
                found[each.name] = with_radii(mesh) if scene.axisymmetric else mesh
    return [found[body.name] for body in scene.bodies]


def _rectangle(whole: Scene, body: Body, half: bool) -> RawMesh:
    """Mesh a rectangle of a scene."""
    scene = part_of(whole, body)
    if scene.axisymmetric:
        half = half and is_cylinder(scene, body)
        if half and not is_horizontal(scene, scene.contacts[0].edge):
            # the section of a cylinder is meshed from its outer edge like that of a ring
            section = (0.25 * body.width, body.position[1])
            scene = replace(scene, body=replace(body, width=0.5 * body.width, position=section))
            half = False
    frame = make_frame(scene, half, bool(whole.others))
    marks = find_marks(scene, frame)
    mesh = _gmsh_half(scene, frame, marks)
    snap(scene, frame, marks, mesh)
    if not half:
        mesh = mirror(mesh)
    edges = {EDGE_NAMES[frame.edge][name]: facets for name, facets in mesh.edges.items()}
    if half:
        edges["left"] = np.empty((0, 2), dtype=np.int64)
    middles = {edge: np.hstack(edge_points(scene, edge, [0.0])) for edge in EDGES}
    points = frame.to_body(mesh.s, mesh.d) + np.array(scene.body.position)
    return RawMesh(points, mesh.cells, edges, {}, middles, upright=True)


def _gmsh_half(scene: Scene, frame: Frame, marks: Marks) -> HalfMesh:
    """Mesh the half body."""
    cell = scene.mesh.cell
    unit = frame.depth
    numbers = {
        "width": [frame.length / unit],
        "height": [1.0],
        "contact_elements": [float(scene.mesh.contact_elements)],
        "growth": [float(scene.mesh.growth)],
        "quadrilaterals": [float(cell == "quadrilateral")],
        "both_edges": [float(frame.both)],
        "top_marks": (marks.top / unit).tolist(),
        "side_marks": (marks.side / unit).tolist(),
        "inner_x": (marks.inner[:, 0] / unit).tolist(),
        "inner_y": (marks.inner[:, 1] / unit).tolist(),
        "end_x": (marks.ends[:, 0] / unit).tolist(),
        "end_y": (marks.ends[:, 1] / unit).tolist(),
    }
    path = str(geo_path("rectangle.geo"))
    with gmsh_model() as gmsh:
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, value)
        try:
            gmsh.merge(path)
            if scene.mesh.refine:
                grade_half(gmsh, places_of(scene, frame), marks.contact / unit, unit)
            gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            raise SolveError(
                f"gmsh could not mesh the body: {caught}; change mesh.growth or contact_elements"
            ) from caught
        if list(gmsh.model.mesh.getElementTypes(2)) != [GMSH_TYPES[cell]]:
            raise SolveError(f"gmsh did not fill the body with {cell}s; change contact_elements")
        mesh = mesh_of(gmsh, None, "rectangle.geo", unit)
    return HalfMesh(mesh.points[:, 0].copy(), mesh.points[:, 1].copy(), mesh.cells, mesh.edges)
