"""Limits of a run's history from further initial slips, for its summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.histories.tightening import tightened
from receding_fenicsx.evolution.limit.starts import (
    FAILED,
    SteadyStates,
    check_first_leg,
    steady_states,
)
from receding_fenicsx.evolution.prepare import system_for
from receding_fenicsx.evolution.problem import problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.report.cycles import limit_summary
from receding_fenicsx.scene.model import Scene

FEWEST = 2
"""Smallest number of starts that can differ."""

SAME = 1e-8
"""Difference of dissipations, over the largest, that counts as none."""


def check_starts(scene: Scene, starts: int) -> None:
    """Raise InputError unless a scene can be run from so many starts; 0 asks for none."""
    if starts and starts < FEWEST:
        raise InputError(f"--starts: {starts} given; give at least {FEWEST}, or leave it out")
    if starts and scene.history.until != "limit":
        raise InputError('--starts: needs [history] until = "limit"; set it, or leave out --starts')


def check_landings(system: ContactSystem, scene: Scene, starts: int) -> None:
    """Raise InputError where a run cannot be played from so many initial slips.

    Asked before the run, which may take long.
    """
    if not np.any(system_for(scene, system).g0 > 0.0):
        return
    problem = problem_of_scene(system, tightened(system, scene))
    try:
        check_first_leg(problem, starts)
    except InputError as error:
        raise InputError(f"--starts: every start but rest is an initial slip; {error}") from error


def limit_with_starts(
    system: ContactSystem, scene: Scene, record: Record, starts: int
) -> dict[str, Any]:
    """Evolve a history from many initial slips; return the summary's key "limit" with the results.

    Args:
        system: the condensed body.
        scene: what was run.
        record: its record.
        starts: number of initial slips: rest, extreme ones, then random ones
            (:func:`~receding_fenicsx.evolution.limit.starts.steady_states`).
    """
    states = steady_states(system, scene, starts)
    limit: Mapping[str, Any] = limit_summary(record)["limit"]
    return {"limit": {**limit, "starts": starts_summary(states)}}


def starts_summary(states: SteadyStates) -> dict[str, Any]:
    """Return how far steady states differ: dissipation, kinds and states of the nodes.

    The spread is the difference of the largest and smallest dissipation over the largest; None
    where none dissipates.
    """
    low, high = states.interval
    played = [k for k, kind in enumerate(states.kind) if kind != FAILED]
    patterns, of_start = np.unique(states.state[played], axis=0, return_inverse=True)
    first = [played[int(np.argmax(of_start == p))] for p in range(len(patterns))]
    kinds, spread = states.counts, (high - low) / high if high > 0.0 else None
    return {
        "count": len(states.names),
        "same": len(kinds) == len(patterns) == 1 and (spread or 0.0) <= SAME,
        "dissipation": [low, high] if np.isfinite(low) else None,
        "spread": spread,
        "kinds": kinds,
        "nodes": len(states.x),
        "nodes_that_differ": int(np.ptp(patterns, axis=0).astype(bool).sum()) if played else 0,
        "zones": [
            {"starts": int(np.sum(of_start == p)), "zones": states.zones(k)}
            for p, k in enumerate(first)
        ],
        "errors": dict(states.errors),
    }
