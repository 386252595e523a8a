"""Points in elements: shape functions, and points that lie outside."""

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, block, built
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.elasticity import point_values, reference

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]


@pytest.mark.one_rank
@pytest.mark.parametrize("kind", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_shape_functions_carry_linear_fields_in_cells_of_any_shape(kind: str, degree: int) -> None:
    random = np.random.default_rng(3)
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[: 3 if kind[0] == "t" else 4]
    for _ in range(20):
        cell = unit + random.uniform(-0.2, 0.2, unit.shape)
        # middles of the sides in the order of basix, and of a quadrilateral the midpoint
        sides = [(1, 2), (0, 2), (0, 1)] if len(cell) == 3 else [(0, 1), (0, 2), (1, 3), (2, 3)]
        middles = [cell[list(side)].mean(axis=0) for side in sides]
        middles += [cell.mean(axis=0)] if len(cell) == 4 else []
        nodes = cell if degree == 1 else np.vstack([cell, middles])
        inner = random.dirichlet(np.ones(len(cell))) @ cell
        at = reference(kind, cell, inner)
        assert at is not None
        shape, slopes = (part[..., 0, :] for part in _dolfinx.tabulated(kind, degree, at[None]))
        gradient = slopes.T @ np.linalg.inv(_dolfinx.mapped(kind, cell, at[None])[1][0])
        slope = random.standard_normal(2)
        assert shape @ (1.0 + nodes @ slope) == pytest.approx(1.0 + inner @ slope, abs=1e-12)
        assert gradient.T @ (1.0 + nodes @ slope) == pytest.approx(slope, abs=1e-11)


def test_point_outside_a_meshed_body_is_refused_on_all_ranks() -> None:
    made = built(block())
    with pytest.raises(
        rf.InputError, match=r"probe 'p': \(0, 1.1\) lies outside the mesh .*; move"
    ):
        point_values(made, np.array([[0.0, 0.5], [0.0, 1.1]]), ["probe 'p'"] * 2)
    made.destroy()
