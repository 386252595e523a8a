"""Fields of the body at one instant: gathered for pictures, and as XDMF files for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.atomic import check_room
from receding_fenicsx.bulk import elasticity
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.condensation import condense_pair
from receding_fenicsx.bulk.two_bodies import Pair, displacements
from receding_fenicsx.interface.system import Array
from receding_fenicsx.mpi import on_root

if TYPE_CHECKING:
    from dolfinx import fem

XDMF_OVERHEAD = 100_000
"""Bytes of an XDMF file and its HDF5 file, at most, that are no numbers."""


@dataclass(frozen=True)
class Fields:
    """Displacement and stresses at the vertices of the whole body, on rank 0.

    Attributes:
        points: (n, 2) vertices.
        cells: (m, 3 or 4) vertices around each cell.
        displacement: (n, 2) displacement.
        stress: by name ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear"), (n,) averages over
            the cells around each vertex.
        body: (n,) number of the body that each vertex belongs to; None for one body.
    """

    points: Array
    cells: NDArray[np.int64]
    displacement: Array
    stress: dict[str, Array]
    body: NDArray[np.int64] | None = None


def fields_at(bulk: Bulk | Pair, load: Array, u: Array, file: Path | None = None) -> Fields | None:
    """Bring one instant back from the contact to the body; all ranks call this together.

    Args:
        bulk: the body or bodies.
        load: (n_loads,) load factors, on rank 0.
        u: (2N,) contact displacements [v; w], on rank 0.
        file: an .xdmf file for the fields of the modelled body, if wanted; of two bodies each has
            its own, with the body's name in it.

    Returns:
        The fields of the whole body, or of both, on rank 0, None elsewhere.
    """
    if isinstance(bulk, Bulk):
        return _of_body(bulk, elasticity.back_substitute(bulk, load, u), file)
    condense_pair(bulk)
    files = [None, None] if file is None else field_files(bulk, file)
    sides = displacements(bulk, load, u)
    parts = [_of_body(*side, own) for side, own in zip(sides, files, strict=True)]
    first, second = parts
    return None if first is None or second is None else _together(first, second)


def field_files(bulk: Bulk | Pair, file: Path) -> list[Path]:
    """Return the files of the fields: the file itself, or one for each of two bodies."""
    if isinstance(bulk, Bulk):
        return [file]
    return [file.with_stem(f"{file.stem}_{name}") for name in bulk.names]


def _of_body(bulk: Bulk, displacement: fem.Function, file: Path | None) -> Fields | None:
    """Return the fields of one body on rank 0, None elsewhere."""
    stresses = elasticity.stresses(bulk, displacement)
    linear = _at_vertices(bulk, displacement)
    if file is not None:
        _write_xdmf(bulk, file, [linear, *stresses.cell.values()])
    points, cells, vectors = _gather(bulk, linear)
    gathered = {name: _gather(bulk, f)[2] for name, f in stresses.nodal.items()}
    if bulk.comm.rank != 0:
        return None
    values = {name: value[:, 0] for name, value in gathered.items()}
    whole = Fields(points, cells, vectors, values)
    return _mirrored(whole) if bulk.body.half else whole


def _at_vertices(bulk: Bulk, displacement: fem.Function) -> fem.Function:
    """Return the displacement in the space of degree 1, which is that of the mesh."""
    from dolfinx import fem

    from receding_fenicsx.bulk import _dolfinx

    linear = fem.Function(_dolfinx.vector_space(bulk.body.mesh, 1), name="displacement")
    linear.interpolate(displacement)
    linear.x.scatter_forward()
    return linear


def _write_xdmf(bulk: Bulk, file: Path, functions: list[fem.Function]) -> None:
    from dolfinx import io

    counts = [bulk.body.mesh.topology.index_map(dim).size_global for dim in (0, 2)]
    numbers = 4 * counts[1] + sum(3 * max(counts) for _ in ("geometry", *functions))
    on_root(bulk.comm, lambda: check_room(file, 8 * numbers + XDMF_OVERHEAD))
    with io.XDMFFile(bulk.comm, str(file), "w") as xdmf:
        xdmf.write_mesh(bulk.body.mesh)
        for function in functions:
            xdmf.write_function(function, 0.0)


def _gather(bulk: Bulk, function: fem.Function) -> tuple[Array, NDArray[np.int64], Array]:
    """Bring points, cells and values of a function of degree 1 to rank 0; empty elsewhere."""
    space = function.function_space
    dofmap, block = space.dofmap, space.dofmap.index_map_bs
    topology = bulk.body.mesh.topology
    owned_cells = topology.index_map(topology.dim).size_local
    local = np.array([dofmap.cell_dofs(c) for c in range(owned_cells)], dtype=np.int32)
    width = {"triangle": 3, "quadrilateral": 4}[bulk.body.cell]
    cells = dofmap.index_map.local_to_global(local.ravel()).reshape(-1, width)
    n = dofmap.index_map.size_local
    points = space.tabulate_dof_coordinates()[:n, :2]
    values = function.x.array[: n * block].reshape(n, block)
    parts: Any = bulk.comm.gather((points, cells, values), root=0)
    if bulk.comm.rank != 0:
        return points, cells, values
    points, cells, values = (np.vstack([part[k] for part in parts]) for k in range(3))
    # DOLFINx numbers a quadrilateral's vertices like a tensor product, pictures go around it
    return points, cells if width == 3 else cells[:, [0, 1, 3, 2]], values


def _together(first: Fields, second: Fields) -> Fields:
    """Return the fields of two bodies in one."""
    cells = [first.cells, second.cells]
    if cells[0].shape[1] != cells[1].shape[1]:
        # triangles stand for quadrilaterals where the other body has triangles
        cells = [np.vstack([c[:, :3], c[:, [0, 2, 3]]]) if c.shape[1] == 4 else c for c in cells]
    return Fields(
        np.vstack([first.points, second.points]),
        np.vstack([cells[0], cells[1] + len(first.points)]),
        np.vstack([first.displacement, second.displacement]),
        {name: np.concatenate([v, second.stress[name]]) for name, v in first.stress.items()},
        np.repeat([0, 1], [len(first.points), len(second.points)]),
    )


def _mirrored(half: Fields) -> Fields:
    """Add the image of the half x >= 0: u_x and s_xy change their sign."""
    n = len(half.points)
    flip = np.array([-1.0, 1.0])
    stress = {
        name: np.concatenate([value, -value if name == "sxy" else value])
        for name, value in half.stress.items()
    }
    return Fields(
        np.vstack([half.points, half.points * flip]),
        np.vstack([half.cells, half.cells[:, ::-1] + n]),
        np.vstack([half.displacement, half.displacement * flip]),
        stress,
    )
