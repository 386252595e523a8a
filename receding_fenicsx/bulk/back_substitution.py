"""Displacement fields of the bodies from load factors and contact displacements.

With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.acting.interference import interference_shift
from receding_fenicsx.bulk.body import Bulk, gather_contact, interior_solver, owned_contact
from receding_fenicsx.bulk.half_planes.body import HalfPlane
from receding_fenicsx.bulk.two_bodies import Bodies, Pair
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import INTERFERENCE

Side = tuple[Bulk | HalfPlane, Array | None, Array | None]
"""A body with its own load factors and contact displacements, on rank 0."""


def displacements(
    bulk: Bulk | Pair, load: Array | None, u: Array | None
) -> list[tuple[Bulk, fem.Function]]:
    """Return each body that has a mesh with its displacement field; collective.

    Arguments as of :func:`sides_of`.
    """
    return [
        (part, back_substitute(part, *side))
        for part, *side in sides_of(bulk, load, u)
        if isinstance(part, Bulk)
    ]


def sides_of(bulk: Bodies, load: Array | None, u: Array | None) -> list[Side]:
    """Return each body with its own load factors and contact displacements.

    Args:
        bulk: the body or bodies; a pair is condensed by then.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) contact displacements [v; w], of a pair the first body's less the second's, with
            an interference as in the record; only rank 0's are used.

    Returns:
        One body, or two.
    """
    if load is not None and u is not None and INTERFERENCE in bulk.scene.preloads:
        held = bulk.joined.held if isinstance(bulk, Pair) and bulk.joined else bulk.contact.held
        shift = interference_shift(bulk.scene, bulk.contact, held)
        load, u = np.asarray(load)[:-1], u + np.asarray(load)[-1] * given(shift)
    if not isinstance(bulk, Pair):
        return [(bulk, load, u)]
    sides: list[tuple[Array | None, Array | None]] = [(None, None), (None, None)]
    if bulk.joined is not None and load is not None and u is not None:
        factors, apart = np.asarray(load, float), np.where(bulk.joined.held, 0.0, u)
        second = bulk.joined.back[0] @ apart + bulk.joined.back[1] @ factors
        for k, moved in enumerate((apart + second, second)):
            own = [bulk.load_names.index(name) for name in bulk.parts[k].load_names]
            sides[k] = factors[own], moved
    return [(part, *side) for part, side in zip(bulk.parts, sides, strict=True)]


def back_substitute(bulk: Bulk, load: Array | None, u: Array | None) -> fem.Function:
    """Return the displacement field for load factors and contact displacements.

    With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C; prescribed
    displacements are added, and platens take their nodes along.

    Args:
        bulk: the body.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) contact displacements [v; w]; only rank 0's are used.

    Returns:
        The displacement, ghosts up to date.
    """
    factors, contact = bulk.comm.bcast((load, u), root=0)
    if bulk.interior is None:
        bulk.interior = interior_solver(bulk)
    held, solution = bulk.stiffness.createVecRight(), bulk.stiffness.createVecRight()
    held.set(0.0)
    start = bulk.stiffness.getOwnershipRange()[0]
    dofs, places = owned_contact(bulk)
    held.getArray()[dofs - start] = bulk.contact.to_global(np.asarray(contact, float))[places]
    rhs = bulk.stiffness.createVecLeft()
    bulk.stiffness.mult(held, rhs)
    rhs.scale(-1.0)
    for factor, vector in zip(np.asarray(factors, float), bulk.loads, strict=True):
        rhs.axpy(factor / bulk.young, vector)
    rhs.getArray()[np.concatenate([bulk.fixed, dofs]) - start] = 0.0
    bulk.interior.solve(rhs, solution)
    solution.axpy(1.0, held)
    for name, factor in zip(bulk.load_names, np.asarray(factors, float), strict=True):
        if name in bulk.prescribed:
            solution.axpy(factor, bulk.prescribed[name])
    if bulk.ties is not None:
        solution.copy(held)
        bulk.ties.mult(held, solution)
    displacement = fem.Function(bulk.space, name="displacement")
    _dolfinx.owned_values(displacement)[:] = solution.getArray(readonly=True)
    displacement.x.scatter_forward()
    for vector in (held, rhs, solution):
        vector.destroy()
    return displacement


def reactions(bulk: Bulk, load: Array | None, displacement: fem.Function) -> Array | None:
    """Return the contact reactions [Q; P] of a displacement field.

    They are the nodal forces E A u less the loads: an independent check of
    r = sum lambda r* + K u.

    Args:
        bulk: the body.
        load: (n_loads,) load factors; only rank 0's are used.
        displacement: field in the body's space.

    Returns:
        (2N,) reactions on rank 0, None elsewhere.
    """
    factors = bulk.comm.bcast(load, root=0)
    vector, force = bulk.stiffness.createVecRight(), bulk.stiffness.createVecLeft()
    vector.getArray()[:] = _dolfinx.owned_values(displacement)
    bulk.stiffness.mult(vector, force)
    force.scale(bulk.young)
    for name, factor, nodal in zip(
        bulk.load_names, np.asarray(factors, float), bulk.loads, strict=True
    ):
        # a prescribed displacement is in the field already
        if name not in bulk.prescribed:
            force.axpy(-factor, nodal)
    gathered = gather_contact(bulk, force.getArray(readonly=True)[:, None])
    vector.destroy()
    force.destroy()
    return None if gathered is None else bulk.contact.to_local(gathered[:, 0])
