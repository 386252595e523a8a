"""Load ranges round which nodes open and close without slip, against exact cycles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.optimize
from shakedown_cases import Case, coupled_case

import receding_fenicsx as rf
from receding_fenicsx.interface.shakedown.margins import load_range
from receding_fenicsx.interface.shakedown.opening import largest_opening
from receding_fenicsx.studies.shakedown import exact_cycles
from receding_fenicsx.studies.shakedown.exact_cycles import limit_by_cycles, shakes_down

pytestmark = pytest.mark.once(False)  # by solvers of SciPy


def rocked(seed: int, n: int, corners: int = 2) -> Case:
    """Return a coupled system that is pressed, and pressed and pulled in turn by the range."""
    mean, change = ((-0.1, 0.1), (0.5, 1.3)), ((-0.2, 0.2), (-1.0, 1.0))
    rng = np.random.default_rng([seed, 71])
    return coupled_case(rng, n, corners, mean, change, (0.4, 0.9))


@pytest.mark.parametrize(("seed", "n"), [(10, 2), (27, 2), (14, 3), (28, 3), (6, 4)])
def test_exact_cycles_end_without_slip_up_to_the_range_found_and_not_above(
    seed: int, n: int
) -> None:
    case = rocked(seed, n)
    limits = rf.shakedown_limits(*case)
    found = rf.opening_limit(*case, limits)
    assert found.dissipation <= 1e-12
    assert not found.closed.all()
    low, high = limit_by_cycles(*case, limits.upper, limits.safe_slip_modelled)
    assert low * (1.0 - 1e-9) <= found.value <= high
    assert found.value < found.top
    assert not shakes_down(case[0], rf.range_history(*case, 1.001 * found.value), found.slip)


@pytest.mark.parametrize("seed", [0, 13])
def test_loop_of_three_corners_ends_where_the_closed_contact_does(seed: int) -> None:
    # a node with friction would have to lose both reactions at once at two places of the loop; at
    # seed 13 cycles dissipate 1e-6 of the first one, and go on slipping
    case = rocked(seed, 2 + seed % 2, corners=3)
    limits = rf.shakedown_limits(*case)
    assert limits.opens
    found = rf.opening_limit(*case, limits)
    assert found.value == pytest.approx(limits.upper, rel=1e-6)
    low, high = limit_by_cycles(*case, limits.upper, limits.safe_slip_modelled)
    assert low * (1.0 - 1e-9) <= found.value <= high


@pytest.mark.parametrize("seed", range(3))
def test_closed_contacts_have_the_limit_of_the_linear_program(seed: int) -> None:
    system, mean, corners = rocked(seed, 5, corners=2 + seed % 3)
    f = system.f * np.array([1, 1, 0, 1, 1])
    case = replace(system, f=f, f_backward=f * np.linspace(1.3, 0.8, 5)), mean, corners
    limits = rf.shakedown_limits(*case)
    found = largest_opening(case[0], load_range(*case), np.zeros(5, dtype=bool), 4.0 * limits.upper)
    assert found.value == pytest.approx(limits.upper, rel=1e-6)
    assert found.closed.all()


def test_a_range_of_a_program_that_was_ended_early_is_not_called_the_largest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case, milp = rocked(10, 2), scipy.optimize.milp
    limits = rf.shakedown_limits(*case)
    assert not rf.opening_limit(*case, limits).cut

    def cut(*arguments: Any, **options: Any) -> Any:
        found = milp(*arguments, **options)
        found.status = 1
        return found

    monkeypatch.setattr(scipy.optimize, "milp", cut)
    found = rf.opening_limit(*case, limits)
    assert found.cut and not found.best


def test_what_has_no_range_with_opening_nodes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    case = rocked(20, 3)
    limits = rf.shakedown_limits(*case)
    # from rest the first cycles slip
    found = rf.opening_limit(*case, limits)
    still = replace(found, slip=0.0 * found.slip)
    monkeypatch.setattr(exact_cycles, "largest_opening", lambda *_: still)
    with pytest.raises(rf.SolveError, match="cycles from the slip found dissipate"):
        rf.opening_limit(*case, limits)
    monkeypatch.setattr(exact_cycles, "MOST_NODES", 1)
    monkeypatch.setattr(exact_cycles, "ALL_NODES", 1)
    with pytest.raises(rf.InputError, match=r"[23] nodes open, 1 at most are tried"):
        rf.opening_limit(*case, limits)
