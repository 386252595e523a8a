"""Static condensation of the body onto its contact nodes (eqs. 11 and 12).

With the contact C and the interior I, and forces r of the plane on the body,

    K = A_CC - A_CI A_II^-1 A_IC,    r*_k = A_CI A_II^-1 f_k,I - f_k,C.

MUMPS forms K during its Cholesky factorisation of A (route "schur"), on any number of ranks. Route
"solve" needs nothing but a factorisation of A_II and is slower: a fallback and a check.

A mirror-symmetric whole body is condensed as it is. Two half-body problems (u_x = 0, then u_y = 0
on the axis) would take 40 % less time and a third less memory, but with 2561 contact nodes that is
0.2 s of 0.5 s and 0.3 GB of 0.8 GB, little beside what is then done with 2N = 5122 unknowns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.bulk import schur
from receding_fenicsx.bulk.body import (
    Bulk,
    constrained,
    gather_contact,
    interior_solver,
    owned_contact,
)
from receding_fenicsx.bulk.join_bodies import Reduced
from receding_fenicsx.bulk.symmetric_matrix import norm, symmetrise, turn
from receding_fenicsx.bulk.two_bodies import Pair, join_pair
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import to_toml

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]
"""Solves A_II x_I = b_I for the columns of b, each rank giving its own rows; the rest of x is 0."""

RIGID_TOLERANCE = 1e-12
"""Largest force of a rigid motion over the largest row sum of |K|."""
PROBE_TOLERANCE = 1e-10
"""Largest error of K times a probe, found by a solve, over the largest row sum of |K|."""
BLOCK = 64
"""Right-hand sides solved for together."""


def condense(bulk: Bulk | Pair, route: str = "schur") -> ContactSystem | None:
    """Condense the body, or two bodies, to the contact nodes.

    Args:
        bulk: the discretised body or bodies.
        route: "schur" or "solve".

    Returns:
        The condensed system on rank 0, None on the others. Its friction and gap are NaN:
        :func:`receding_fenicsx.evolution.prepare.with_profiles` sets them.

    Raises:
        SolveError: the factorisation failed, or K does not keep the rigid motions or does not agree
            with a solve; on all ranks.
    """
    if isinstance(bulk, Pair):
        condense_pair(bulk, route)
        return on_root(bulk.comm, lambda: _pair_system(bulk))
    reduced = _reduce(bulk, route)
    return on_root(bulk.comm, lambda: _system(bulk, reduced))


def condense_pair(pair: Pair, route: str = "schur") -> None:
    """Condense both bodies of a pair, unless they are already, and join them; on all ranks."""
    if not pair.condensed:
        first, second = pair.parts
        join_pair(pair, (_reduce(first, route), _reduce(second, route)))


@dataclass(frozen=True)
class Condensed:
    """What a route gives, in [x; y] components and for E = 1; arrays of the contact on rank 0 only.

    Attributes:
        K: (2N, 2N) stiffness, symmetric to the last bit.
        held: (2N, n_loads) reactions r* to the loads, all contact nodes held.
        compliance: (n_loads, n_loads) what is work-conjugate to load k under load l, contact nodes
            held: its displacement, or E times the force that a prescribed displacement takes.
        probe: contact displacements u and the forces K u, found by a solve.
    """

    K: Array | None
    held: Array | None
    compliance: Array
    probe: tuple[Array, Array] | None = None


def _reduce(bulk: Bulk, route: str) -> Reduced | None:
    """Condense one body; its stiffness and reactions on rank 0, None on the others."""
    if route not in ("schur", "solve"):
        raise InputError(f'route = \'{route}\' is unknown; use "schur" or "solve"')
    condensed = _by_schur(bulk) if route == "schur" else _by_solves(bulk)
    return on_root(bulk.comm, lambda: _checked(bulk, condensed))


def _checked(bulk: Bulk, condensed: Condensed) -> Reduced:
    """Turn components, check, scale by Young's modulus; on rank 0."""
    contact = bulk.contact
    assert condensed.K is not None and condensed.held is not None
    K = condensed.K
    turn(K, contact.to_local)
    scale = norm(K)
    if condensed.probe is not None:
        u, force = (contact.to_local(part) for part in condensed.probe)
        error = np.abs(K @ u - force).max() / (scale * np.abs(u).max())
        if not error <= PROBE_TOLERANCE:
            raise SolveError(
                f"the condensed stiffness is off by {error:.1e} from a solve (at most "
                f"{PROBE_TOLERANCE:g}): move Poisson's ratio off its limit, or mend the mesh"
            )
    error = np.abs(K @ contact.null).max(initial=0.0) / scale
    if not error <= RIGID_TOLERANCE:
        raise SolveError(
            f"the condensed stiffness resists a rigid motion by {error:.1e} of its size "
            f"(at most {RIGID_TOLERANCE:g}); check the mesh for degenerate cells"
        )
    K *= bulk.young
    return Reduced(
        K=K,
        r_star=contact.to_local(condensed.held).T.copy(),
        compliance=condensed.compliance / bulk.young,
        sign=_load_sign(bulk),
        held=contact.held,
        constraints=contact.constraints,
    )


