"""Contact system from the matrices of another program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy import io, sparse
from scipy.sparse.linalg import splu

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import check_file, read_text
from receding_fenicsx.bulk.rigid_motions import motions, scaled
from receding_fenicsx.errors import InputError
from receding_fenicsx.exchange.formats import Freedom, read_matrix, read_vector
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.system_checks import UNSYMMETRIC, check_system
from receding_fenicsx.scene import profiles
from receding_fenicsx.scene.checks import Number, OneOf, Pair, Table, as_list
from receding_fenicsx.scene.profiles import FrictionProfile, Profile
from receding_fenicsx.scene.toml_reader import Place, convert, parse_toml
from receding_fenicsx.store.hdf5 import read_system, write_system
from receding_fenicsx.store.run_folder import SYSTEM, write_csv
from receding_fenicsx.store.workspace import FolderKind


@dataclass(frozen=True)
class Edge(Table):
    """Straight contact edge: its nodes, the normal into the body, and the law.

    ``weights`` are the lengths that the nodes stand for; default: half of those to the neighbours.
    """

    nodes: tuple[Number, ...]
    normal: Pair
    friction: FrictionProfile = 0.35
    initial_gap: Profile = 0.0
    weights: tuple[Number, ...] = ()
    name: str = "contact"


@dataclass(frozen=True)
class Fixed(Table):
    """Nodes that are held in "x", "y" or "xy"."""

    nodes: tuple[Number, ...]
    fix: Annotated[str, OneOf("x", "y", "xy")]


@dataclass(frozen=True)
class NodalLoad(Table):
    """Load: a file of nodal forces on the body, or of r*, which hold the contact against them."""

    name: str
    forces: str = ""
    reactions: str = ""


@dataclass(frozen=True)
class Specification(Table):
    """Files, their order of rows, the number of rigid motions that are left free, and tables.

    The rows of a MatrixMarket file are x and y of one node after the other (``order`` "nodes"), or
    x of all nodes, then y ("components").
    """

    stiffness: str
    nodes: str
    free: int
    order: Annotated[str, OneOf("nodes", "components")] = "nodes"
    title: str = ""
    contact: tuple[Edge, ...] = ()
    support: tuple[Fixed, ...] = ()
    load: tuple[NodalLoad, ...] = ()

    @property
    def fixed(self) -> set[Freedom]:
        """Freedoms that supports hold."""
        return {(int(n), "xy".index(a) + 1) for s in self.support for n in s.nodes for a in s.fix}


def read_specification(path: Path) -> tuple[Specification, dict[int, Array]]:
    """Read a specification, and the coordinates of its nodes by their numbers."""
    raw, tables = parse_toml(read_text(path)), ("contact", "support", "load")
    raw |= {name: as_list(raw[name], name) for name in tables if name in raw}

    def label(place: Place) -> tuple[str, Place]:
        inside = len(place) > 1 and place[0] in tables
        return (f"[[{place[0]}]]", place[2:]) if inside else ("specification", place)

    given: Specification = convert(Specification, raw, label)
    names = [load.name for load in given.load]
    if not given.contact or not names or len(set(names)) < len(names):
        raise InputError("needs a [[contact]], and [[load]] tables with names of their own")
    for load in given.load:
        if bool(load.forces) == bool(load.reactions):
            raise InputError(f"load '{load.name}': give either forces or reactions")
    wanted = ("node", "x", "y")
    columns = profiles.read_columns(given.nodes, path.parent, "nodes", wanted, wanted)
    if len(columns.names) != 3:
        columns.refuse(f"has {len(columns.names)} column(s), not node, x, y")
    points = {int(row[0]): row[1:] for row in columns.values}
    if len(points) < len(columns.values) or np.any(columns.values[:, 0] % 1.0):
        columns.refuse("the numbers of the nodes have to be whole and different")
    return given, points


def import_system(path: str | Path) -> ContactSystem:
    """Return the contact system that a specification describes (``docs/exchange.md``).

    Raises:
        InputError: a file cannot be read or does not fit the others; the stiffness is not
            symmetric, is indefinite, or leaves other motions free than the specification says.
    """
    try:
        return _system(*read_specification(Path(path)), Path(path).parent)
    except InputError as error:
        raise InputError(f"{path}: {error}".replace(f"{path}: {path}: ", f"{path}: ")) from None


def _system(given: Specification, points_of: dict[int, Array], folder: Path) -> ContactSystem:
    """Eliminate, turn to the contact's directions, and check."""
    A, freedoms = read_matrix(folder / given.stiffness)
    if freedoms is None:
        freedoms = [(node, k) for node in points_of for k in (1, 2)]
        freedoms = sorted(freedoms, key=lambda one: one[1] * (given.order == "components"))
    _check_matrix(A, freedoms)
    edges = [_along(edge, points_of) for edge in given.contact]
    nodes, x, weight, normal = map(np.concatenate, zip(*edges, strict=True))
    if len(np.unique(nodes)) < len(nodes):
        raise InputError("[[contact]] nodes: a node is named twice")
    C = [(int(node), k) for k in (1, 2) for node in nodes]
    K, r_star, compliance = _eliminate(A, freedoms, C, given, folder)
    nx, ny = np.diag(normal[:, 0]), np.diag(normal[:, 1])
    turn = np.block([[ny, -nx], [nx, ny]])  # from [x; y] to [t; n]
    K, r_star = turn @ K @ turn.T, r_star @ turn.T
    # supports hold the directions of [v; w] that no free one has a part in, but for round-off
    is_fixed, part = np.array([freedom in given.fixed for freedom in C]), np.abs(turn) > 1e-6
    held = np.asarray(part @ is_fixed & ~(part @ ~is_fixed))
    if np.count_nonzero(held) < np.count_nonzero(is_fixed):
        raise InputError("[[support]]: holds a contact node oblique to its normal; hold xy there")
    points = np.array([points_of[int(node)] for node in nodes])
    size = float(np.ptp(points, axis=0).max()) or 1.0
    moved = motions(points, points.mean(axis=0), size).transpose(1, 0, 2).reshape(-1, 3)
    edge = np.repeat(np.arange(len(edges)), [len(part[0]) for part in edges])
    law = np.zeros((3, len(x)))
    for k, one in enumerate(given.contact):
        on = edge == k
        for row, profile in enumerate((*profiles.directions(one.friction), one.initial_gap)):
            law[row, on] = profiles.evaluate_checked(profile, x[on], None, f"contact '{one.name}'")
    law[:2, held[len(x) :]] = 0.0  # the support carries the normal force there
    f, f_backward, g0 = law
    system = ContactSystem(
        x=x,
        points=points,
        weight=weight,
        K=0.5 * (K + K.T),
        r_star=r_star,
        load_names=tuple(load.name for load in given.load),
        f=f,
        g0=g0,
        held=held,
        rigid=_rigid(K, held, turn @ moved, given.free),
        load_compliance=compliance,
        load_sign=-np.ones(len(given.load)),
        edge=edge,
        edge_names=tuple(e.name for e in given.contact),
        f_backward=None if np.array_equal(f, f_backward) else f_backward,
    )
    check_system(system)
    return system


