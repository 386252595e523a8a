"""User meshes: a .geo file that gmsh meshes, or a mesh file that gmsh reads.

gmsh reads the file in a process of its own: commands of a .geo file (``Exit``) can end the process
that they run in, and a damaged mesh can crash it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from receding_fenicsx import workers
from receding_fenicsx.arrays import Ints
from receding_fenicsx.bulk.mesh.gmsh_model import gmsh_model, mesh_of
from receding_fenicsx.bulk.mesh.grading import mesh_refined
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, sides, with_radii
from receding_fenicsx.errors import InputError, MeshMisfit
from receding_fenicsx.scene.checks import nearest
from receding_fenicsx.scene.model import Body, MeshOptions


def read_user_meshes(
    bodies: Sequence[Body], options: MeshOptions, axisymmetric: bool = False
) -> list[RawMesh]:
    """Mesh a .geo file, or read a mesh, of first-order cells; no communication.

    A .geo file is given the numbers ``contact_elements``, ``growth`` and ``quadrilaterals`` (0 or
    1) of the scene and the body's own ``parameters``; they replace defaults in DefineConstant.

    Args:
        bodies: the bodies that are surfaces of one mesh, with the same ``mesh``, the path, and
            ``parameters``; one body if places are refined.
        options: the scene's mesh options, with the refined places on the body.
        axisymmetric: positions of places on horizontal edges are radii.
    """
    path = Path(str(bodies[0].mesh))
    where = _label(path)
    if not path.is_file():
        raise InputError(f'[body] mesh: "{path}": no such file; check the path')
    _check_parameters(bodies[0], path, where)
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
    where, is_geo = _label(path), path.suffix == ".geo"
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
            gmsh.merge(str(path))
            if is_geo:
                gmsh.option.setNumber("Mesh.ElementOrder", 1)
                gmsh.model.mesh.generate(2)
        except Exception as caught:  # gmsh raises nothing more special
            reason = " ".join(str(caught).split())
            raise InputError(f"{where}: gmsh cannot use it: {reason}; mend the file") from None
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


def _label(path: Path) -> str:
    return f'[body] mesh "{path.name}"'


def _check_parameters(body: Body, path: Path, where: str) -> None:
    """Refuse parameters that the file does not take."""
    if not body.parameters:
        return
    if path.suffix != ".geo":
        raise InputError(
            f"{where}: parameters are for .geo files; leave them out, or give the .geo file"
        )
    words = words_of(path)
    for name in body.parameters:
        if name not in words and not words & {"Include", "Merge"}:
            close = nearest(name, words)
            hint = f"did you mean '{close}'?" if close else "DefineConstant it there"
            raise InputError(f"{where}: the file has no parameter '{name}'; {hint}")


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
    n, width = len(mesh.points), mesh.cells.shape[1]
    cell = np.arange(len(mesh.cells))
    parts, _ = _parts(np.repeat(mesh.cells[:, 0], width), mesh.cells.ravel(), n)
    if parts > 1:
        raise InputError(
            f"{where}: falls into {parts} parts that share no nodes; join them (Coherence), or "
            "name the part that is the body by body.surface"
        )
    pairs, owner = sides(mesh.cells)
    _, side = np.unique(pairs[:, 0] * n + pairs[:, 1], return_inverse=True)
    parts, part = _parts(owner, len(cell) + side.ravel(), len(cell) + int(side.max()) + 1)
    if parts > 1:
        first = part[np.repeat(cell, width)] == part[0]
        corner = mesh.cells.ravel()
        x, y = mesh.points[np.intersect1d(corner[first], corner[~first])[0]]
        raise InputError(
            f"{where}: falls into {parts} parts that meet in single nodes only, one at "
            f"({x:g}, {y:g}), about which they turn freely; join them along a curve"
        )


def _parts(rows: Ints, columns: Ints, n: int) -> tuple[int, Ints]:
    """Return the number of parts of a graph with n nodes and these links, and that of each node."""
    # gmsh's process does without SciPy: it would take as long to load as gmsh
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    links = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    count, part = connected_components(links, directed=False)
    return int(count), part


def takes_elements(body: Body) -> bool:
    """Return whether a body's file is a .geo file that takes ``contact_elements``."""
    path = Path(body.mesh or "")
    return path.suffix == ".geo" and "contact_elements" in words_of(path)


def words_of(path: Path) -> set[str]:
    """Return the words of a .geo file, and of the .geo files that it includes."""
    words: set[str] = set()
    read, todo = set(), [path]
    while todo:
        file = todo.pop()
        if file in read or not file.is_file():
            continue
        read.add(file)
        text = file.read_text(encoding="utf-8", errors="replace")
        words |= set(re.findall(r"[A-Za-z_]\w*", text))
        included = re.findall(r'(?:Include|Merge)\s*"([^"]+\.geo)"', text)
        todo += [(file.parent / name).resolve() for name in included]
    return words
