from dataclasses import replace

import numpy as np
import pytest
from hard import CASES, TRIALS, Case, judge

import receding_fenicsx as rf

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


@pytest.mark.parametrize("case", [pytest.param(c, id=c.name) for c in CASES if c.fast])
def test_hard_case_ends_as_expected(case: Case) -> None:
    outcome, said, as_expected = judge(case)
    assert as_expected, f"{outcome}, expected {case.expected}: {said}"


def test_a_body_that_turns_about_one_node_is_solved_whatever_round_off_its_stiffness_has() -> None:
    scene = rf.read_scene(TRIALS / "rock.toml", ["mesh.contact_elements=20"])
    system, history = rf.given(rf.condense(scene)), rf.history_from_scene(scene)
    spread = []
    for seed in range(4):
        noise = np.random.default_rng(seed).normal(size=system.K.shape)
        noisy = replace(system, K=system.K * (1.0 + np.finfo(float).eps * (noise + noise.T)))
        spread.append(rf.evolve(noisy, history, scene.solver).turning_points.P[-1])
    assert np.ptp(spread, axis=0).max() <= 1e-9 * np.max(spread)
