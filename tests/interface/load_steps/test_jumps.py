"""Load steps and jumps: none is passed over, none is made up; the exact path is the reference."""

import re

import numpy as np
import pytest
from small import small_system, table

from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import SolverOptions


def steps(number: int, on_jump: str = "stop") -> SolverOptions:
    return SolverOptions(method="gauss-seidel", steps_per_leg=number, on_jump=on_jump)


# One node that sticks at u = 0 up to s of leg 1, r = (1 - 3/4 s, 1 - 7/4 s): at Q = f P, s = 4/11,
# it can neither stick nor slip, since f K_tn > K_tt. It opens: u = -K^-1 r, which releases
# r K^-1 r / 2 = 32 / 211.75.
LEVER = small_system([[2.0, 1.5], [1.5, 2.0]], {"a": [1, 1], "b": [0, -1]}, 2.0)
# The same with its mirror image, joined so that both may slide along the plane: one limit each.
JOINED = small_system(
    [[1, -1, 0.75, 0.75], [-1, 1, -0.75, -0.75], [0.75, -0.75, 2, 0], [0.75, -0.75, 0, 2]],
    {"a": [1, -1, 1, 1], "b": [0, 0, -1, -1]},
    2.0,
    rigid=[[1, 1, 0, 0]],
)


@pytest.mark.parametrize("number", [1, 3, 40, 160])
@pytest.mark.parametrize("lever", [LEVER, JOINED])
def test_load_steps_stop_where_the_path_ends_or_jump_there(
    lever: ContactSystem, number: int
) -> None:
    path, n = table(lever, [[0, 0], [1, 0], [0.25, 1]]), lever.n
    with pytest.raises(NoQuasiStaticContinuation) as caught:
        evolve(lever, path, steps(number))
    place = re.search(
        r"^cycle 0, leg 1: .* \(s = (\S+) of the leg\): .*nodes \[0.*\]", str(caught.value)
    )
    assert place is not None and float(place[1]) == pytest.approx(4 / 11, abs=1e-8)
    turning = caught.value.record.turning_points  # type: ignore[attr-defined]
    assert turning.state.tolist() == [[State.STICK] * n]
    # or they count the jump and its energy
    record = evolve(lever, path, steps(number, "static"))
    assert record.jumps == 1
    assert record.released == pytest.approx(n * 32 / 211.75, rel=1e-6)
    assert record.turning_points.state.tolist() == [[State.STICK] * n, [State.SEPARATION] * n]
    twice = evolve(lever, table(lever, [[0, 0], [1, 0], [0.25, 1]] * 2), steps(number, "static"))
    assert (twice.jumps, twice.released) == (2, pytest.approx(2.0 * record.released, rel=1e-6))
    # nothing slips: with what is released the energy is whole
    assert record.dissipation_first_loading == 0.0 and record.energy_error_max <= 1e-12


@pytest.mark.parametrize("number", [0, 3, 9])
@pytest.mark.parametrize("through", [[], [[0, 0]]])
def test_a_leg_through_zero_load_dissipates_what_two_legs_that_meet_there_do(
    number: int, through: list[list[int]]
) -> None:
    """K = I, f = 1/2; load a presses node 0 and lifts node 1, b pulls them.

    Node 0 slips at Q = -1/2 by 1/2; unloaded to lambda < 1/3 it slips back by 3 lambda/2 at
    Q = lambda/2 and opens at 0, where node 1 lands and slips by lambda/2 at Q = lambda/2.
    In a load step that ends open, from lambda = 1/number, no slip is counted.
    """
    pair = small_system(np.eye(4), {"a": [0, 0, 1, -1], "b": [-1, 1, 0, 0]}, 0.5)
    path = [[0, 0], [1, 0.5], [1, 1], *through, [-1, -1]]
    record = evolve(pair, table(pair, path), steps(number) if number else None)
    lost = 0.5 * 0.5 * 1.5 / number**2 if number else 0.0
    D = 0.5 * 0.5 + 0.5 * 0.5 * 1.5 / 9.0 - lost + 0.5 * 0.5 * 0.5
    assert record.dissipation_first_loading == pytest.approx(D, rel=1e-12)
    # the leg from 1 to -1 ends with the elastic energy of its start, so that its work is 1/6
    if not through:
        assert record.energy_error_max == pytest.approx(lost / (1 / 6 - lost), abs=1e-12)
    assert record.turning_points.state[-1].tolist() == [State.SEPARATION, State.FORWARD_SLIP]


@pytest.mark.parametrize("spring", [0.0, 1e-17, -1e-17])
def test_a_free_node_that_is_pulled_off_has_no_equilibrium(spring: float) -> None:
    # nothing but round-off of the stiffness holds it normally
    node = small_system([[1.0, 0.0], [0.0, spring]], {"p": [0.1, 1.0]}, 0.5, rigid=[[0.0, 1.0]])
    for solver in (None, steps(5)):
        evolve(node, table(node, [0.0, 1.0, 0.2, 1.0]), solver)
        with pytest.raises(NoEquilibrium, match="lift-off"):
            evolve(node, table(node, [0.0, 1.0, -0.1]), solver)
