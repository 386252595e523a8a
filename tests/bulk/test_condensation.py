"""The condensed body: against an own assembly, between routes, ranks, halves and units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, ELEMENTS, block, built, condense, everything
from numpy.typing import NDArray

from receding_fenicsx.bulk import elastic_body, schur
from receding_fenicsx.bulk.body import BLOCK_COLUMNS, Bulk, Elimination
from receding_fenicsx.bulk.mesh.meshing import BodyMesh
from receding_fenicsx.errors import SolveError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Body, Contact, Load, Material, Scene, Support

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]

SUPPORTS = ((), (Support("xy", edge="right"),), (Support("x", point=(0.0, 1.0)),))


def system_of(
    scene: Scene, half: bool = False, route: str = "schur", on: MPI.Comm = comm
) -> ContactSystem | None:
    """Condense a scene."""
    bulk = built(scene, half, on)
    system = condense(bulk, route)
    bulk.destroy()
    return system


def off(a: Array, b: Array) -> float:
    """Largest difference over the largest entry."""
    return float(np.abs(a - b).max() / np.abs(b).max())


# An assembly of its own: nodes by coordinates, shape functions by inverting monomials at the nodes.

MONOMIALS = {
    ("triangle", 1): [(0, 0), (1, 0), (0, 1)],
    ("triangle", 2): [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)],
    ("quadrilateral", 1): [(0, 0), (1, 0), (0, 1), (1, 1)],
    ("quadrilateral", 2): [(i, j) for i in range(3) for j in range(3)],
}


def element_nodes(corners: Array, degree: int) -> Array:
    """Nodes of an element from its corners in DOLFINx's order."""
    if degree == 1:
        return corners
    if len(corners) == 3:
        return np.vstack([corners, 0.5 * (corners + np.roll(corners, 1, axis=0))])
    a, b, c, d = corners
    middles = [a + b, a + c, b + d, c + d]
    return np.vstack([corners, 0.5 * np.array(middles), corners.mean(axis=0)])


def quadrature(corners: Array) -> tuple[Array, Array]:
    """Points and weights, exact to degree 4 at least, by Gauss's rule on the square (collapsed)."""
    g, w = np.polynomial.legendre.leggauss(4)
    g, w = 0.5 * (g + 1.0), 0.5 * w
    s, t = (m.ravel() for m in np.meshgrid(g, g))
    weight = np.outer(w, w).ravel()
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    area = abs(first[0] * second[1] - first[1] * second[0])
    if len(corners) == 3:
        s, t, weight = s, t * (1.0 - s), weight * (1.0 - s)
    return corners[0] + np.outer(s, first) + np.outer(t, second), area * weight


def element_stiffness(nodes: Array, corners: Array, cell: str, material: Material) -> Array:
    """Stiffness (2n, 2n), order x1, y1, x2, ..., by B^T D B."""
    powers = MONOMIALS[cell, {3: 1, 6: 2, 4: 1, 9: 2}[len(nodes)]]
    centre, size = corners.mean(axis=0), np.ptp(corners)
    x, y = ((nodes - centre) / size).T
    coefficients = np.linalg.inv(np.array([x**i * y**j for i, j in powers]).T)
    points, weights = quadrature(corners)
    x, y = ((points - centre) / size).T
    dx = np.array([i * x ** max(i - 1, 0) * y**j for i, j in powers]).T @ coefficients / size
    dy = np.array([j * x**i * y ** max(j - 1, 0) for i, j in powers]).T @ coefficients / size
    young, nu = material.young, material.poisson
    # Hooke's law in plane strain, inverted from the compliance
    compliance = (1.0 + nu) / young * np.array([[1 - nu, -nu, 0], [-nu, 1 - nu, 0], [0, 0, 2]])
    law = np.linalg.inv(compliance)
    total = np.zeros((2 * len(nodes), 2 * len(nodes)))
    for gx, gy, weight in zip(dx, dy, weights, strict=True):
        B = np.zeros((3, 2 * len(nodes)))
        B[0, 0::2], B[1, 1::2], B[2, 0::2], B[2, 1::2] = gx, gy, gy, gx
        total += weight * B.T @ law @ B
    return total


def own_condensation(scene: Scene, body: BodyMesh) -> tuple[Array, Array, Array]:
    """x, K and r* of a uniform pressure 1 on the top between x = -1 and 1, densely."""
    corners, cells = everything(body)
    degree, cell = scene.mesh.degree, scene.mesh.cell
    number: dict[tuple[float, float], int] = {}
    found: dict[int, Array] = {}
    elements = []
    for around in cells:
        nodes = element_nodes(corners[around], degree)
        keys = [tuple(np.round(node, 9) + 0.0) for node in nodes]
        elements.append((nodes, [number.setdefault(key, len(number)) for key in keys]))
        found |= dict(zip(elements[-1][1], nodes, strict=True))
    places = np.array([found[i] for i in range(len(number))])
    A = np.zeros((2 * len(places), 2 * len(places)))
    for around, (nodes, numbers) in zip(cells, elements, strict=True):
        dofs = np.array([[2 * n, 2 * n + 1] for n in numbers]).ravel()
        A[np.ix_(dofs, dofs)] += element_stiffness(nodes, corners[around], cell, scene.material)
    # Simpson's rule is exact for the shape functions of order 2, the trapezium's for order 1
    force = np.zeros(len(A))
    top = np.flatnonzero((places[:, 1] == 1.0) & (np.abs(places[:, 0]) <= 1.0))
    top = top[np.argsort(places[top, 0])]
    for first in range(0, len(top) - 1, degree):
        ends = top[first : first + degree + 1]
        pattern = [0.5, 0.5] if degree == 1 else [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0]
        force[2 * ends + 1] -= np.ptp(places[ends, 0]) * np.array(pattern)
    bottom = np.flatnonzero(places[:, 1] == 0.0)
    bottom = bottom[np.argsort(places[bottom, 0])]
    contact = np.concatenate([2 * bottom, 2 * bottom + 1])
    held = 2 * np.flatnonzero(places[:, 0] == 0.0) if body.half else np.empty(0, dtype=int)
    inner = np.setdiff1d(np.arange(len(A)), np.concatenate([contact, held]))
    solved = np.linalg.solve(
        A[np.ix_(inner, inner)], np.column_stack([A[np.ix_(inner, contact)], force[inner]])
    )
    K = A[np.ix_(contact, contact)] - A[np.ix_(contact, inner)] @ solved[:, :-1]
    return places[bottom, 0], K, A[np.ix_(contact, inner)] @ solved[:, -1] - force[contact]


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("half", [False, True])
def test_stiffness_and_reactions_agree_with_an_own_dense_assembly(
    cell: str, degree: int, half: bool
) -> None:
    scene = block(cell, degree, elements=8)
    bulk = built(scene, half)
    x, K, r_star = own_condensation(scene, bulk.body)
    system = condense(bulk)
    if system is not None:
        assert system.x == pytest.approx(x, abs=1e-9)
        assert off(system.K, K) < 1e-12
        assert off(system.r_star[0], r_star) < 1e-12
    bulk.destroy()