def _check_matrix(A: sparse.csc_matrix, freedoms: list[Freedom]) -> None:
    """Raise where a stiffness does not fit the freedoms, or is not symmetric."""
    if A.shape[0] != len(freedoms) or not freedoms:
        raise InputError(f"stiffness: has {A.shape[0]} rows for {len(freedoms)} freedoms of nodes")
    if len(set(freedoms)) < len(freedoms) or any(k not in (1, 2) for _, k in freedoms):
        raise InputError("stiffness: freedoms have to be 1 (x) or 2 (y) of a node, each once")
    if not np.all(np.isfinite(A.data)):
        raise InputError("stiffness: has entries that are not finite")
    diagonal = np.abs(A.diagonal())
    share = diagonal / (diagonal.max() or 1.0)
    # diagonal entry over their median that is no stiffness but a support
    if 1e15 * np.median(np.append(share[share > 0.0], 0.0)) < share.max():
        supports = "which stand for supports; export it without them, and name them by [[support]]"
        raise InputError(f"stiffness: has entries of {diagonal.max():.0e}, {supports}")
    if abs(A - A.T).max() > UNSYMMETRIC * abs(A).max():
        raise InputError("stiffness: is not symmetric")


def _along(edge: Edge, points_of: dict[int, Array]) -> tuple[Array, Array, Array, Array]:
    """Return nodes sorted along t = (n_y, -n_x), positions from the middle, weights, normals."""
    label = f"contact '{edge.name}'"
    lost = [node for node in edge.nodes if node not in points_of]
    if lost or not edge.nodes:
        which = f"node {lost[0]:g} is not in the file of the nodes" if lost else "has no nodes"
        raise InputError(f"{label}: {which}")
    length = float(np.hypot(*edge.normal))
    if not length > 0.0:
        raise InputError(f"{label} normal: must not be zero")
    n = np.array(edge.normal) / length
    points = np.array([points_of[int(node)] for node in edge.nodes])
    order = np.argsort(points @ [n[1], -n[0]])
    x = (points @ [n[1], -n[0]])[order]
    x = x - 0.5 * (x[0] + x[-1])
    # up to a millionth of its length the edge is straight
    if np.any(np.diff(x) <= 0.0) or np.ptp(points @ n) > 1e-6 * (x[-1] - x[0]):
        raise InputError(f"{label}: its nodes are not on a line across the normal, or coincide")
    weight = np.ones(1)
    if len(x) > 1:
        weight = 0.5 * (np.diff(x, append=x[-1]) + np.diff(x, prepend=x[0]))
    if edge.weights:
        if len(edge.weights) != len(x) or min(edge.weights) < 0.0:
            raise InputError(f"{label} weights: must be {len(x)} numbers that are not negative")
        weight = np.array(edge.weights)[order]
    return np.array(edge.nodes)[order], x, weight, np.tile(n, (len(x), 1))


