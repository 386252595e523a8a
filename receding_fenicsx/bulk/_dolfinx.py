"""The only place that knows which DOLFINx version is running: a function for each changed call.

Tested with 0.5.2 and 0.11; the branches for the releases between follow their documentation.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import basix
import dolfinx
import numpy as np
import ufl
from cffi import VerificationError
from dolfinx import fem, graph, la
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc as fem_petsc
from dolfinx.io.utils import distribute_entity_data
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.errors import NO_ROOM, InputError

VERSION: tuple[int, int] = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])  # type: ignore[assignment]
"""Major and minor version of the running DOLFINx."""

TENSOR_ORDER = {"triangle": [0, 1, 2], "quadrilateral": [0, 1, 3, 2]}
"""DOLFINx's order of a cell's vertices, from an order around the cell."""


def reference_corners(cell: str) -> Array:
    """Return the reference vertices (n, 2) of a cell, in DOLFINx's order."""
    return np.array(basix.geometry(getattr(basix.CellType, cell)))


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the C compiler's command lines, which the root logger logs, off the terminal."""
    before = logging.root.manager.disable
    logging.disable(max(before, logging.INFO))
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            raise
        raise InputError(
            f"{error.filename}: compiled forms cannot be kept there ({error.strerror}); set "
            "XDG_CACHE_HOME to a folder that can be written"
        ) from None
    except VerificationError as error:  # often as there is no compiler
        raise ImportError(f"the forms cannot be compiled: {error}") from None
    finally:
        logging.disable(before)


def vector_space(mesh: dmesh.Mesh, degree: int) -> fem.FunctionSpace:
    """Return the continuous Lagrange space of plane displacements."""
    with _quiet():
        if VERSION < (0, 7):  # 0.7 put the number of components into the element
            return fem.VectorFunctionSpace(mesh, ("Lagrange", degree), dim=2)
        return fem.functionspace(mesh, ("Lagrange", degree, (2,)))


def scalar_space(mesh: dmesh.Mesh, family: str, degree: int) -> fem.FunctionSpace:
    """Return the scalar space of ``family`` "Lagrange" or "DG"."""
    with _quiet():
        if VERSION < (0, 7):  # 0.7 replaced the class that users called by a function
            return fem.FunctionSpace(mesh, (family, degree))
        return fem.functionspace(mesh, (family, degree))


def cell_tensor(mesh: dmesh.Mesh, values: Array) -> fem.Function:
    """Return the function that is a tensor in each owned cell, given as (cells, a, b)."""
    shape = values.shape[1:]
    with _quiet():
        if VERSION < (0, 7):  # 0.7 put the shape into the element
            space = fem.TensorFunctionSpace(mesh, ("DG", 0), shape=shape)
        else:
            space = fem.functionspace(mesh, ("DG", 0, shape))
    function = fem.Function(space)
    function.x.array.reshape(-1, *shape)[cell_dofs(space)[: len(values), 0]] = values
    return function


def create_mesh(comm: MPI.Comm, cell: str, cells: Ints, points: Array) -> dmesh.Mesh:
    """Distribute a mesh of straight-sided cells; arrays are empty on all ranks but 0.

    Points are (m, 2), their numbers around each "triangle" or "quadrilateral" (n, 3 or 4).
    """
    ordered = np.ascontiguousarray(cells[:, TENSOR_ORDER[cell]])
    if VERSION < (0, 7):  # before basix.ufl, the coordinate element is ufl's own
        shape = ufl.Cell(cell, geometric_dimension=2)
        domain = ufl.Mesh(ufl.VectorElement(ufl.FiniteElement("Lagrange", shape, 1)))
        # other cells are refused first, by a text with all their numbers
        listed = dolfinx.cpp.graph.AdjacencyList_int64(ordered)
        return dmesh.create_mesh(comm, listed, points, domain)
    import basix.ufl

    element = basix.ufl.element("Lagrange", cell, 1, shape=(2,))
    if VERSION < (0, 10):  # 0.10 swapped points and element
        return dmesh.create_mesh(comm, ordered, points, ufl.Mesh(element))
    return dmesh.create_mesh(comm, ordered, ufl.Mesh(element), points)


