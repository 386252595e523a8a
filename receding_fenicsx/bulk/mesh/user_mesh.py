"""Meshes by gmsh: its session and model; .geo files of the user, or mesh files that gmsh reads.

gmsh reads the user's file in a process of its own: commands of a .geo file (``Exit``) can end the
process that they run in, and a damaged mesh can crash it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx import workers
from receding_fenicsx.arrays import Ints
from receding_fenicsx.bulk.mesh.grading import mesh_refined
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, arcs_of, sides, with_radii
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.checks import nearest, suggestion
from receding_fenicsx.scene.identity import geo_text, mesh_files
from receding_fenicsx.scene.model import Body, MeshOptions


@contextmanager
def gmsh_model() -> Iterator[Any]:
    """Yield the gmsh module with an empty model, silent and on one thread."""
    try:
        import gmsh
    except OSError as error:  # libGLU and the like are not there
        raise ImportError(str(error)) from None
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.model.add("receding_fenicsx")
    gmsh.parser.clear()
    try:
        yield gmsh
    finally:
        gmsh.parser.clear()
        gmsh.model.remove()
        if ours:
            gmsh.finalize()


def mesh_of(gmsh: Any, surface: str | None, where: str, scale: float) -> RawMesh:
    """Return the plane mesh in gmsh's model, whose unit has the length ``scale``, with its groups.

    The body is a physical surface; None takes all of them, or all surfaces.
    """
    mesh, model = gmsh.model.mesh, gmsh.model
    if len(mesh.getElementTypes(3)):
        raise InputError(f"{where}: is a mesh of a solid; give the mesh of a plane body")
    around, surfaces = _cells(gmsh, surface, where)
    tags, coordinates, _ = mesh.getNodes()
    coordinates = coordinates.reshape(-1, 3)
    # nodes that no cell uses are left out
    used = np.isin(tags, around)
    points = scale * coordinates[used]
    # products of larger coordinates overflow
    wrong = ~np.all(np.abs(points) < 1e50, axis=1)
    if np.any(wrong):
        number, place = tags[used][wrong][0], points[wrong][0].tolist()
        raise InputError(
            f"{where}: node {number} is at {place}, not a finite position; mesh it again"
        )
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags[used].astype(np.int64)] = np.arange(len(points))
    size = np.ptp(points[:, :2], axis=0).max()
    if np.abs(points[:, 2]).max() > 1e-9 * size:
        raise InputError(f"{where}: is not plane; a plane body has z = 0 everywhere")
    edges, spots = {}, {}
    for dim, tag in model.getPhysicalGroups():
        if dim > 1:
            continue
        name = model.getPhysicalName(dim, tag) or str(tag)
        entities = model.getEntitiesForPhysicalGroup(dim, tag)
        nodes = [part for e in entities for part in mesh.getElements(dim, e)[2]]
        places = number[np.concatenate([np.empty(0), *nodes]).astype(np.int64)]
        # a group may extend to other bodies of the file
        if dim == 0:
            spots[name] = places[places >= 0]
        else:
            facets = places.reshape(-1, 2)
            facets = facets[np.all(facets >= 0, axis=1)]
            # one that a file lists twice counts once
            first = np.unique(np.sort(facets, axis=1), axis=0, return_index=True)[1]
            edges[name] = facets[np.sort(first)]
    cells, arcs = number[around], arcs_of(gmsh, scale)
    return RawMesh(points[:, :2].copy(), cells, edges, spots, arcs=arcs, surfaces=surfaces)


def _cells(gmsh: Any, name: str | None, where: str) -> tuple[Ints, tuple[str, ...]]:
    """Return the nodes around each cell of the body, and the name of its physical surface."""
    model = gmsh.model
    groups = {
        model.getPhysicalName(2, tag) or str(tag): tag for _, tag in model.getPhysicalGroups(2)
    }
    if name is not None and name not in groups:
        hint = suggestion(name, list(groups)) if groups else "declare it"
        raise InputError(f"{where}: has no physical surface '{name}'; {hint}")
    chosen = groups if name is None else {name: groups[name]}
    surfaces: dict[int, str] = {}
    for group, tag in chosen.items():
        for e in map(int, model.getEntitiesForPhysicalGroup(2, tag)):
            surfaces[e] = f"{surfaces[e]}/{group}" if e in surfaces else group
    if not groups:
        surfaces = {int(e): "" for _, e in model.getEntities(2)}
    names: list[str] = []
    found: dict[int, list[NDArray[np.uint64]]] = {}
    for surface in sorted(surfaces):
        for kind, tags, nodes in zip(*model.mesh.getElements(2, surface), strict=True):
            found.setdefault(int(kind), []).append(nodes)
            names += [surfaces[surface]] * len(tags)
    if not found:
        advice = "mesh the surface and put it in a Physical Surface"
        if surfaces:
            advice = "is the outline of its surface closed, and does it enclose an area?"
        elif not model.getEntities():
            advice = "gmsh finds nothing in it; give a .geo or .msh file"
        raise InputError(f"{where}: has no cells; {advice}")
    # gmsh's types: lines 1, triangles 2, quadrilaterals 3
    if set(found) == {2, 3}:
        raise InputError(
            f"{where}: mixes triangles and quadrilaterals; use one kind, for quadrilaterals "
            "transfinite surfaces with Recombine"
        )
    ((kind, cells), *others) = found.items()
    if others or kind not in (2, 3) or set(model.mesh.getElementTypes(1)) - {1}:
        raise InputError(
            f"{where}: has cells of higher order; save it with Mesh.ElementOrder = 1 (mesh.degree "
            "sets the degree of the displacement)"
        )
    return np.concatenate(cells).astype(np.int64).reshape(-1, kind + 1), tuple(names)


def read_user_meshes(
    bodies: Sequence[Body], options: MeshOptions, axisymmetric: bool = False
) -> list[RawMesh]:
    """Mesh a .geo file, or read a mesh, of first-order cells; no communication.

    A .geo file is given the numbers ``contact_elements``, ``growth`` and ``quadrilaterals`` (0 or
    1) of the scene and the body's own ``parameters``; they replace defaults in DefineConstant. The
    bodies are surfaces of one mesh with the same parameters, one if places are refined.
    """
    path = Path(str(bodies[0].mesh))
    where = f'[body] mesh "{path.name}"'
    if not path.is_file():
        raise InputError(f'[body] mesh: "{path}": no such file; check the path')
    parameters = bodies[0].parameters
    if parameters and path.suffix != ".geo":
        raise InputError(
            f"{where}: parameters are for .geo files; leave them out, or give the .geo file"
        )
    words = words_of(path) if parameters else set()
    for name in set(parameters) - words if not words & {"Include", "Merge"} else ():
        close = nearest(name, words)
        hint = f"did you mean '{close}'?" if close else "DefineConstant it there"
        raise InputError(f"{where}: the file has no parameter '{name}'; {hint}")
    try:
        job = workers.submit("gmsh", _meshes, bodies, options, axisymmetric)
        meshes: list[RawMesh] = workers.result("gmsh", job)
    except workers.WorkerEnded as ended:
        if ended.code is None or ended.code < 0:
            raise InputError(
                f"{where}: gmsh crashed while reading it ({ended}); mend the file"
            ) from None
        raise InputError(
            f"{where}: ends gmsh before the mesh is made (Exit); change the file or its parameters"
        ) from None
    except Exception:
        workers.end("gmsh")  # what has failed may have left something behind
        raise
    for mesh in meshes:
        _check_cells(mesh, where)
    return meshes


def _meshes(bodies: Sequence[Body], options: MeshOptions, axisymmetric: bool) -> list[RawMesh]:
    """Mesh or read the bodies' file in this process; see :func:`read_user_meshes`."""
    body, path = bodies[0], Path(str(bodies[0].mesh))
    where, is_geo = f'[body] mesh "{path.name}"', path.suffix == ".geo"
    with gmsh_model() as gmsh:
        numbers = {
            "contact_elements": float(options.contact_elements),
            "growth": float(options.growth),
            "quadrilaterals": float(options.cell == "quadrilateral"),
            **body.parameters,
        }
        for name, value in numbers.items():
            gmsh.parser.setNumber(name, [value])
        try:
            with TemporaryDirectory() as folder:
                # of a last line without a line break gmsh takes the first statement only, but not
                # in a file that another one includes
                whole = Path(folder, path.name)
                whole.write_text(f'Include "{path.resolve()}";\n', encoding="utf-8")
                ends = not is_geo or path.read_bytes().endswith(b"\n")
                gmsh.merge(str(path if ends else whole))
            if is_geo:
                gmsh.option.setNumber("Mesh.ElementOrder", 1)
                gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            reason = " ".join(str(caught).split())
            raise MeshMisfit(f"{where}: gmsh cannot use it: {reason}; mend the file") from None
        # gmsh itself scales a mesh only when it writes it
        scale = gmsh.option.getNumber("Mesh.ScalingFactor") if is_geo else 1.0

        def found() -> list[RawMesh]:
            return [mesh_of(gmsh, body.surface, where, scale) for body in bodies]

        meshes = found()
        if options.refine:
            if not is_geo:
                raise InputError(
                    f"{where}: [mesh] refine: needs the .geo file; give it, not a mesh"
                )
            coarse = with_radii(meshes[0]) if axisymmetric else meshes[0]
            mesh_refined(gmsh, options.refine, coarse, scale, f"{where}: [mesh] refine")
        for _ in range(options.refinements or 0):
            gmsh.model.mesh.refine()
        return found() if options.refine or options.refinements else meshes


