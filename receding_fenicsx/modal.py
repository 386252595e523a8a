r"""Vibration modes of a preloaded joint, and the load $M \phi$ that drives one quasi-statically.

After the preload the nodes in contact are tied, in normal direction and, with friction, along the
contact; open nodes are free. With A and M of the whole bodies and ties T,

$$T^T A T y = \omega^2\, T^T M T y , \qquad \phi = T y , \qquad \phi \cdot M \phi = 1 .$$

Under the load $\alpha M \phi$ the displacement is $q = \phi \cdot M (u - u_{preload})$, and

$$\omega^2(\alpha) = \alpha / q , \qquad \zeta(\alpha) = \frac{D}{2 \pi\, \omega^2 q^2}$$

(quasi-static modal analysis, Lacayo & Allen 2019). For small $\alpha$, $\omega$ is the linear one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import ArpackError, eigsh

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx, stack
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.contact_operator import eliminate
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.stack import Stack
from receding_fenicsx.errors import InputError, NotConverged, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.histories import tightened
from receding_fenicsx.evolution.problem import with_profiles
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.history import History, history_from_scene
from receding_fenicsx.scene.model import OutputOptions, Scene
from receding_fenicsx.timing import Timer


def mode_number(drive: str) -> int:
    """Return the number of the mode that a drive such as "mode:1" names, 0 if it is a load."""
    kind, _, number = drive.partition("mode:")
    if kind or not drive:
        return 0
    if not number.isdigit() or int(number) < 1:
        raise InputError(f'drive: "{drive}" is no mode; modes are mode:1, mode:2 and so on')
    return int(number)


def preload_path(system: ContactSystem, scene: Scene, drive: str) -> Array:
    """Return the load factors (k, n_loads) of a scene from rest to its preload."""
    path = history_from_scene(tightened(system, scene)).path
    return path[path[:, system.load_names.index(drive)] == 0.0]


def mode_system(scene: Scene) -> tuple[ContactSystem, Array]:
    """Condense the whole bodies of a scene with a load ``mode`` M phi, the inertia force of a mode.

    The contact is tied as it is under the preloads and ``history.constant``. Returned are the
    system and the angular frequencies up to this mode, ``[mode] count`` at least. There may be no
    such mode (InputError), or no equilibrium of the preload (SolveError).
    """
    load = next(load for load in scene.loads if load.mode is not None)
    bulk: Any = bulk_of(scene, MPI.COMM_SELF, Timer(None))
    try:
        # so far without the load
        system = with_profiles(scene, given(stack.condense(bulk)))
        path, closed = preload_path(system, scene, load.name), system.g0 <= 0.0
        if len(path) > 1:
            history = History(system.load_names, path, np.zeros((0, path.shape[1])))
            record = evolve(system, history, scene.solver, OutputOptions(1, ()))
            closed = record.turning_points.state[-1] != State.SEPARATION
        # along t only with friction
        tied = np.concatenate([closed & system.law.present, closed])
        number = load.mode or 0
        phi, omega = _modes(bulk, tied, number, scene.mode.count)
        for part, force in zip(bulk.parts, phi, strict=True):
            part.loads[:, part.load_names.index(load.name)] = force
        bulk.condensed = False
        driven = given(stack.condense(bulk))
        # the tied contact has to give q = alpha / omega^2 under the mode's load
        k, free = driven.load_names.index(load.name), np.flatnonzero(~(tied | driven.held))
        r_star = driven.r_star[k, free]
        moved = np.linalg.lstsq(driven.K[np.ix_(free, free)], r_star, rcond=None)[0]
        compliance = driven.load_compliance[k, k] + r_star @ moved
        error = abs(1.0 - omega[number - 1] ** 2 * compliance)
        if not error <= 1e-6:
            raise SolveError(
                f"the mode's compliance is off by {error:.1e} from 1 / omega^2 (at most "
                "1e-06): the mode does not see all that holds the bodies"
            )
        keys = ("f", "f_backward", "cohesion", "shear_limit", "g0", "scene_toml")
        return replace(driven, **{key: getattr(system, key) for key in keys}), omega
    finally:
        bulk.destroy()


def _modes(
    bulk: Stack, tied: NDArray[np.bool_], number: int, count: int
) -> tuple[list[Array], Array]:
    """Return M phi of each part for one mode, and the lowest angular frequencies."""
    whole = assembled(bulk)
    A, M, fixed, locals_ = whole.A, whole.M, whole.fixed.copy(), whole.contact
    # the relative displacements that vanish: of tied contact points, and of [[tie]]
    relative = bulk.relative
    gone = np.concatenate([tied, np.ones(len(relative.joint) - relative.size, dtype=bool)])
    own = np.concatenate(locals_)
    rows = relative.of(gone)
    _, Y, rest, _ = eliminate(rows, fixed[own], [A.diagonal()[part] for part in locals_])
    fixed[own] = True
    inner = np.flatnonzero(~fixed)
    free = np.concatenate([inner, own[rest]])
    n, m = len(inner), len(rest)
    Y = Y.tocoo()
    at = np.concatenate([inner, own[Y.row]]), np.concatenate([np.arange(n), n + Y.col])
    T = sparse.csr_matrix((np.concatenate([np.ones(n), Y.data]), at), (len(fixed), n + m))
    K, m = T.T @ A @ T, T.T @ M @ T
    if not number < len(free):
        raise InputError(f"drive: the bodies have fewer than {number} modes")
    count = min(max(count, number), len(free) - 1)
    ratio = K.diagonal().sum() / m.diagonal().sum()
    # A may be singular
    shift = -1e-12 * ratio
    try:
        squares, y = eigsh(K.tocsc(), count, m.tocsc(), sigma=shift, v0=np.ones(len(free)))
    except ArpackError as error:
        raise NotConverged(f"drive: the vibration modes were not found ({error})") from error
    order = np.argsort(squares)
    # the square of the frequency of a rigid motion is round-off
    if squares[order[number - 1]] <= 1e-11 * ratio:
        raise InputError(f"drive: mode {number} moves the bodies rigidly; add a [[support]]")
    phi = whole.turn @ (M @ (T @ y[:, order[number - 1]]))
    omega = np.sqrt(np.maximum(squares[order], 0.0))
    return np.split(phi, whole.starts[1:-1]), omega


@dataclass(frozen=True)
class Assembled:
    """Matrices of all bodies; displacements of contact nodes are along and away from the edges."""

    # A, M: (dofs, dofs) stiffness, with elastic bolts and springs between bodies, and mass
    A: sparse.csr_matrix
    M: sparse.csr_matrix
    turn: sparse.csr_matrix  # (dofs, dofs) nodal displacements x, y from these
    starts: NDArray[np.intp]  # where the freedoms of each body begin, and their number
    contact: list[NDArray[np.intp]]  # of each body, the freedoms [v; w] of its contact nodes
    fixed: NDArray[np.bool_]  # (dofs,) freedoms that supports, symmetry or platens hold


def assembled(bulk: Stack) -> Assembled:
    """Assemble the matrices of all bodies of a scene with densities, on one process."""
    parts: Any = bulk.parts
    A = sparse.block_diag([_csr(part.stiffness) * part.young for part in parts], "csr")
    # unit loads (dofs, m) of bolts and springs between bodies, and their compliance
    at, soft = bulk.links()
    L = sparse.csr_matrix(np.vstack([part.loads[:, at] for part in parts]))
    A = A + L @ sparse.csr_matrix(np.linalg.inv(soft)) @ L.T
    M = sparse.block_diag([_mass(part) for part in parts], "csr")
    starts = np.cumsum([0, *(part.dofs for part in parts)])
    turns, contact, fixed = [], [], np.zeros(A.shape[0], dtype=bool)
    for part, start in zip(parts, starts, strict=False):
        n, nodes = len(part.contact.node), part.contact
        turn = sparse.eye(part.dofs, format="lil")
        turn[np.ix_(nodes.dofs, nodes.dofs)] = nodes.to_global(np.eye(2 * n))
        turns.append(turn)
        contact.append(start + nodes.dofs)
        fixed[start + part.fixed] = True
        fixed[contact[-1][nodes.held]] = True
    turn = sparse.block_diag(turns, "csr")
    return Assembled(turn.T @ A @ turn, turn.T @ M @ turn, turn, starts, contact, fixed)


def _csr(matrix: Any) -> sparse.csr_matrix:
    """Return a PETSc matrix of one process as one of SciPy."""
    start, columns, values = matrix.getValuesCSR()
    return sparse.csr_matrix((values, columns, start), shape=matrix.getSize())


def _mass(part: Bulk) -> sparse.csr_matrix:
    """Return the mass matrix of a body, reduced like its stiffness where there are platens."""
    u, v = ufl.TrialFunction(part.space), ufl.TestFunction(part.space)
    radius = ufl.SpatialCoordinate(part.space.mesh)[0] if part.scene.axisymmetric else 1.0
    density: Any = 1.0
    if part.body.materials is not None:
        densities = np.array([material.density for material in part.scene.materials])
        tensor = densities[part.body.materials][:, None, None]
        density = _dolfinx.cell_tensor(part.space.mesh, tensor)[0, 0]
    matrix = _dolfinx.assemble_matrix(density * radius * ufl.inner(u, v) * ufl.dx)
    M = _csr(matrix) * (part.scene.material.density if part.body.materials is None else 1.0)
    matrix.destroy()
    P = None if part.ties is None else _csr(part.ties)
    return M if P is None else P.T @ M @ P
