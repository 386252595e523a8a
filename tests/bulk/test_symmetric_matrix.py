"""Tile by tile work on symmetric matrices: against whole-matrix formulas."""

import numpy as np
import pytest

from receding_fenicsx.bulk.schur import norm, symmetrise, turn

pytestmark = pytest.mark.one_rank

SIZES = [2, 256, 422]  # tiles have 128 rows
"""One tile, whole tiles, and a part of one at the end."""


def random(size: int) -> np.ndarray:
    return np.random.default_rng(size).standard_normal((size, size))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.5 * np.pi, np.pi])
def test_turning_is_a_congruence_and_keeps_symmetry_to_the_last_bit(
    size: int, angle: float
) -> None:
    c, s = np.cos(angle), np.sin(angle)
    R = np.kron([[c, s], [-s, c]], np.eye(size // 2))
    matrix = random(size)
    symmetrise(matrix)
    expected = R @ matrix @ R.T
    turn(matrix, lambda values: R @ values)
    assert np.array_equal(matrix, matrix.T)
    assert matrix == pytest.approx(expected, abs=1e-13 * norm(expected))
