"""Condensed systems made without FEniCSx: an own finite-element block, and random matrices.

The assembly below shares nothing with the package: bilinear squares integrated by hand-written
Gauss quadrature, condensed by SciPy. It is the independent reference of the interface tests.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from receding_fenicsx.interface.system import ContactSystem


def q1_stiffness(hx: float, hy: float, young: float, poisson: float) -> np.ndarray:
    """Return the (8, 8) plane-strain stiffness of one rectangle, dofs (ux, uy) per corner."""
    lam = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    mu = young / (2 * (1 + poisson))
    D = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    k = np.zeros((8, 8))
    for a in (-1, 1):
        for b in (-1, 1):
            xi, eta = a / np.sqrt(3), b / np.sqrt(3)
            dx = corners[:, 0] * (1 + eta * corners[:, 1]) / 4 * 2 / hx
            dy = corners[:, 1] * (1 + xi * corners[:, 0]) / 4 * 2 / hy
            B = np.zeros((3, 8))
            B[0, 0::2] = dx
            B[1, 1::2] = dy
            B[2, 0::2] = dy
            B[2, 1::2] = dx
            k += B.T @ D @ B * hx * hy / 4
    return k


def block_system(
    nx: int, ny: int, f: float = 0.35, poisson: float = 0.3, half: bool = True, young: float = 1.0
) -> ContactSystem:
    """Condense the paper's block (width 4, height 1, pressure 1 on |x| < 1) to its bottom nodes.

    There are nx elements along the modelled width, a multiple of 2 (half) or 4 (whole), ny over the
    height. A half is x >= 0 with symmetry on the axis.
    """
    xs = np.linspace(0.0 if half else -2.0, 2.0, nx + 1)
    return grid_system(xs, np.linspace(0.0, 1.0, ny + 1), f, poisson, young)


def grid_system(
    xs: np.ndarray, ys: np.ndarray, f: float = 0.35, poisson: float = 0.3, young: float = 1.0
) -> ContactSystem:
    """Condense a rectangle of unequal cells, pressed on |x| < 1, to its bottom nodes.

    Of the grid lines xs one lies at 1; they begin at 0 for half of a body symmetric about x = 0.
    """
    half, nx, ny = bool(xs[0] == 0.0), len(xs) - 1, len(ys) - 1
    hx, hy = np.diff(xs), np.diff(ys)
    node = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    cells = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], -1).reshape(
        -1, 4
    )
    dofs = (2 * cells[:, :, None] + np.arange(2)).reshape(-1, 8)
    sizes = list(product(hy, hx))
    k = {size: q1_stiffness(size[1], size[0], young, poisson).ravel() for size in set(sizes)}
    rows, cols = np.repeat(dofs, 8, axis=1).ravel(), np.tile(dofs, (1, 8)).ravel()
    A = sp.csr_matrix((np.concatenate([k[size] for size in sizes]), (rows, cols)))
    force = np.zeros(A.shape[0])
    for i in range(nx):
        if abs(xs[i] + hx[i] / 2) < 1:
            force[2 * node[ny, i : i + 2] + 1] -= hx[i] / 2
    contact = np.concatenate([2 * node[0], 2 * node[0] + 1])
    fixed = 2 * node[1:, 0] if half else np.array([], dtype=int)
    inner = np.setdiff1d(np.arange(A.shape[0]), np.concatenate([contact, fixed]))
    solve = spla.splu(A[inner][:, inner].tocsc())
    coupling = A[inner][:, contact].toarray()
    lifted = solve.solve(coupling)
    pushed = solve.solve(force[inner])
    K = A[contact][:, contact].toarray() - coupling.T @ lifted
    r_star = coupling.T @ pushed - force[contact]
    n = nx + 1
    held = np.zeros(2 * n, dtype=bool)
    held[0] = half
    weight = 0.5 * (np.append(hx, 0.0) + np.append(0.0, hx))
    one, zero = np.ones(n), np.zeros(n)
    modes = [np.concatenate([zero, one])]
    if not half:
        modes += [np.concatenate([one, zero]), np.concatenate([zero, xs])]
    return ContactSystem(
        x=xs,
        points=np.stack([xs, zero], 1),
        weight=weight,
        K=0.5 * (K + K.T),
        r_star=r_star[None],
        load_names=("p0",),
        f=np.full(n, f),
        g0=zero.copy(),
        held=held,
        rigid=np.stack(modes, 1) / np.abs(np.stack(modes, 1)).max(0),
        half=half,
        load_compliance=np.array([[force[inner] @ pushed]]),
        load_sign=np.array([-1.0]),
    )


def pushed_block() -> ContactSystem:
    """Return the whole block, its contact pushed to the right by a load of its own."""
    whole = block_system(24, 6, half=False)
    push = np.concatenate([-whole.weight / whole.weight.sum(), np.zeros(whole.n)])
    return replace(
        whole,
        r_star=np.vstack([whole.r_star, push]),
        load_names=("p0", "push"),
        load_compliance=np.zeros((0, 0)),
    )


def under_four_loads(seed: int) -> tuple[ContactSystem, list[list[float]]]:
    """Return a random block under pressure and three more loads, and the corners of a loop."""
    rng = np.random.default_rng(seed)
    half, nx = bool(rng.random() < 0.5), int(rng.choice([16, 24, 32, 48]))
    f, poisson = rng.uniform(0.1, 1.0), rng.uniform(0.0, 0.48)
    block = block_system(nx, nx // 4, f, poisson, half)
    rows = []
    for _ in range(3):
        normal = 0.6 * rng.normal(size=2)[0] * np.cos(rng.integers(1, 3) * np.pi * block.x / 2)
        rows.append((0.3 * rng.normal() * np.sin(np.pi * block.x / 2), normal))
    return _loaded(rng, block, rows)


def tall_under_four_loads(seed: int) -> tuple[ContactSystem, list[list[float]]]:
    """Return the same for a block that is shallow to square, with friction up to 1.8."""
    rng = np.random.default_rng(seed)
    nx = int(rng.choice([16, 24, 32]))
    ny = max(2, int(rng.choice([nx // 8, nx // 2, nx])))
    f = rng.uniform(0.1, 1.8)
    block = block_system(nx, ny, f, rng.uniform(0.0, 0.48), bool(rng.random() < 0.3))
    rows = []
    for _ in range(3):
        normal = 0.5 * rng.normal() * np.cos(rng.integers(1, 4) * np.pi * block.x / 2)
        shear = 0.3 * rng.normal() * np.sin(rng.integers(1, 3) * np.pi * block.x / 2)
        rows.append((shear, normal))
    return _loaded(rng, block, rows)


def _loaded(
    rng: np.random.Generator, block: ContactSystem, rows: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[ContactSystem, list[list[float]]]:
    """Return a block under tractions more, with friction that varies, and a random loop."""
    forces = [np.concatenate([block.weight * q, block.weight * p]) for q, p in rows]
    loaded = replace(
        block,
        r_star=np.where(block.held, 0.0, np.array([block.r_star[0], *forces])),
        load_names=("p0", "a", "b", "c"),
        f=block.f * (1.0 + 0.3 * rng.uniform(-1.0, 1.0, block.n)),
        load_compliance=np.zeros((4, 4)),
        load_sign=np.ones(4),
    )
    count = int(rng.integers(2, 5))
    corners = [[rng.uniform(0.6, 1.4), *rng.uniform(-0.5, 0.5, 3)] for _ in range(count)]
    return loaded, [*corners, corners[0]]


def gapped_under_four_loads(seed: int) -> tuple[ContactSystem, list[list[float]]]:
    """Return the same with initial gaps at most nodes."""
    block, loop = under_four_loads(seed)
    rng, n = np.random.default_rng([seed, 77]), block.n
    depth = 2 * np.abs(block.r_star[0][n:]).max() / np.median(np.diag(block.K)[n:])
    return replace(block, g0=np.where(rng.random(n) < 0.4, 0.0, depth * rng.random(n))), loop


def directed_under_four_loads(seed: int) -> tuple[ContactSystem, list[list[float]]]:
    """Return a tall one with other friction backward than forward."""
    block, loop = tall_under_four_loads(seed)
    ratio = np.random.default_rng([seed, 77]).uniform(0.3, 1.7, size=block.n)
    return replace(block, f_backward=block.f * ratio), loop