def _system(bulk: Bulk, reduced: Reduced | None) -> ContactSystem:
    """Add the contact's data to a condensed body; on rank 0."""
    assert reduced is not None
    return ContactSystem(
        K=reduced.K,
        r_star=reduced.r_star,
        load_names=bulk.load_names,
        held=bulk.contact.held,
        rigid=bulk.contact.rigid,
        load_compliance=reduced.compliance,
        load_sign=reduced.sign,
        **_contact_data(bulk, bulk.scene),
    )


def _pair_system(pair: Pair) -> ContactSystem:
    """Add the contact's data to joined bodies; on rank 0."""
    joined = pair.joined
    assert joined is not None
    return ContactSystem(
        K=joined.K,
        r_star=joined.r_star,
        load_names=pair.load_names,
        held=joined.held,
        rigid=joined.rigid,
        load_compliance=joined.compliance,
        load_sign=joined.sign,
        **_contact_data(pair.parts[0], pair.scene),
    )


def _contact_data(bulk: Bulk, scene: Scene) -> dict[str, Any]:
    """Return what a contact system has from the contact nodes of its first body."""
    contact = bulk.contact
    unknown = np.full(len(contact.x), np.nan)
    return {
        "x": contact.x,
        "points": contact.points,
        "weight": contact.weight,
        "f": unknown,
        "g0": unknown.copy(),
        "half": bulk.body.half and not scene.axisymmetric,
        "axisymmetric": scene.axisymmetric,
        "edge": contact.edge,
        "edge_names": _edge_names(scene),
        "scene_toml": to_toml(scene),
    }


def _edge_names(scene: Scene) -> tuple[str, ...]:
    """Return the contact edges' names, numbered where several contacts lie on one edge."""
    names = [contact.edge for contact in scene.contacts]
    return tuple(
        f"{name} {names[: i + 1].count(name)}" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    )


def _load_sign(bulk: Bulk) -> Array:
    """Return -1 for forces, +1 for prescribed displacements."""
    return np.array([1.0 if name in bulk.prescribed else -1.0 for name in bulk.load_names])


def _held_response(bulk: Bulk, solve: Solve) -> tuple[Array | None, Array]:
    """Return the loads' reactions (2N, n_loads; rank 0) and compliance, all contact nodes held."""
    rows = bulk.stiffness.getLocalSize()[0]
    loads = np.zeros((rows, len(bulk.loads)))
    if not bulk.loads:  # MUMPS wants one right-hand side at least
        return gather_contact(bulk, loads), np.zeros((0, 0))
    for column, load in zip(loads.T, bulk.loads, strict=True):
        column[:] = load.getArray(readonly=True)
    x = solve(loads)
    force = _times(bulk.stiffness, x) - loads
    moved = np.zeros_like(loads)
    for k, name in enumerate(bulk.load_names):
        if name in bulk.prescribed:
            moved[:, k] = bulk.young * bulk.prescribed[name].getArray(readonly=True)
    sign = _load_sign(bulk)
    own = np.where(sign[:, None] > 0.0, moved.T @ force, loads.T @ (x + moved))
    compliance = bulk.comm.allreduce(own)
    # symmetric among loads of one sort, antisymmetric between the sorts
    compliance = 0.5 * (compliance + np.outer(sign, sign) * compliance.T)
    return gather_contact(bulk, force), compliance


