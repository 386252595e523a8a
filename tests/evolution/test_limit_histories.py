"""Limits of infinitely many cycles of other bodies and loads, against plain playing."""

from collections.abc import Callable
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
from small import table

import receding_fenicsx as rf
from receding_fenicsx.interface.system import ContactSystem

pytestmark = pytest.mark.one_rank


def polygon(corners: int, phase: float) -> np.ndarray:
    """Return corners of a cycle of press and push, out of phase."""
    angle = 2.0 * np.pi * (np.arange(corners + 1) % corners) / corners
    return np.stack([1.0 + 0.4 * np.cos(angle), 0.25 * np.sin(angle + phase)], axis=1)


def assert_same(limit: rf.Record, plain: rf.Record) -> None:
    """Assert that a limit that was searched for is that of plain cycles."""
    assert limit.limit is not None and limit.limit.jumped, limit.limit
    assert plain.steady.reached
    D, last = limit.cycles.dissipation, plain.cycles.dissipation[-1]
    assert last > 0.0 and abs(D[-1] - last) < 1e-7 * last
    v, w = limit.turning_points.v[-1], plain.turning_points.v[-1]
    assert np.abs(v - w).max() < 1e-6 * np.abs(w).max()
    assert limit.residual_max < 1e-11


@pytest.mark.parametrize("phase", [0.0, 0.5, 1.2])
def test_the_limit_of_loads_out_of_phase_is_that_of_plain_cycles(phase: float) -> None:
    system, loop = pushed_block(), polygon(6, phase)
    history = table(system, [np.zeros(2), loop[0]], loop, 400)
    solver = rf.SolverOptions(steady_tolerance=1e-10)
    plain = rf.evolve(system, history, solver, until="steady")
    assert_same(rf.evolve(system, history, until="limit"), plain)


@pytest.mark.parametrize("elements", [12, 16])
def test_the_limit_of_a_wedge_damper_is_that_of_plain_cycles(elements: int) -> None:
    # nodes of one face slip both ways at first, and only forward once the other face has settled
    file = Path(__file__).parents[1] / "trials" / "wedge_damper.toml"
    scene = rf.read_scene(file, [f"mesh.contact_elements={elements}", "history.cycles=800"])
    system = rf.condense(scene)
    if system is None:
        return
    found = rf.evolve(system, scene, until="limit")
    solver = rf.SolverOptions(steady_tolerance=1e-11)
    plain = rf.evolve(system, replace(scene, solver=solver), until="steady")
    assert_same(found, plain)
    assert found.limit is not None and len(found.limit.reason) < 200


@pytest.mark.parametrize(
    ("made", "seed"),
    [(under_four_loads, seed) for seed in (12, 38, 338, 428, 738, 4239, 91729, 702941)]
    + [(tall_under_four_loads, seed) for seed in (20985, 101054)]
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
    limit = rf.evolve(block, table(block, path, loop, 300), until="limit")
    plain = rf.evolve(block, table(block, path, loop, 1000), solver, until="steady")
    assert_same(limit, plain)
