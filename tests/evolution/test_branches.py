"""All branches of a history: worked examples, and every set of states tried by other code."""

import re
from collections import Counter
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from replay import replay
from small import small_system, table
from unique_paths import all_ends, different, pairs, random_problem
from ways import TooMany

import receding_fenicsx as rf
from receding_fenicsx.evolution import branches
from receding_fenicsx.evolution.evolve import continue_history
from receding_fenicsx.interface.branches.choice import Chooser
from receding_fenicsx.interface.law import BACKWARD, SEPARATION, STICK

pytestmark = [pytest.mark.one_rank, pytest.mark.once]

PLACE = 1e-6
"""Part of a leg within which two places are one."""


def node_of_three_solutions() -> rf.ContactSystem:
    return small_system([[1.0, 0.9], [0.9, 1.0]], {"p0": [1.3, 1.0]}, 1.5)


def two_nodes() -> tuple[rf.ContactSystem, rf.History]:
    """Return two uncoupled nodes, the first with two answers to the first load."""
    K = np.kron([[2.0, 1.5], [1.5, 2.0]], np.eye(2))
    system = small_system(K, {"a": [1.0, 2.0, 0.5, 2.0], "b": [0.5, 0.0, 0.0, 0.0]}, 2.0)
    return system, table(system, [[0, 0], [1, 0], [0, 1], [0, 0], [1, 0]])


def test_branches_are_numbered_by_their_choices_from_the_first_on() -> None:
    three = node_of_three_solutions()
    tree = rf.branches(three, table(three, [[0.0], [1.0]]))
    assert [b.taken for b in tree] == [(1,), (2,), (3,)] and "3 branches (all)" in str(tree)
    lost = tree[2].record.dissipation_first_loading
    assert lost > 0.0 and f"\nbranch 2: 3 of 3; dissipation {lost:.6g};" in str(tree)
    # all is unloaded before the last leg, on which node 0 has the same two answers
    assert [branch.taken for branch in rf.branches(*two_nodes())] == [(1,), (2, 1), (2, 2)]
    # all cycles are sampled, and their dissipation is counted
    tree = rf.branches(three, table(three, [[0.0], [1.0]], [[1.0], [0.0], [1.0]], 5), most=5)
    assert set(tree[0].record.samples.cycle.tolist()) == {*range(6)}
    lost = tree[4].record.cycles.dissipation.sum()
    assert lost > tree[4].record.dissipation_first_loading == 0.0
    assert str(tree).endswith(f"dissipation {lost:.6g}; ends: {tree[4].failure}")


def test_states_on_a_branch_are_found_again_between_its_turning_points() -> None:
    problems = two_nodes(), pairs(31)  # the second one with two choices on a leg
    played = [(*problem, branch) for problem in problems for branch in rf.branches(*problem, 12)]
    for system, history, branch in played:
        record, samples = branch.record, branch.record.samples
        for row in range(0, len(samples.s), 9):
            where = int(samples.cycle[row]), int(samples.leg[row]), float(samples.s[row])
            found = rf.state_at(record, system, history, rf.SolverOptions(), where)
            assert found.v == pytest.approx(samples.v[row], abs=1e-12), (branch.taken, where)
            assert np.array_equal(found.state.state, samples.state[row])


def test_a_doubt_on_any_branch_is_one_of_the_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    played = list[Any]()

    def doubting(problem: Any, journal: Any) -> rf.Record:
        played.append(problem)
        problem.chooser.unsure.add((len(played), 0, 0.5))
        return continue_history(problem, journal)

    monkeypatch.setattr(branches, "continue_history", doubting)
    tree = rf.branches(*two_nodes())
    assert tree.unsure == ((1, 0, 0.5), (2, 0, 0.5), (3, 0, 0.5)) and not tree.complete
    assert re.search(r"at 3 instants not all .*, first in cycle 1, leg 0, at s = 0\.5\)", str(tree))
    (chooser := Chooser()).unsure.update({(2, 1, 0.5), (1, 2, 0.25)})
    assert chooser.text().endswith(" (first in cycle 1, leg 2, s = 0.25)")


@pytest.mark.parametrize(
    ("loads", "complete"), [([1, 0.4], True), ([1, 1], False), ([0, 1], False)]
)
def test_a_motion_that_nothing_determines_leaves_branches_that_are_not_found(
    loads: list[float], complete: bool
) -> None:
    # two feet free to slide: pushed apart beyond friction each may slip any part of the way; held
    # by nothing but a load in balance the body floats
    K = np.kron([[0.0, 0.0], [0.0, 1.0]], [[1.0, -1.0], [-1.0, 1.0]])
    K[:2, :2] = [[2.0, -2.0], [-2.0, 2.0]]
    parts = {"press": [0.0, 0, 1, 1], "spread": [1.0, -1, 0, 0]}
    body = small_system(K, parts, 0.5, rigid=[[1.0, 1, 0, 0], [0.0, 0, 1, 1]])
    tree = rf.branches(body, table(body, [[0, 0], loads]))
    assert ((0, 0, 1.0) in tree.unsure) == (loads == [0, 1])  # where it floats
    assert tree.complete == complete and ("may be more" in str(tree)) != complete
    assert all(rf.given(b.record.uniqueness).certified == complete for b in tree)
    # what another first loading proves later does not prove this one
    record = rf.evolve(body, table(body, [[0, 0], loads, [0, 0], [1, 0.4]]))
    assert rf.given(record.uniqueness).first_loading_proved == complete


