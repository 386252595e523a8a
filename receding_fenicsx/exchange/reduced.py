r"""Reduced model of a joint for dynamics codes: mass, stiffness and contact (Craig & Bampton 1968).

The coordinates are $q = [q_b, \eta]$: the displacements of all contact nodes of all bodies that
nothing holds, each along its edge and away from the plane, and the amplitudes of the lowest modes
with these held. With the interior freedoms i of the bodies,

$$u_i = -A_{ii}^{-1} A_{ib}\, q_b + \Phi\, \eta , \qquad
  A_{ii} \Phi = M_{ii} \Phi\, \Omega^2 , \qquad \Phi^T M_{ii} \Phi = 1 ,$$

$$M \ddot q + K q = C^T r + \sum_k \lambda_k f_k , \qquad u = C q ,$$

where $u = [v; w]$ and $r = [Q; P]$ are relative displacements and reactions at the contact nodes,
as in the rest of the package. K has no coupling of $q_b$ and $\eta$.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import ArpackError, eigsh, splu

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import check_file
from receding_fenicsx.bulk import stack
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.errors import InputError, NotConverged
from receding_fenicsx.evolution.problem import with_profiles
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.modal import Assembled, assembled
from receding_fenicsx.mpi import given
from receding_fenicsx.scene.checks import broken, refuse
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.scene.validate import validate
from receding_fenicsx.scene.validate_loads import of_modes
from receding_fenicsx.store.hdf5 import new_hdf5, write_all
from receding_fenicsx.timing import Timer


@dataclass(frozen=True)
class ReducedModel:
    """M q'' + K q = C^T r + sum lambda_k f_k, u = C q, with the contact law between u and r.

    Lengths, forces and masses are those of the scene, for unit thickness in the plane, per
    radian on bodies of revolution.

    Attributes:
        M, K: (m, m) mass and stiffness; the first coordinates are displacements of contact nodes,
            the last ones amplitudes of modes with these held, of mass 1.
        C: (2N, m) relative displacements [v; w] of the contact nodes from the coordinates.
        loads: (n_loads, m) forces of the loads with factor 1.
        load_names: names of the loads.
        omega: (k,) angular frequencies of the modes with the contact nodes held.
        points: (N, 2) contact nodes.
        weight: (N,) length of the contact that belongs to each.
        f, f_backward: (N,) coefficients of friction for forward and backward slip.
        g0: (N,) initial gaps.
    """

    M: Array
    K: Array
    C: Array
    loads: Array
    load_names: tuple[str, ...]
    omega: Array
    points: Array
    weight: Array
    f: Array
    f_backward: Array
    g0: Array

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the model as HDF5 with a description."""
        with new_hdf5(Path(path), overwrite, "receding_fenicsx reduced model") as file:
            write_all(file, self)
            file.attrs["description"] = inspect.getdoc(ReducedModel) or ""


def reduced_model(scene: Scene) -> ReducedModel:
    """Reduce the whole bodies of a scene to their contact nodes and modes; one process.

    Raises:
        InputError: a body has no density or no mesh, a load prescribes displacements, there are
            bolts or driven gaps, or the bodies have fewer freedoms.
        NotConverged: the modes were not found.
    """
    validate(scene)
    refuse(broken([of_modes(scene, "reduced model")]))
    if scene.preloads or any(load.gap is not None for load in scene.loads):
        raise InputError("reduced model: has no gaps, bolts and interference; remove them")
    if scene.ties:
        raise InputError("reduced model: ties are not in it; make the tied bodies one mesh")
    scene = replace(scene, solver=replace(scene.solver, symmetry="none"))
    bulk: Any = bulk_of(scene, MPI.COMM_SELF, Timer(None))
    try:
        for part in bulk.parts:
            for name in np.array(part.load_names)[part.sign > 0.0]:
                raise InputError(f"load '{name}': prescribes a displacement; reduce it as a force")
        whole = assembled(bulk)
        # nodal forces (n_loads, dofs) on the turned freedoms; those of springs come last
        forces = (whole.turn.T @ np.vstack([part.loads for part in bulk.parts])).T
        forces = forces[: len(scene.driven_names)]
        system = with_profiles(scene, given(stack.condense(bulk)))
        # from all freedoms to the relative displacements [v; w]
        on = sparse.hstack([G[: bulk.relative.size] for G in bulk.relative.on]).tocoo()
        at = on.row, np.concatenate(whole.contact)[on.col]
        C = sparse.csr_matrix((on.data, at), shape=(2 * system.n, len(whole.fixed)))
        return _reduced(scene, whole, C, forces, system)
    finally:
        bulk.destroy()


def _reduced(
    scene: Scene, whole: Assembled, C: sparse.csr_matrix, forces: Array, system: ContactSystem
) -> ReducedModel:
    """Return the model, from C (2N, dofs) and the forces (n_loads, dofs) of the loads."""
    b, count = np.concatenate(whole.contact), scene.mode.count
    b = b[~whole.fixed[b]]
    inner = ~whole.fixed
    inner[b] = False
    i = np.flatnonzero(inner)
    if not count < len(i):
        raise InputError(f"[mode] count: the bodies have {len(i)} inner freedoms; ask for fewer")
    A, M = whole.A.tocsc(), whole.M.tocsc()
    A_ii, M_ii = A[i][:, i], M[i][:, i]
    static = -splu(A_ii).solve(A[i][:, b].toarray())
    try:
        squares, phi = eigsh(A_ii, count, M_ii, sigma=0.0, v0=np.ones(len(i)))
    except ArpackError as error:
        raise NotConverged(f"[mode] count: the modes were not found ({error})") from error
    T = np.zeros((A.shape[0], len(b) + count))
    T[b, np.arange(len(b))] = 1.0
    T[np.ix_(i, np.arange(len(b)))], T[i, len(b) :] = static, phi[:, np.argsort(squares)]
    K, mass = T.T @ (A @ T), T.T @ (M @ T)
    return ReducedModel(
        M=0.5 * (mass + mass.T),
        K=0.5 * (K + K.T),
        C=C @ T,
        loads=forces @ T,
        load_names=scene.driven_names,
        omega=np.sqrt(np.sort(squares)),
        points=system.points,
        weight=system.weight,
        f=system.friction.forward,
        f_backward=system.friction.backward,
        g0=system.g0,
    )


def export_reduced(source: Path, out: Path, overwrite: bool) -> None:
    """Write the reduced model of a scene."""
    check_file(out, overwrite)
    model = reduced_model(read_scene(source))
    model.save(out, overwrite)
    found = ", ".join(f"{omega:.6g}" for omega in model.omega)
    modes = f"modes with the contact held at omega = {found}"
    print(f"{len(model.M)} coordinates, {len(model.g0)} contact nodes, {modes}, written to {out}")