def _contact_forces(bulk: Bulk, solve: Solve, u: Array, first: int = 0) -> Array | None:
    """Return K u (2N, n; rank 0) by solves.

    Args:
        bulk: the body.
        solve: see ``Solve``.
        u: (m, n) displacements of the contact's degrees of freedom from ``first`` on, the others 0.
        first: see ``u``.
    """
    dofs, places = owned_contact(bulk)
    inside = (places >= first) & (places < first + len(u))
    start, rows = bulk.stiffness.getOwnershipRange()[0], bulk.stiffness.getLocalSize()[0]
    x = np.zeros((rows, u.shape[1]))
    x[dofs[inside] - start] = u[places[inside] - first]
    force = _times(bulk.stiffness, x)
    return gather_contact(bulk, force - _times(bulk.stiffness, solve(force)))


def _times(matrix: PETSc.Mat, columns: Array) -> Array:
    """Multiply a matrix by columns, each rank giving and getting its own rows."""
    right = _dense(matrix, columns)
    left = matrix.matMult(right)
    product = np.array(left.getDenseArray(readonly=True))
    left.destroy()
    right.destroy()
    return product


def _dense(matrix: PETSc.Mat, columns: Array) -> PETSc.Mat:
    """Return columns, of which each rank gives its own rows, as a matrix of PETSc."""
    sizes = (matrix.getSizes()[0], (None, columns.shape[1]))
    dense = PETSc.Mat().createDense(sizes, comm=matrix.comm)
    dense.setUp()
    dense.getDenseArray()[:] = columns
    dense.assemble()
    return dense


def _solver(bulk: Bulk, factor: PETSc.Mat) -> Solve:
    """Return the function that solves with a factor of A_II, or one that can be used as such."""
    off = np.concatenate([bulk.fixed, owned_contact(bulk)[0]])
    off = off - bulk.stiffness.getOwnershipRange()[0]

    def solve(columns: Array) -> Array:
        rhs = _dense(bulk.stiffness, columns)
        rhs.getDenseArray()[off] = 0.0
        rhs.assemble()
        x = rhs.duplicate()
        x.assemble()
        factor.matSolve(rhs, x)
        solution = np.array(x.getDenseArray(readonly=True))
        solution[off] = 0.0
        rhs.destroy()
        x.destroy()
        return solution

    return solve


def _by_schur(bulk: Bulk) -> Condensed:
    """Condense by the Schur complement that MUMPS makes."""
    supported = bulk.comm.allreduce(len(bulk.fixed)) > 0
    matrix = constrained(bulk, bulk.fixed) if supported else bulk.stiffness
    pc, K = schur.factorise(matrix, bulk.contact.dofs)
    factor = pc.getFactorMatrix()
    solve = _solver(bulk, factor)
    held, compliance = _held_response(bulk, solve)
    u = np.cos(1.0 + np.arange(len(bulk.contact.dofs)) ** 2)
    force = _contact_forces(bulk, solve, u[:, None])
    for thing in (factor, pc, *([matrix] if supported else [])):
        thing.destroy()
    return Condensed(K, held, compliance, None if force is None else (u, force[:, 0]))


def _by_solves(bulk: Bulk) -> Condensed:
    """Condense by solves with A_II for blocks of unit displacements."""
    solver = interior_solver(bulk)
    pc = solver.getPC()
    factor = pc.getFactorMatrix()
    solve = _solver(bulk, factor)
    size = len(bulk.contact.dofs)
    K = np.empty((size, size)) if bulk.comm.rank == 0 else None
    for first in range(0, size, BLOCK):
        unit = np.eye(min(BLOCK, size - first))
        columns = _contact_forces(bulk, solve, unit, first)
        if K is not None and columns is not None:
            K[:, first : first + len(unit)] = columns
    if K is not None:
        symmetrise(K)
    held, compliance = _held_response(bulk, solve)
    for thing in (factor, pc, solver):
        thing.destroy()
    return Condensed(K, held, compliance)