def test_an_error_names_the_first_choices_before_it() -> None:
    """Each time that it is loaded from rest node 0 has two answers."""
    system, _ = two_nodes()
    history = table(system, [*([0, 0], [1, 0]) * 4, [0, 1]])
    with pytest.raises(rf.NoQuasiStaticContinuation) as caught:
        rf.evolve(system, history, rf.SolverOptions(branch=1))
    found = re.findall(r"cycle 0, leg (\d), s = 0 \(nodes \[0\], 1 of 2\)", str(caught.value))
    assert found == ["0", "2", "4"] and " and 1 more: " in str(caught.value)


def test_rules_take_the_continuation_they_name() -> None:
    system, history = node_of_three_solutions(), table(node_of_three_solutions(), [[0.0], [1.0]])
    states = {}
    for rule in ("first", "least dissipation", "most dissipation", 1, 2, 3, 9):
        record = rf.evolve(system, history, rf.SolverOptions(branch=rule))
        states[rule] = int(record.turning_points.state[0, 0])
        # "first" does not look for others
        assert [c.solutions for c in record.choices] == ([] if rule == "first" else [3])
    assert states["most dissipation"] == BACKWARD
    assert states["least dissipation"] == states["first"] == states[1] == STICK
    assert {states[1], states[2], states[3]} == {STICK, SEPARATION, BACKWARD}
    assert states[9] == states[3]
    # of a choice among three and one between two the larger number is told
    node = small_system([[1.0, 0.9], [0.9, 1.0]], {"a": [1.3, 1.0], "b": [0.0, 1.0]}, 1.5)
    most = rf.SolverOptions(branch="most dissipation")
    record = rf.evolve(node, table(node, [[0, 0], [1, 0], [0, 1]]), most)
    assert [choice.solutions for choice in record.choices] == [3, 2]
    assert rf.given(record.uniqueness).solutions == 3


def test_rules_take_what_dissipates_least_and_most_just_beyond_the_choice() -> None:
    compared, loads = Counter[tuple[int, bool]](), {"a": [0.0, 0, 1, 0], "b": [0.0, 1.3, 0, 1]}
    # the second node has no force before: the next term decides
    idle = small_system(np.kron([[1.0, 0.9], [0.9, 1.0]], np.eye(2)), loads, 1.5)
    problems = *map(random_problem, range(16)), *map(pairs, (12, 24, 38))
    for system, history in (*problems, (idle, table(idle, [[0, 0], [1, 0], [1, 1]]))):
        log = rf.branches(system, history, most=1)[0].choices
        if not log or (first := log[0]).s > 0.99:
            continue
        path, s = history.path[: first.leg + 2].copy(), first.s + (1e-3 if first.s else 1.0)
        path[-1] = (1.0 - s) * path[-2] + s * path[-1] if s < 1.0 else path[-1]
        found = {}
        for rule in (*range(1, first.solutions + 1), "least dissipation", "most dissipation"):
            with suppress(rf.SolveError):
                record = rf.evolve(system, table(system, path), rf.SolverOptions(branch=rule))
                if len(record.choices) == 1:  # of several the rules decide each
                    found[rule] = record.dissipation_first_loading
        if len(found) < first.solutions + 2:
            continue
        least, most = found.pop("least dissipation"), found.pop("most dissipation")
        ends = min(found.values()), max(found.values())
        assert (least, most) == pytest.approx(ends, rel=1e-13, abs=1e-16), found
        compared[first.leg, first.s > 0.0] += least < most
    assert min(compared[0, False], compared[1, True], compared[1, False]) > 0, compared


def test_the_first_continuation_is_the_same_path_whether_others_are_looked_for_or_not() -> None:
    """One node jumps at s = 4/11 of the second leg, with what is asked for on a jump."""
    node = small_system([[2.0, 1.5], [1.5, 2.0]], {"a": [1, 1], "b": [0, -1]}, 2.0)
    history = table(node, [[0, 0], [1, 0], [0.25, 1]])
    for branch in ("first", 1, "least dissipation"):
        with pytest.raises(rf.NoQuasiStaticContinuation):
            rf.evolve(node, history, rf.SolverOptions(branch=branch))
        record = rf.evolve(node, history, rf.SolverOptions(branch=branch, on_jump="static"))
        assert record.jumps == 1
        assert record.released == pytest.approx(32 / 211.75, rel=1e-6)


def test_a_limited_tree_says_that_there_may_be_more() -> None:
    tree = rf.branches(*two_nodes(), most=2)
    assert len(tree) == 2 and tree.limited and not tree.complete
    assert "2 branches (there are more)" in str(tree)


def test_branches_are_those_that_all_sets_of_states_lead_to() -> None:
    several = 0
    for seed in range(36):
        system, history = random_problem(seed)
        try:
            expected = all_ends(system, history)
        except TooMany:
            continue
        tree = rf.branches(system, history, most=200)
        assert tree.complete, seed
        ends, failed = [], set()
        for branch in tree:
            if branch.failure:
                found = re.search(r"leg (\d+): .*\(s = (\S+) of the leg\)", branch.failure)
                assert found is not None, branch.failure
                failed.add((int(found[1]), round(float(found[2]) / PLACE)))
                continue
            end = branch.record.turning_points
            ends.append((len(history.path) - 2, 1.0, np.concatenate([end.v[-1], end.w[-1]])))
            assert replay(system, history, branch.record).found == [], seed
        whole = [end for end in expected if end[1] == 1.0]
        ends = different(ends)
        assert len(different(ends + whole)) == len(ends) == len(whole), seed
        assert failed == {(leg, round(s / PLACE)) for leg, s, _ in expected if s < 1.0}, seed
        several += len(tree) > 1
    assert several >= 8