@ELEMENTS
@pytest.mark.parametrize("supports", SUPPORTS)
@pytest.mark.parametrize("half", [False, True])
def test_both_routes_agree(
    cell: str, degree: int, supports: tuple[Support, ...], half: bool
) -> None:
    loads = (
        Load("p0", "top", (-1.0, 1.0), pressure=1.0),
        Load("lift", "top", traction=(0.0, "1 + x**2")),
    )
    # more than one block of right-hand sides
    scene = block(cell, degree, elements=40, loads=loads, supports=supports)
    bulk = built(scene, half)
    schur, solve = condense(bulk), condense(bulk, "solve")
    bulk.destroy()
    if schur is not None and solve is not None:
        assert schur.K.shape[0] > BLOCK_COLUMNS / (2 if half else 1) * degree
        assert off(schur.K, solve.K) < 1e-12
        assert off(schur.r_star, solve.r_star) < 1e-12
        assert off(schur.load_compliance, solve.load_compliance) < 1e-12


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("route", ["schur", "solve"])
@pytest.mark.parametrize("half", [False, True])
def test_any_number_of_ranks_gives_the_same_system(cell: str, route: str, half: bool) -> None:
    scene = block(cell, 2, elements=32)
    together = system_of(scene, half, route)
    alone = system_of(scene, half, "schur", MPI.COMM_SELF)
    assert (together is None) == (comm.rank > 0)
    if together is not None and alone is not None:
        assert np.array_equal(together.x, alone.x)
        assert np.array_equal(together.points, alone.points)
        assert np.array_equal(together.weight, alone.weight)
        assert np.array_equal(together.held, alone.held)
        assert np.array_equal(together.rigid, alone.rigid)
        assert off(together.K, alone.K) < 1e-12
        assert off(together.r_star, alone.r_star) < 1e-12


@pytest.mark.parametrize("degree", [1, 2])
def test_a_turned_body_has_the_same_system(degree: int) -> None:
    """A block on its side, with contact on that side, is the block; left and top are mirrored."""
    upright = system_of(block(degree=degree, loads=()))
    lying, standing = Body(width=4.0, height=1.0), Body(width=1.0, height=4.0)
    bodies = {"top": lying, "left": standing, "right": standing}
    systems = {}
    for edge, body in bodies.items():
        scene = block(degree=degree, loads=(), contacts=(Contact(edge=edge),), body=body)
        systems[edge] = system_of(scene)
    for edge, system in systems.items():
        if upright is None or system is None:
            continue
        n = upright.n
        # v runs against x where t does
        sign = np.ones(2 * n)
        if edge != "right":
            sign[:n] = -1.0
        assert system.x == pytest.approx(upright.x, abs=1e-15)
        assert off(sign[:, None] * system.K * sign, upright.K) < 1e-12


def test_a_wrong_triangle_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """MUMPS leaves garbage in one triangle: the comparison with a solve must catch a mix-up."""
    real = schur._triangle
    monkeypatch.setattr(schur, "_triangle", lambda ranks: real(3 - min(ranks, 2)))
    with pytest.raises(SolveError, match=r"off by .* from a solve .*Poisson's ratio"):
        system_of(block())


def test_lost_rigid_motions_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = elastic_body.eliminate_interior

    def spoilt(bulk: Bulk, route: str) -> Elimination:
        condensed = real(bulk, route)
        if condensed.K is None:
            return condensed
        return replace(condensed, K=condensed.K + 1e-9 * np.eye(len(condensed.K)))

    monkeypatch.setattr(elastic_body, "eliminate_interior", spoilt)
    with pytest.raises(SolveError, match="resists a rigid motion by"):
        system_of(block(), route="solve")


@pytest.mark.one_rank
def test_nothing_is_left_behind() -> None:
    """PETSc's objects count references that petsc4py alone would keep: 8 MB a body here."""

    def resident() -> float:
        status = Path("/proc/self/status").read_text().splitlines()
        return int(next(line.split()[1] for line in status if "VmRSS" in line)) / 1024.0

    scene = block("quadrilateral", 2, elements=80, growth=1.0)
    sizes = []
    for _ in range(6):
        bulk = built(scene)
        condense(bulk)
        condense(bulk, "solve")
        bulk.destroy()
        sizes.append(resident())
    # the first rounds fill pools that later ones use again
    assert sizes[-1] - sizes[2] < 12.0
