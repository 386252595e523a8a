"""Limits of infinitely many cycles of other bodies and loads, against plain playing."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import (
    directed_under_four_loads,
    gapped_under_four_loads,
    pushed_block,
    tall_under_four_loads,
    under_four_loads,
)
from replay import replay
from small import table, walker

import receding_fenicsx as rf
from receding_fenicsx.evolution.limit import search
from receding_fenicsx.evolution.limit.tail import NoLimit, follow, trace
from receding_fenicsx.evolution.replay import state_at, turning_point
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.system import ContactSystem, frictional_form

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


def assert_same(limit: rf.Record, plain: rf.Record, walks: bool = False) -> None:
    """Assert that a limit that was searched for is that of plain cycles, up to a rigid walk."""
    assert limit.limit is not None and limit.limit.jumped, limit.limit
    assert plain.steady.reached and limit.steady.kind == plain.steady.kind
    assert (limit.steady.kind == "ratchetting") == walks
    D, last = limit.cycles.dissipation, plain.cycles.dissipation[-1]
    assert last > 0.0 and abs(D[-1] - last) < 1e-7 * last
    ends = limit.turning_points, plain.turning_points
    for name in ("P", "Q", "w") if walks else ("P", "Q", "v", "w"):
        one, two = (getattr(end, name)[-1] for end in ends)
        size = np.abs([ends[1].P[-1], ends[1].Q[-1]] if name in "PQ" else two).max()
        assert np.abs(one - two).max() <= 1e-6 * size, name
    gained, known = (record.cycles.slip_increment[-1] for record in (limit, plain))
    size = np.abs(known).max() if walks else np.abs(ends[0].v[-1]).max()
    assert np.abs(gained - known).max() < 1e-7 * size
    assert limit.residual_max < 1e-11


def test_the_limit_of_a_wedge_damper_is_that_of_plain_cycles() -> None:
    # nodes of one face slip both ways at first, and only forward once the other face has settled
    file = Path(__file__).parents[1] / "trials" / "wedge_damper.toml"
    scene = rf.read_scene(file, ["mesh.contact_elements=12", "history.cycles=800"])
    system = rf.given(rf.condense(scene))
    found = rf.evolve(system, scene, until="limit")
    solver = rf.SolverOptions(steady_tolerance=1e-11)
    plain = rf.evolve(system, replace(scene, solver=solver), until="steady")
    assert_same(found, plain)
    assert found.limit is not None and len(found.limit.reason) < 200


@pytest.mark.parametrize(
    ("made", "seed"),
    [(under_four_loads, seed) for seed in (12, 38, 338, 428, 738, 4239, 91729, 702941)]
    + [(tall_under_four_loads, seed) for seed in (13, 24, 20985, 101054)]
    + [(gapped_under_four_loads, 800766)]
    + [(directed_under_four_loads, seed) for seed in (800817, 8800759)],
)
def test_limits_under_several_loads_are_those_of_plain_cycles(
    made: Callable[[int], tuple[ContactSystem, list[list[float]]]], seed: int
) -> None:
    # with seed 38 a node slips both ways in the first cycles, and comes to rest: where is not known
    # before they are played; from 338 on nodes pass the limit that is found first; on the tall ones
    # after twenty cycles: in one only drifts foreseen a little otherwise tell, in the other the
    # margin that the node is left with at first hides it; with 702941 a node that opens and slips
    # in the first cycles rests in the limit found first, but for 2e-13 of round-off, elsewhere.
    # With gaps the nodes at one end drift slower than foreseen, and others pass by 1e-6; with other
    # friction backward a node passes by 1e-6 once only what others forget is left
    block, loop = made(seed)
    path = [[0.0] * 4, [1.0, 0.0, 0.0, 0.0], loop[0]]
    solver = rf.SolverOptions(steady_tolerance=1e-11)
    plain = rf.evolve(block, table(block, path, loop, 1000), solver, until="steady")
    # a search as the history goes on, or the one that goes on where it has ended
    limits = [rf.evolve(block, table(block, path, loop, n), until="limit") for n in (300, 8)]
    for limit in limits:
        assert_same(limit, plain)
    played, last = (rf.given(limit.limit) for limit in limits)
    assert (last.cycles_played, last.cycle) == (played.cycles_played, min(8, played.cycle))
    # from any cycle on the limit is foreseen or refused, and cycles that release in other orders
    rows = [row for row in map(plain.start_row, range(1, 1000)) if row is not None]
    starts, force = [turning_point(plain, block, row) for row in rows], plain.turning_points.P.max()
    u, others = np.array([start.u for start in starts]), 0
    close, segments = 1e-6 * np.abs(u[-1]).max(), Segments(frictional_form(block))
    for start in starts[:11]:
        with suppress(NoLimit):
            tail = follow(trace(segments, start, np.array(loop), force), force, 1e-10 * force)
            assert np.abs(tail.u - u[-1]).max() < close
            for begin, end in tail.others:
                n = int(np.argmin(np.abs(u - begin).max(axis=1)))
                assert n > 0 and np.abs(u[n : n + 2] - [begin, end]).max() < 1e-3 * close
                others += 1
    assert others or seed not in (24, 702941)


def rocked() -> tuple[ContactSystem, rf.History]:
    """Return the block pushed by a constant force while the pressure moves to and fro."""
    block = pushed_block()
    tilt = np.concatenate([np.zeros(block.n), block.weight * block.x])
    body = replace(block, r_star=np.vstack([block.r_star, tilt]), load_names=("p0", "push", "tilt"))
    loop = [[1, 0.195, 0.2], [1, 0.195, -0.2], [1, 0.195, 0.2]]
    return body, table(body, [[0, 0, 0], [1, 0, 0], [1, 0.195, 0], loop[0]], loop, 400)


def test_the_limit_of_a_walk_is_that_of_plain_cycles_and_keeps_the_laws_from_its_start() -> None:
    body, history = rocked()
    walk = rf.evolve(body, history, until="limit")
    solver = rf.SolverOptions(steady_tolerance=1e-10)
    assert_same(walk, rf.evolve(body, history, solver, until="steady"), walks=True)
    assert np.any(walk.turning_points.state[-1] == 2)  # open nodes move with the body
    assert replay(body, history, walk).found == []
    n, samples = len(walk.cycles.dissipation), walk.samples
    row = int(np.flatnonzero((samples.cycle == n) & (samples.leg == 0))[5])
    at = state_at(walk, body, history, rf.SolverOptions(), (n, 0, float(samples.s[row])))
    assert np.abs(at.v - samples.v[row]).max() < 1e-10 * np.abs(at.v).max()


@pytest.mark.parametrize("first", [1, 3])
def test_two_feet_walk_by_the_closed_form(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """Each gains 0.4/k a cycle, found by a search from its first cycle, or as it is played."""
    monkeypatch.setattr(search, "FIRST_SEARCH", first)
    path = [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 0.5, 0.9]]
    loop = [[1, 0.5, 0.9], [1, 0.5, -0.9], [1, 0.5, 0.9]]
    record = rf.evolve(walker(4.0), table(walker(4.0), path, loop, 20), until="limit")
    assert record.limit is not None and record.limit.reached
    assert record.limit.jumped == (first == 1) and record.steady.kind == "ratchetting"
    # a search plays the cycle before, the one that it finds and the next
    assert record.limit.cycles_played == (1 + 3 if first == 1 else record.steady.cycle)
    assert rf.summarise(record)["limit"]["walk"] == pytest.approx(0.1, rel=1e-12)
