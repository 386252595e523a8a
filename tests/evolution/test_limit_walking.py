"""Limits of ratchetting: bodies that walk by a rigid motion in every cycle."""

from dataclasses import replace

import numpy as np
import pytest
from models import pushed_block
from replay import replay
from small import table, walker

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.limit import search
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.replay import state_at
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import SolverOptions

pytestmark = pytest.mark.one_rank


def rocked(push: float) -> tuple[ContactSystem, History]:
    """Return the block pushed by a constant force while the pressure moves to and fro."""
    block = pushed_block()
    tilt = np.concatenate([np.zeros(block.n), block.weight * block.x])
    body = replace(block, r_star=np.vstack([block.r_star, tilt]), load_names=("p0", "push", "tilt"))
    loop = [[1, push, 0.2], [1, push, -0.2], [1, push, 0.2]]
    return body, table(body, [[0, 0, 0], [1, 0, 0], [1, push, 0], loop[0]], loop, 400)


@pytest.fixture(scope="module")
def walk() -> Record:
    return evolve(*rocked(0.195), until="limit")


def test_the_limit_of_a_walk_is_that_of_plain_cycles(walk: Record) -> None:
    solver = SolverOptions(steady_tolerance=1e-10)
    plain = evolve(*rocked(0.195), solver, until="steady")
    assert plain.steady.kind == walk.steady.kind == "ratchetting" and plain.steady.cycle > 15
    assert walk.limit is not None and walk.limit.jumped and walk.limit.cycles_played < 15
    force = plain.turning_points.P.max()
    for name in ("P", "Q"):
        a, b = (getattr(record.turning_points, name)[-1] for record in (walk, plain))
        assert np.abs(a - b).max() < 1e-9 * force, name
    gained = walk.cycles.slip_increment[-1]
    closed = gained != 0.0
    assert np.ptp(gained[closed]) < 1e-10 * gained.max() and gained.max() > 0.0
    assert np.abs(gained - plain.cycles.slip_increment[-1]).max() < 1e-8 * gained.max()
    assert np.isclose(walk.cycles.dissipation[-1], plain.cycles.dissipation[-1], rtol=1e-8)


def test_the_cycle_of_a_walk_holds_all_laws_from_its_own_start(walk: Record) -> None:
    body, history = rocked(0.195)
    assert np.any(walk.turning_points.state[-1] == 2)  # open nodes move with the body
    assert replay(body, history, walk).found == []
    n, samples = len(walk.cycles.dissipation), walk.samples
    row = int(np.flatnonzero((samples.cycle == n) & (samples.leg == 0))[5])
    at = state_at(walk, body, history, SolverOptions(), (n, 0, float(samples.s[row])))
    assert np.abs(at.v - samples.v[row]).max() < 1e-10 * np.abs(at.v).max()


@pytest.mark.parametrize("until", ["search", "play"])
def test_two_feet_walk_by_the_closed_form(monkeypatch: pytest.MonkeyPatch, until: str) -> None:
    # as in tests/interface/exact/test_path.py: each foot gains 0.4/k a cycle
    monkeypatch.setattr(search, "FIRST_SEARCH", 1 if until == "search" else 3)
    path = [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 0.5, 0.9]]
    loop = [[1, 0.5, 0.9], [1, 0.5, -0.9], [1, 0.5, 0.9]]
    record = evolve(walker(4.0), table(walker(4.0), path, loop, 20), until="limit")
    assert record.limit is not None and record.limit.reached
    assert record.limit.jumped == (until == "search")
    assert record.steady.kind == "ratchetting"
    assert summarise(record)["limit"]["walk"] == pytest.approx(0.1, rel=1e-12)
