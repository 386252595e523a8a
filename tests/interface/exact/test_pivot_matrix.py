"""Exchanges of outputs with inputs keep the relation y = M x + L lambda between all of them."""

from __future__ import annotations

import numpy as np
import pytest

from receding_fenicsx.interface.exact.pivot_matrix import PivotData, PivotMatrix

N, LOADS = 6, 2


def keeps(matrix: PivotMatrix, M: np.ndarray, L: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether outputs from random inputs and loads belong together by the first relation."""
    x, load = rng.standard_normal(N), rng.standard_normal(LOADS)
    values = np.empty(2 * N)
    values[matrix.column_label] = x
    values[matrix.row_label] = matrix.response(matrix.column_label, x) + matrix.of_loads(load)
    y, first = values[:N], M @ values[N:] + L @ load
    return bool(np.abs(y - first).max() < 1e-9 * np.abs(values).max())


@pytest.mark.parametrize("many", [1, 2, 5])
def test_exchanges_keep_the_relation(many: int) -> None:
    rng = np.random.default_rng(many)
    G, L = rng.standard_normal((N, N)), rng.standard_normal((N, LOADS))
    M = G @ G.T + np.eye(N)
    data = PivotData(np.hstack([M, L]), np.arange(N), N + np.arange(N))
    matrix = PivotMatrix(data, 2 * N)
    for step in range(64):
        # y_i with x_i: all principal blocks of M are regular
        nodes = rng.choice(N, many, replace=False)
        y_is_output = matrix.row_of[nodes] >= 0
        out = np.where(y_is_output, nodes, N + nodes)
        into = np.where(y_is_output, N + nodes, nodes)
        assert matrix.exchange(out, into) and matrix.age == many * (step + 1)
        assert keeps(matrix, M, L, rng)
    matrix.restore(data)
    assert keeps(matrix, M, L, rng) and matrix.age == 0


def test_an_exchange_without_a_pivot_changes_nothing() -> None:
    M, rng = np.eye(N), np.random.default_rng(0)
    M[0, 0] = 0.0
    L = np.ones((N, LOADS))
    data = PivotData(np.hstack([M, L]), np.arange(N), N + np.arange(N))
    matrix = PivotMatrix(data, 2 * N)
    assert not matrix.exchange(np.array([0]), np.array([N]))
    assert not matrix.exchange(np.array([0, 1]), np.array([N, N + 1]))
    assert keeps(matrix, M, L, rng) and matrix.age == 0
    # without its column an input cannot be exchanged
    part = PivotMatrix(data.without(np.array([N + 1])), 2 * N)
    assert not part.exchange(np.array([1]), np.array([N + 1]))
    assert part.exchange(np.array([2]), np.array([N + 2]))