def _check_cells(mesh: RawMesh, where: str) -> None:
    """Turn all cells counter-clockwise; refuse flat cells and meshes in several parts."""
    corners = mesh.points[mesh.cells]
    after, before = (np.roll(corners, shift, axis=1) - corners for shift in (-1, 1))
    turn = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    clockwise = turn.sum(axis=1) < 0.0
    mesh.cells[clockwise] = mesh.cells[clockwise][:, ::-1]
    turn[clockwise] *= -1.0
    longest = (after**2).sum(axis=-1).max(axis=1)
    # double area at a corner, over the square of the longest side
    flat = turn.min(axis=1) <= 1e-6 * longest
    if np.any(flat):
        x, y = corners[np.argmax(flat)].mean(axis=0)
        raise MeshMisfit(
            f"{where}: {int(flat.sum())} of its cells are flat or folded, one at ({x:g}, {y:g}); "
            "mesh the body better"
        )
    pairs, owner = sides(mesh.cells)
    keys = pairs[:, 0] * len(mesh.points) + pairs[:, 1]
    _, side, times = np.unique(keys, return_inverse=True, return_counts=True)
    if times.max() > 2:
        x, y = mesh.points[pairs[np.argmax(times[side.ravel()])]].mean(axis=0)
        raise InputError(
            f"{where}: more than two of its cells share the side at ({x:g}, {y:g}); put each "
            "surface into one physical group, and mesh it once"
        )
    # gmsh's process does without SciPy: it would take as long to load as gmsh
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = len(mesh.cells) + len(times)
    links = coo_matrix((np.ones(len(owner)), (owner, len(mesh.cells) + side.ravel())), (n, n))
    parts, part = connected_components(links, directed=False)
    if parts > 1:
        first = part[: len(mesh.cells)] == part[0]
        how = (
            "share no nodes; join them (Coherence), or name the part that is the body by "
            "body.surface"
        )
        for x, y in mesh.points[np.intersect1d(mesh.cells[first], mesh.cells[~first])[:1]]:
            how = (
                f"meet in single nodes only, one at ({x:g}, {y:g}), about which they turn freely; "
                "join them along a curve"
            )
        raise InputError(f"{where}: falls into {parts} parts that {how}")


def takes_elements(body: Body) -> bool:
    """Return whether a body's file is a .geo file that takes ``contact_elements``."""
    path = Path(body.mesh or "")
    return path.suffix == ".geo" and "contact_elements" in words_of(path)


def words_of(path: Path) -> set[str]:
    """Return the words of a .geo file but comments and strings, and of files that it includes."""
    texts = [geo_text(file) for file in mesh_files(path) if file.suffix == ".geo"]
    return set(re.findall(r"[A-Za-z_]\w*", re.sub(r'"[^"]*"', "", "\n".join(texts))))
