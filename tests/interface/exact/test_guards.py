"""Guards of the exact path against round-off: spoiled just above and just below each of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from legs import asking
from models import block_system
from small import small_system, table

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.exact.pivot_matrix import SINGULAR_PIVOT, SingularExchange
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.tableau import Tableau, W
from receding_fenicsx.interface.exact.walk import Walk, _displacement_uncertainty
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import Changes, ContactState
from receding_fenicsx.interface.tolerances import ACCEPTED_RESIDUAL

STICK, OPEN, FORWARD, BACKWARD = (int(state) for state in State)
UP = np.array([1.0])
BLOCK = block_system(40, 20)

Spoil = Callable[[Segments, np.ndarray, np.ndarray], None]
"""Changes rates (4N,) made for given states."""


def spoil_rates(monkeypatch: pytest.MonkeyPatch, spoil: Spoil) -> None:
    """Change all rates as they leave the tableau, refined as they are."""
    make = Segments._rates

    def spoiled(self: Segments, state: np.ndarray, direction: np.ndarray) -> np.ndarray:
        q = make(self, state, direction).copy()
        spoil(self, state, q)
        return q

    monkeypatch.setattr(Segments, "_rates", spoiled)


@pytest.mark.parametrize("part", [0.5, 2.0])
def test_a_path_whose_forces_do_not_balance_is_refused(
    monkeypatch: pytest.MonkeyPatch, part: float
) -> None:
    """A node is lifted off the plane on which it sticks, against a stiffness of 3."""
    system = small_system(np.diag([2.0, 2.0, 3.0, 3.0]), {"a": [0.0, 0.1, 1.0, 1.0]}, 0.5)

    def lift(_: Segments, state: np.ndarray, q: np.ndarray) -> None:
        # on the second leg, from 1 to 2, at whose end the largest force is 2
        q[W * 2] = part * ACCEPTED_RESIDUAL * 2.0 / 3.0

    asking(monkeypatch)
    history = table(system, [0.0, 1.0, 2.0])
    assert evolve(system, history).residual_max < 1e-15
    spoil_rates(monkeypatch, lift)
    if part > 1.0:
        said = r"cycle 0, leg 1: the exact path lost accuracy before a = 2: residual 2\.0e-11 over "
        said += "1e-11; try the other solver method"
        with pytest.raises(SolveError, match=f"^{said}$"):
            evolve(system, history)
    else:
        assert evolve(system, history).residual_max <= ACCEPTED_RESIDUAL


def test_round_off_of_a_walk_is_cleared_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Displacements that run away from their forces, a little on each leg, are brought back."""
    asking(monkeypatch)
    history = table(BLOCK, [0.0, 1.0, 1.0 / 3.0])
    exact = evolve(BLOCK, history)
    assert exact.n_events > 60

    def drift(segments: Segments, state: np.ndarray, q: np.ndarray) -> None:
        slips = (state == FORWARD) | (state == BACKWARD)
        error = 5.0 * ACCEPTED_RESIDUAL * exact.turning_points.P.max()
        # neighbours in opposite directions: a common motion meets hardly any stiffness
        error = np.where(np.arange(BLOCK.n) % 2, error, -error) / segments.weight[: BLOCK.n]
        q[: BLOCK.n] += np.where(slips, error, 0.0)

    spoil_rates(monkeypatch, drift)
    cleared = evolve(BLOCK, history)
    assert cleared.residual_max <= ACCEPTED_RESIDUAL
    found, expected = cleared.turning_points, exact.turning_points
    assert np.array_equal(found.state, expected.state)
    assert found.P == pytest.approx(expected.P, abs=1e-9 * expected.P.max())
    monkeypatch.setattr(Walk, "_balanced", lambda walk: walk.path.place.put(3, np.inf))
    with pytest.raises(SolveError, match="lost accuracy"):
        evolve(BLOCK, history)


@pytest.mark.parametrize("part", [0.5, 2.0])
def test_states_with_almost_no_stiffness_are_singular_but_for_soft_springs(part: float) -> None:
    """Forward slip of node 0 meets the stiffness K_tt + f K_nt, next to one of order 1.

    Where no rigid motion is free it is a spring's.
    """
    unit, f = 2.0, 0.5  # a power of two beyond the median of the diagonal
    left = part * SINGULAR_PIVOT * unit
    K = np.diag([0.5 + left, 2.0, 2.0, 1.0])
    K[0, 2] = K[2, 0] = -1.0
    system = small_system(K, {"a": [0.0, 0.1, 1.0, 1.0]}, f)
    stuck, slips = np.full(2, STICK, dtype=np.int8), np.full(2, FORWARD, dtype=np.int8)
    tableau = Tableau(system, stuck)
    if part < 1.0:
        with pytest.raises(SingularExchange):
            tableau.move_to(slips)
        tableau = Segments(system).tableau(slips)
    else:
        tableau.move_to(slips)
    v = tableau.rates(UP)[:2]
    # Q + f P of the load, over the stiffness
    assert v == pytest.approx([-0.5 / left, -0.6 / 2.0], rel=1e-4)


def test_states_on_the_way_that_leave_a_motion_free_excuse_no_residual() -> None:
    """Forward slip of node 0 meets no stiffness: K_tt + f K_nt = 0."""
    K = np.diag([0.5, 2.0, 2.0, 1.0])
    K[0, 2] = K[2, 0] = -1.0
    segments = Segments(small_system(K, {"a": [0.0, 0.1, 1.0, 1.0]}, 0.5))
    stuck = np.full(2, STICK, dtype=np.int8)
    with pytest.raises(SingularExchange):
        segments.tableau(np.array([FORWARD, STICK], dtype=np.int8))
    ends = ContactState(np.zeros(4), np.ones(4), stuck), ContactState(np.ones(4), np.ones(4), stuck)
    slips = Changes.of([(0.5, 0, STICK, FORWARD), (0.6, 0, FORWARD, STICK)])
    found = [_displacement_uncertainty(segments, ends, way, 1.0) for way in (Changes.none(), slips)]
    assert found[0] == found[1]