def _eliminate(
    A: sparse.csc_matrix,
    freedoms: list[Freedom],
    C: list[Freedom],
    given: Specification,
    folder: Path,
) -> tuple[Array, Array, Array]:
    """Return K (2N, 2N), r* (n_loads, 2N), both [x; y], and the compliance of the loads."""
    place = {freedom: i for i, freedom in enumerate(freedoms)}
    for node, k in [*(c for c in C if c not in given.fixed), *(given.fixed - set(C))]:
        if (node, k) not in place:
            hold = "retain it there, or hold it by a [[support]] if it is of the contact"
            raise InputError(f"node {node} has no freedom {k} in the stiffness: {hold}")
    here = np.flatnonzero([c in place for c in C])
    own = [place[C[i]] for i in here]
    inside = [i for i, freedom in enumerate(freedoms) if freedom not in given.fixed | set(C)]
    for load in given.load:
        if load.reactions and inside:
            raise InputError(f"load '{load.name}' reactions: needs a matrix of contact nodes alone")
    f = np.zeros((len(freedoms), len(given.load)))
    for load, column in zip(given.load, f.T, strict=True):
        column[:] = read_vector(folder / (load.forces or load.reactions), freedoms)
        column *= 1.0 if load.forces else -1.0
        if not column.any():
            raise InputError(f"load '{load.name}': its file has no force; fill it, or remove it")
    K, r_star = np.zeros((len(C), len(C))), np.zeros((f.shape[1], len(C)))
    K[np.ix_(here, here)] = A[own][:, own].toarray()
    r_star[:, here] = -f[own].T
    compliance = np.zeros((f.shape[1], f.shape[1]))
    if inside:
        inner = A[inside][:, inside].tocsc()
        try:  # without pivoting, all pivots of a positive definite matrix are positive
            symmetric = {"SymmetricMode": True}
            factor = splu(inner, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
        except RuntimeError:
            raise InputError("stiffness: is singular with the contact held") from None
        smallest, same = factor.U.diagonal().min(), np.all(factor.perm_r == factor.perm_c)
        if not same or smallest <= 1e-10 * abs(inner).max():  # round-off of zero
            raise InputError("stiffness: is indefinite or singular with the contact held")
        across = A[inside][:, own].toarray()
        moved = factor.solve(f[inside])
        K[np.ix_(here, here)] -= across.T @ factor.solve(across)
        r_star[:, here] += moved.T @ across
        compliance = f[inside].T @ moved
    return K, r_star, 0.5 * (compliance + compliance.T)


def _rigid(K: Array, held: NDArray[np.bool_], moved: Array, free: int) -> Array:
    """Return the rigid motions that K does not resist; refuse a K that is not semidefinite."""
    largest = float(np.abs(K).max(initial=0.0))
    none = 1e-10  # stiffness against a motion, over the largest, that is the round-off of zero
    if not largest > 0.0:
        raise InputError("stiffness: is zero at the contact")
    resisted = np.vstack([np.where(held[:, None], moved, K @ moved / largest), np.zeros((3, 3))])
    _, size, right = np.linalg.svd(resisted, full_matrices=False)
    # a larger size resists the motion; what is between cannot be judged
    if np.any((size > none) & (size < 1e-7)):
        raise InputError("stiffness: has too few digits to tell which rigid motions are free")
    motion = moved @ right[size <= none].T
    # the rotation of a single node is none
    motion = scaled(motion[:, np.abs(motion).max(axis=0, initial=0.0) > none])
    if motion.shape[1] != free:
        left = f"stiffness and supports leave {motion.shape[1]} rigid motion(s) free"
        raise InputError(f"free = {free}: {left}; check signs and order of rows, and the supports")
    values = np.linalg.eigvalsh(K[np.ix_(~held, ~held)])
    if np.any(values < -none * largest):
        raise InputError(f"stiffness: is indefinite, with an eigenvalue of {values[0]:.3g}")
    if np.count_nonzero(values <= none * largest) > free:
        raise InputError("stiffness: does not resist a motion that is not rigid")
    return motion


def import_file(specification: str, out: str, overwrite: bool) -> None:
    """Import a system, save it and print what it is."""
    path = Path(out)
    check_file(path, overwrite)
    system = import_system(specification)
    write_system(path, system, overwrite)
    loads = zip(system.load_names, system.r_star[:, system.n :].sum(axis=1), strict=True)
    told = ", ".join(f"{name} (pressed by {P:.6g})" for name, P in loads)
    free = system.rigid.shape[1]
    print(f"{system.n} contact nodes, {free} rigid motion(s), {told}, written to {path}")


def export_matrices(source: Path, out: Path, overwrite: bool) -> None:
    """Write K (rows [v; w]), r* (a row a load) and rigid motions as MatrixMarket, nodes as CSV."""
    kind = FolderKind("set of matrices", ("stiffness.mtx",), resumable=False)
    kind.check(out, overwrite)
    system = read_system(source / SYSTEM if source.is_dir() else source)
    matrices = {"stiffness": system.K, "r_star": system.r_star, "rigid": system.rigid}
    law, held = system.friction, system.held.reshape(2, -1).astype(int)
    columns = (system.x, *system.points.T, system.weight, law.forward, law.backward, system.g0)
    names = "x px py weight f_forward f_backward gap held_v held_w".split()
    with kind.new(out, overwrite) as beside:
        for name, matrix in matrices.items():
            symmetry = "symmetric" if name == "stiffness" else "general"
            text = f"{name} of [v; w]; loads {', '.join(system.load_names)}"
            io.mmwrite(beside / f"{name}.mtx", matrix, text, precision=17, symmetry=symmetry)
        write_csv(beside / "nodes.csv", dict(zip(names, (*columns, *held), strict=True)))
    print(f"{system.n} contact nodes, {len(system.load_names)} load(s), written to {out}")
