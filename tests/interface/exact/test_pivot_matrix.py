"""Exchanges of outputs with inputs keep the relation y = M x + L lambda between all of them."""

from __future__ import annotations

import numpy as np
import pytest

from receding_fenicsx.interface.exact.pivot_matrix import MAX_PENDING, PivotData, PivotMatrix

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
def test_exchanges_and_copies_keep_the_relation(many: int) -> None:
    rng = np.random.default_rng(many)
    G, L = rng.standard_normal((N, N)), rng.standard_normal((N, LOADS))
    M = G @ G.T + np.eye(N)
    data = PivotData(np.hstack([M, L]), np.arange(N), N + np.arange(N))
    matrix, kept = PivotMatrix(data, 2 * N), []
    for step in range(2 * MAX_PENDING):
        # y_i with x_i: all principal blocks of M are regular
        nodes = rng.choice(N, many, replace=False)
        y_is_output = matrix.row_of[nodes] >= 0
        out = np.where(y_is_output, nodes, N + nodes)
        into = np.where(y_is_output, N + nodes, nodes)
        done = matrix.exchange(*map(int, (out[0], into[0])))
        assert done and (many == 1 or matrix.exchange_many(out[1:], into[1:]))
        assert keeps(matrix, M, L, rng)
        if step % 9 == 4:
            kept.append(matrix.copy())
            assert kept[-1].age == many * (step + 1)
            assert keeps(matrix, M, L, rng)
    for copy in kept:
        again = PivotMatrix(copy, 2 * N)
        assert keeps(again, M, L, rng)
        matrix.restore(copy)
        assert keeps(matrix, M, L, rng)


def test_an_exchange_without_a_pivot_changes_nothing() -> None:
    M, rng = np.eye(N), np.random.default_rng(0)
    M[0, 0] = 0.0
    L = np.ones((N, LOADS))
    matrix = PivotMatrix(PivotData(np.hstack([M, L]), np.arange(N), N + np.arange(N)), 2 * N)
    assert not matrix.exchange(0, N)
    assert not matrix.exchange_many(np.array([0, 1]), np.array([N, N + 1]))
    assert keeps(matrix, M, L, rng) and matrix.age == 0
    # without its column an input cannot be exchanged
    part = PivotMatrix(matrix.copy().without(np.array([N + 1])), 2 * N)
    assert not part.exchange(1, N + 1) and part.exchange(2, N + 2)
