"""Displacement fields of the bodies from load factors and contact displacements.

With I the interior and C the contact, A_II u_I = sum_k lambda_k f_k / E - A_IC u_C.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.acting.bolts import bolt_law
from receding_fenicsx.bulk.acting.interference import interference_shift
from receding_fenicsx.bulk.body import Bulk, interior_solver, owned_contact
from receding_fenicsx.bulk.half_planes.body import HalfPlane
from receding_fenicsx.bulk.stack import Bodies, Stack
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.model import INTERFERENCE

Side = tuple[Bulk | HalfPlane, Array | None, Array | None]
"""A body with its own load factors and contact displacements, on rank 0."""


def sides_of(bulk: Bodies, load: Array | None, u: Array | None) -> list[Side]:
    """Return each body with its own load factors and contact displacements.

    Args:
        bulk: the body or bodies; several are condensed by then.
        load: (n_loads,) load factors; only rank 0's are used.
        u: (2N,) contact displacements [v; w], between bodies the first one's less the second
            one's, with an interference as in the record; only rank 0's are used.

    Returns:
        Each body.
    """
    if bulk.comm.rank == 0:
        load, u = _true(bulk, np.asarray(load, float), np.asarray(u, float))
    if not isinstance(bulk, Stack):
        return [(bulk, load, u)]
    sides: list[Side] = [(part, None, None) for part in bulk.parts]
    if bulk.joined is not None and load is not None and u is not None:
        apart = np.where(bulk.joined.held, 0.0, u)
        factors, names = load, bulk.load_names + bulk.link_names
        if bulk.joined.links is not None:
            T, G = bulk.joined.links
            factors = np.concatenate([load, T @ load + G @ apart])
        for k, part in enumerate(bulk.parts):
            own = [names.index(name) for name in part.load_names]
            sides[k] = part, factors[own], bulk.joined.displacement(k, apart, load)
    return sides


def _true(bulk: Bodies, load: Array, u: Array) -> tuple[Array, Array]:
    """Return the factors of what acts on the bodies, and the true contact displacements."""
    if INTERFERENCE in bulk.scene.preloads:
        held = given(bulk.joined).held if isinstance(bulk, Stack) else bulk.contact.held
        shift = given(interference_shift(bulk.scene, bulk.contact, held))
        load, u = load[:-1], u + load[-1] * shift
    if bulk.scene.bolts:
        T, G = law_of(bulk)
        load = T @ load + G @ u
    return load, u


def law_of(bulk: Bodies) -> tuple[Array, Array]:
    """Return what turns the shortenings of a condensed body's bolts into forces, on rank 0."""
    if isinstance(bulk, Stack):
        return bolt_law(bulk.scene, given(bulk.joined))
    assert isinstance(bulk, Bulk)
    return given(bulk.law)


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
