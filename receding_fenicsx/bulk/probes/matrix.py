"""Matrix of the probes: values at points for unit contact displacements and unit loads."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.acting.interference import interference_shift
from receding_fenicsx.bulk.back_substitution import law_of
from receding_fenicsx.bulk.body import Bulk, gather_contact, interior_solver
from receding_fenicsx.bulk.condensation import condense_for_fields
from receding_fenicsx.bulk.elimination import BLOCK_COLUMNS, Solve, block_solver, times
from receding_fenicsx.bulk.half_planes.body import HalfPlane
from receding_fenicsx.bulk.half_planes.window import value_rows
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.probes.points import PointValues, point_values
from receding_fenicsx.bulk.stack import Bodies, Stack
from receding_fenicsx.interface.system import ProbeMatrix
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import Scene

ODD = (0, 5)
"""Components u_x and s_xy, which change their sign in a mirror image about x = 0."""


def probe_matrix(bulk: Bodies, scene: Scene) -> ProbeMatrix | None:
    """Return the values at all probes of a scene; collective.

    Points in the half that is not modelled get those of their mirror image; on the axis of symmetry
    u_x and s_xy are zero.

    Args:
        bulk: the body or bodies.
        scene: the scene, with at least one probe.

    Returns:
        The matrix on rank 0, None on the others.

    Raises:
        InputError: a point lies outside its body; on all ranks.
    """
    condense_for_fields(bulk)
    names = tuple(probe.name for probe in scene.probes for _ in probe.coordinates)
    owners = [probe.body for probe in scene.probes for _ in probe.coordinates]
    points = np.array([place for probe in scene.probes for place in probe.coordinates], dtype=float)
    parts: list[tuple[list[int], Array | None]] = []
    for part in bulk.parts:
        here = [k for k, owner in enumerate(owners) if owner in (None, part.scene.body.name)]
        labels = [f"probe '{names[k]}'" for k in here]
        parts.append((here, _body_rows(part, points[here], labels) if here else None))

    def work() -> ProbeMatrix:
        columns = 2 * len(bulk.contact.x) + len(bulk.load_names)
        rows = np.zeros((len(points), 6, columns))
        for side, (here, found) in enumerate(parts):
            if here:
                own = given(found)
                rows[here] = _of_stack(bulk, side, own) if isinstance(bulk, Stack) else own
        if bulk.scene.bolts:
            T, G = law_of(bulk)
            n = G.shape[1]
            rows = np.concatenate([rows[..., :n] + rows[..., n:] @ G, rows[..., n:] @ T], axis=-1)
        held = given(bulk.joined).held if isinstance(bulk, Stack) else bulk.contact.held
        shift = interference_shift(scene, bulk.contact, held)
        if shift is not None:
            rows = np.concatenate([rows, (rows[..., : len(shift)] @ shift)[..., None]], axis=-1)
        return ProbeMatrix(names, points, rows)

    return on_root(bulk.comm, work)


def _body_rows(bulk: Bulk | HalfPlane, points: Array, labels: list[str]) -> Array | None:
    """Return the rows (m, 6, 2N + own loads) of one body on rank 0, None elsewhere."""
    if isinstance(bulk, HalfPlane):
        return on_root(bulk.comm, lambda: value_rows(bulk, points, labels))
    mirrored = bulk.body.half and not bulk.scene.axisymmetric
    modelled = points.copy()
    if mirrored:
        modelled[:, 0] = np.abs(points[:, 0])
    if bulk.interior is None:
        bulk.interior = interior_solver(bulk)
    pc = bulk.interior.getPC()
    factor = pc.getFactorMatrix()
    solve = block_solver(bulk, factor)
    values = point_values(bulk, modelled, labels)
    count = 6 * len(points)
    blocks = [
        _block(bulk, solve, values, (first, min(first + BLOCK_COLUMNS, count)))
        for first in range(0, count, BLOCK_COLUMNS)
    ]
    for thing in (factor, pc):
        thing.destroy()
    if bulk.comm.rank != 0:
        return None
    rows = np.vstack([given(block) for block in blocks]).reshape(len(points), 6, -1)
    if mirrored:
        near = POSITION_TOLERANCE * bulk.body.size
        sign = np.where(np.abs(points[:, 0]) <= near, 0.0, np.sign(points[:, 0]))
        rows[:, ODD] *= sign[:, None, None]
    return rows


def _block(bulk: Bulk, solve: Solve, values: PointValues, rows: tuple[int, int]) -> Array | None:
    """Return some rows of the matrix (n, 2N + loads) on rank 0, None elsewhere."""
    start, end = bulk.stiffness.getOwnershipRange()
    first, last = rows
    own = (values.row >= first) & (values.row < last) & (values.dof >= start) & (values.dof < end)
    g = np.zeros((end - start, last - first))
    np.add.at(g, (values.dof[own] - start, values.row[own] - first), values.value[own])
    if bulk.ties is not None:
        g = _tied(bulk, g)
    z = solve(g)
    of_loads = np.zeros((last - first, len(bulk.loads)))
    for k, (name, load) in enumerate(zip(bulk.load_names, bulk.loads, strict=True)):
        of_loads[:, k] = z.T @ load.getArray(readonly=True) / bulk.young
        if name in bulk.prescribed:
            of_loads[:, k] += g.T @ bulk.prescribed[name].getArray(readonly=True)
    of_loads = bulk.comm.allreduce(of_loads) + values.of_loads[first:last]
    of_contact = gather_contact(bulk, g - times(bulk.stiffness, z))
    if of_contact is None:
        return None
    return np.hstack([bulk.contact.to_local(of_contact).T, of_loads])


def _tied(bulk: Bulk, g: Array) -> Array:
    """Return P^T g of columns g, each rank giving and getting its own rows."""
    assert bulk.ties is not None
    tied = np.empty_like(g)
    given_, result = bulk.stiffness.createVecLeft(), bulk.stiffness.createVecRight()
    for column, place in zip(g.T, tied.T, strict=True):
        given_.getArray()[:] = column
        bulk.ties.multTranspose(given_, result)
        place[:] = result.getArray(readonly=True)
    given_.destroy()
    result.destroy()
    return tied


def _of_stack(stack: Stack, body: int, rows: Array) -> Array:
    """Return rows of one body of a stack for the relative displacements and all loads."""
    joined, part = given(stack.joined), stack.parts[body]
    n = 2 * len(part.contact.x)
    names = stack.load_names + stack.link_names
    of_loads = np.zeros((*rows.shape[:-1], len(names)))
    of_loads[..., [names.index(name) for name in part.load_names]] = rows[..., n:]
    count = len(stack.load_names)
    found = joined.rows(body, rows[..., :n])
    found[..., len(joined.held) :] += of_loads[..., :count]
    if joined.links is not None:
        T, G = joined.links
        found += of_loads[..., count:] @ np.hstack([G, T])
    return found
