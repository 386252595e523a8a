"""Uniqueness that a record tells: small contacts of known answers, symmetry, methods, scale."""

from __future__ import annotations

import numpy as np
import pytest
from small import small_system, table
from unique_paths import FALSE, KINDS, tally

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record_data import PathUniqueness
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.law import State
from receding_fenicsx.interface.system import ContactState, ContactSystem
from receding_fenicsx.interface.uniqueness.watch import solutions_from_rest
from receding_fenicsx.scene.model import SolverOptions

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


def found(system: ContactSystem, *args: object) -> PathUniqueness:
    unique = evolve(system, *args).uniqueness  # type: ignore[arg-type]
    assert unique is not None
    return unique


def pair(a: float, b: float, f: float) -> ContactSystem:
    """Return two nodes, mirror images of one another: K_tn = a at each, b between them."""
    K = np.eye(4)
    K[2:, 2:] *= 2.0
    K[:2, 2:] = [[a, -b], [b, -a]]
    K[2:, :2] = K[:2, 2:].T
    return small_system(K, {"press": [0, 0, 1, 1], "pull": [-1, 1, 0, 0]}, f)


@pytest.mark.parametrize(
    ("b", "solutions", "options"),
    [
        (-0.8, 3, SolverOptions()),
        (-0.8, 3, SolverOptions(branch="most dissipation")),
        (-0.8, 3, SolverOptions(method="gauss-seidel", steps_per_leg=4)),
        (-0.8, 3, SolverOptions(method="gauss-seidel", steps_per_leg=5)),
        (-0.4, 1, SolverOptions()),
        (-0.4, 1, SolverOptions(method="gauss-seidel", steps_per_leg=4)),
    ],
)
@pytest.mark.parametrize("turn", [False, True])
def test_nodes_that_reach_their_limits_together_are_undecided_together(
    b: float, solutions: int, options: SolverOptions, turn: bool
) -> None:
    """M = [[m, -f b], [-f b, m]], m = K_tt + f a = 1/2: both slip, or either alone if -f b > m.

    Both reach the limit half way along the pull, or where it ends and goes on with another press.
    """
    system = pair(-0.5, b, 1.0)
    corners = [(0, 0), (1, 0), (1, 1), (0.9, 1.8)] if turn else [(0, 0), (1, 0), (1, 2)]
    loop = [corners[-1], (1, 0), (1, -1), corners[-1]]  # undecided again, what is told is the first
    unique = found(system, table(system, corners, loop, 1), options)
    assert unique.certified == (solutions == 1) and unique.solutions == solutions
    if solutions > 1:
        assert unique.nodes.tolist() == [0, 1]
        half_way = 0.6 if options.steps_per_leg == 5 else 0.5  # the end of its load step
        assert (unique.leg, unique.s) == ((2, 0.0) if turn else (1, pytest.approx(half_way)))


@pytest.mark.parametrize("branch", [1, 2, 3])
def test_a_path_that_begins_again_from_no_force_has_as_many_solutions_as_it_has_choices(
    branch: int,
) -> None:
    """Unloaded to zero and loaded otherwise: both lift off, one slips, or both slip.

    Whichever of these is taken, whatever round-off the gaps have at zero load.
    """
    K = np.array([[83, 25, -9, 62], [25, 83, -57, 24], [-9, -57, 100, -35], [62, 24, -35, 81]])
    loads = {"a": [0.13, -1.33, 1.69, 0.59], "b": [0.68, -0.56, 0.52, 0.04]}
    system = small_system(K / 100.0, loads, [2.2, 1.36])
    history = table(system, [(0, 0), (1, 0.38), (0, 0), (0.07, 0.77)])
    record = evolve(system, history, SolverOptions(branch=branch))
    unique = record.uniqueness
    assert unique is not None and not unique.certified
    (choice,) = record.choices
    assert (choice.leg, choice.s, choice.load) == (2, 0.0, (0.0, 0.0))
    assert (choice.solutions, choice.taken) == (3, branch)
    assert (unique.leg, unique.s, unique.solutions) == (2, 0.0, 3)


# in the last one the first of four nodes on their limits to be let go sticks all the same
@pytest.mark.parametrize(
    ("kind", "first", "last"), [*((k, 8, 16) for k in KINDS), ("pairs", 171, 172)]
)
def test_no_path_is_certified_that_has_several_continuations(
    kind: str, first: int, last: int
) -> None:
    found, instants, _ = tally(range(first, last), kind)
    assert found[FALSE] == 0 and instants >= 8
    # within load steps nothing is proved but of contacts that are definite in all states
    if kind != "load steps":
        assert found["one, not certified"] <= 0.1 * found["one, certified"], found


@pytest.mark.parametrize(
    ("path", "certified"), [([[1, 0], [1, 1]], True), ([[1, 0], [0, 1]], False)]
)
def test_the_place_of_a_free_body_that_no_force_presses_is_not_certified(
    path: list[list[float]], certified: bool
) -> None:
    # guided across the contact; the pull along it is in balance: any gap keeps all laws
    body = small_system(
        np.diag([1.0, 0.0]), {"press": [0, 1], "pull": [1, 0]}, 0.5, rigid=[[0.0, 1.0]]
    )
    assert found(body, table(body, [[0, 0], *path])).certified == certified


@pytest.mark.parametrize(
    ("gap", "load", "solutions"),
    [(0.1, [1.3, 1.0], 3), (0.0, [1.3, 1.0], 3), (0.1, [0.0, -0.1], 1)],
)
def test_nodes_that_may_land_count_in_the_static_problem_of_an_initial_slip(
    gap: float, load: list[float], solutions: int
) -> None:
    # pressed it may open, as 1.3 .9 > 1, and in contact stick or slip back
    node = small_system([[1.0, 0.9], [0.9, 1.0]], {"a": load}, 1.5, gap)
    unique = found(node, table(node, [[0.0], [1.0]]), None, None, np.full(1, 0.01))
    assert unique.certified == (solutions == 1)
    assert unique.first_loading == unique.solutions == solutions


@pytest.mark.parametrize("n", [3, 8])
def test_nodes_that_touch_without_pressure_are_undecided_however_many(n: int) -> None:
    """The first load presses node 0 alone; under the second all others stick, open or slip back."""
    others = np.arange(n) > 0
    loads = {"one": [*np.zeros(n), *~others], "others": [*1.3 * others, *others]}
    system = small_system(np.kron([[1.0, 0.9], [0.9, 1.0]], np.eye(n)), loads, 1.5)
    alone, both = (found(system, table(system, [[0, 0], [1, 0], *more])) for more in ([], [[1, 1]]))
    assert alone.certified and not both.certified
    assert (both.leg, both.s) == (1, 0.0)
    # slip of no length at the limit, or none: one solution
    system = small_system(np.eye(2 * n), {"a": np.repeat([-1.5, 1.0], n)}, 1.5)
    start = ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, dtype=np.int8))
    slips = np.full(n, State.FORWARD_SLIP, dtype=np.int8)
    assert len(solutions_from_rest(Segments(system), start, slips, np.ones(1))[0]) == 1