def tag_entities(mesh: dmesh.Mesh, dim: int, entities: Ints, values: NDArray[np.int32]) -> Any:
    """Tag cells or facets (n, vertices), given by rank 0 as for :func:`create_mesh`."""
    if dim == 2:
        cell = {3: "triangle", 4: "quadrilateral"}[entities.shape[1]]
        entities = entities[:, TENSOR_ORDER[cell]]
    entities = np.ascontiguousarray(entities, dtype=np.int64)
    mesh.topology.create_connectivity(dim, 0)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    owned, tags = distribute_entity_data(mesh, dim, entities, values)
    # 0.7 renamed the function
    listed = graph.create_adjacencylist if VERSION < (0, 7) else graph.adjacencylist
    return dmesh.meshtags_from_entities(mesh, dim, listed(owned), tags.astype(np.int32))


def cell_nodes(mesh: dmesh.Mesh) -> NDArray[np.int32]:
    """Return the local geometry nodes (cells, corners): vertices, as cells are straight-sided."""
    if VERSION < (0, 7):  # 0.7 made the adjacency list an array
        corners = len(reference_corners(mesh.topology.cell_name()))
        return mesh.geometry.dofmap.array.reshape(-1, corners)
    if VERSION < (0, 11):  # 0.11 has one dofmap for each kind of cell
        return mesh.geometry.dofmap
    return mesh.geometry.dofmaps[0]


def cell_corners(mesh: dmesh.Mesh) -> Array:
    """Return the coordinates (cells, corners, 2) of the vertices of all owned cells."""
    owned = mesh.topology.index_map(2).size_local
    return np.asarray(mesh.geometry.x[cell_nodes(mesh)[:owned], :2])


def global_nodes(space: fem.FunctionSpace, local: NDArray[np.int32]) -> Ints:
    """Return the global numbers of nodes of a space."""
    numbers = space.dofmap.index_map.local_to_global(np.ascontiguousarray(local).ravel())
    return np.asarray(numbers, dtype=np.int64).reshape(local.shape)


def cell_dofs(space: fem.FunctionSpace) -> NDArray[np.int32]:
    """Return the local numbers of the nodes of all cells (cells, n)."""
    dofmap = space.dofmap
    # 0.7 made the adjacency list an array
    listed = dofmap.list.array if VERSION < (0, 7) else dofmap.list
    return np.asarray(listed).reshape(-1, dofmap.dof_layout.num_dofs)


def tabulated(cell: str, degree: int, at: Array) -> tuple[Array, Array]:
    """Return values (m, n) and slopes (2, m, n) of shape functions at reference points (m, 2)."""
    values = np.asarray(_element(cell, degree).tabulate(1, at))[..., 0]
    return values[0], values[1:]


def mapped(cell: str, corners: Array, at: Array) -> tuple[Array, Array]:
    """Return x (..., m, 2) of reference points X (m, 2) in cells (..., n, 2), and dx/dX."""
    value, slopes = tabulated(cell, 1, at)
    jacobian = np.einsum("kmn,...ni->...mik", slopes, corners)
    return np.einsum("mn,...ni->...mi", value, corners), jacobian


@cache
def _element(cell: str, degree: int) -> Any:
    """Return the Lagrange element of basix that the spaces here have."""
    family, variant = basix.ElementFamily.P, basix.LagrangeVariant.gll_warped
    return basix.create_element(family, getattr(basix.CellType, cell), degree, variant)


def assemble_matrix(form: ufl.Form) -> PETSc.Mat:
    """Compile a bilinear form, or load it from the cache; assemble it without conditions."""
    with _quiet():
        compiled = fem.form(form)
    matrix = fem_petsc.assemble_matrix(compiled)
    matrix.assemble()
    return matrix


def sum_at_nodes(
    space: fem.FunctionSpace, local: NDArray[np.int32], values: Array, name: str = "sum"
) -> fem.Function:
    """Return the function whose value at a node is the sum of those given there, on all ranks."""
    function = fem.Function(space, name=name)
    np.add.at(function.x.array, local, values)
    # 0.6 renamed the class
    mode = la.ScatterMode if VERSION < (0, 6) else la.InsertMode
    function.x.scatter_reverse(mode.add)
    function.x.scatter_forward()
    return function


def owned_values(function: fem.Function) -> Array:
    """Return a view of the owned entries of a function's array; ghosts are left."""
    dofmap = function.function_space.dofmap
    return function.x.array[: dofmap.index_map.size_local * dofmap.index_map_bs]
