"""Condensed systems of one or two nodes for models worked out on paper, and histories for them."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History

Rows = Sequence[Any] | np.ndarray


def named_loads(error: BaseException, *names: str) -> list[float]:
    """Return the load factors that an error names; of each name the first."""
    said = [re.search(rf"(?<!\w){re.escape(name)} = ([-+.\de]+)", str(error)) for name in names]
    return [float(found[1]) for found in said if found is not None]


def assert_same_bits(a: object, b: object, place: str = "") -> None:
    """Fail unless two records, systems or parts of them are the same in every bit."""
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            one, other = (getattr(each, field.name) for each in (a, b))
            assert_same_bits(one, other, f"{place}.{field.name}")
    elif isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape, place
        assert a.tobytes() == b.tobytes(), place
    else:
        assert type(a) is type(b) and (a == b or (a != a and b != b)), place  # NaN


def small_system(
    K: Rows, loads: Mapping[str, Rows], f: float | Rows, g0: float | Rows = 0.0, rigid: Rows = ()
) -> ContactSystem:
    """Return a system from its matrices, order [v; w]; ``loads`` are held reactions by name."""
    K = np.array(K, dtype=float)
    n = len(K) // 2
    return ContactSystem(
        x=np.arange(n, dtype=float),
        points=np.stack([np.arange(n), np.zeros(n)], axis=1).astype(float),
        weight=np.ones(n),
        K=K,
        r_star=np.array(list(loads.values()), dtype=float),
        load_names=tuple(loads),
        f=np.broadcast_to(np.asarray(f, dtype=float), (n,)).copy(),
        g0=np.broadcast_to(np.asarray(g0, dtype=float), (n,)).copy(),
        held=np.zeros(2 * n, dtype=bool),
        rigid=np.array(rigid, dtype=float).reshape(-1, 2 * n).T,
    )


def random_system(seed: int, n: int, margin: float) -> ContactSystem:
    """Return a random positive definite system, f |row of K_tn|_1 <= margin * min eig K_tt.

    Two loads press mostly, so that contact, slip and separation all occur.
    """
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((2 * n, 3 * n))
    K = G @ G.T / (3 * n) + 0.2 * np.eye(2 * n)
    f = margin * np.linalg.eigvalsh(K[:n, :n]).min() / np.abs(K[:n, n:]).sum(axis=1).max()
    loads = rng.standard_normal((2, 2 * n))
    loads[0, n:] = np.abs(loads[0, n:]) + 0.3
    return small_system(0.5 * (K + K.T), {"load0": loads[0], "load1": loads[1]}, f)


def table(system: ContactSystem, path: Rows, loop: Rows = (), cycles: int = 0) -> History:
    """Return the history through the corners of ``path`` and then round ``loop``."""
    width = len(system.load_names)
    corners = np.array(path, dtype=float).reshape(-1, width)
    closed = np.array(loop, dtype=float).reshape(-1, width)
    return History(system.load_names, corners, closed, cycles)


def cyclic(cycles: int, minimum: float = 1 / 3, maximum: float = 1.0) -> History:
    """Return the paper's history of the load p0: to the maximum, then down and up again."""
    loop = np.array([[maximum], [minimum], [maximum]])
    return History(("p0",), np.array([[0.0], [maximum]]), loop, cycles)


def walker(k: float = 2.0) -> ContactSystem:
    """Return two feet joined by a spring, free to slide; "shift" moves the weight between them."""
    K = np.zeros((4, 4))
    K[:2, :2] = k * np.array([[1, -1], [-1, 1]])
    K[2:, 2:] = np.eye(2)
    loads = {"weight": [0.0, 0, 1, 1], "push": [-0.5, -0.5, 0, 0], "shift": [0.0, 0, 1, -1]}
    return small_system(K, loads, 0.5, rigid=[[1.0, 1.0, 0.0, 0.0]])
