"""The numbers that a search is asked for: their estimates, and whether they are met."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from receding_fenicsx.accuracy.estimate import Estimate, Level, estimates_of
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.options import LOCAL_NUMBERS

MIN_LEVELS = 3
"""Smallest number of meshes of an accepted estimate."""


def asked_numbers(scene: Scene, levels: Sequence[Level]) -> dict[str, Estimate]:
    """Return the estimates of the numbers that were asked for, on the last of some meshes."""
    every = estimates_of(levels)
    wanted = scene.accuracy.numbers
    if not wanted:
        return {n: e for n, e in every.items() if n.partition("[")[0] not in LOCAL_NUMBERS}
    found = {n: e for n, e in every.items() if n in wanted or n.partition("[")[0] in wanted}
    for name in wanted:
        if not _has(levels[-1], name):
            if len(levels) > 1 and not _has(levels[-2], name):
                raise InputError(
                    f"[accuracy] numbers: the run has no '{name}'; it has {', '.join(every)}"
                )
            found[name] = Estimate(math.nan, math.nan, math.nan, 1.0)
    return found


def _has(level: Level, name: str) -> bool:
    """Return whether a run has a number, or one of that name in front of brackets."""
    return any(name in (n, n.partition("[")[0]) for n in level.numbers)


def is_met(asked: Mapping[str, Estimate], tolerance: float) -> bool:
    """Return whether twice the estimate of each number is within the tolerance."""
    return bool(asked) and all(2.0 * e.relative <= tolerance for e in asked.values())


def hopeless(way: Sequence[Mapping[str, Estimate]]) -> str:
    """Return why no mesh will do: a number does not converge on two meshes running."""
    if len(way) < 2:
        return ""
    now, before = way[-1], way[-2]
    names = [n for n in now if n in before and now[n].error == before[n].error == math.inf]
    infinite = [n for n in names if now[n].value == before[n].value == math.inf]
    if infinite:
        return (
            f"{', '.join(infinite)} does not converge: singular, stresses are infinite at a corner "
            "in contact; ask for other numbers"
        )
    if not names or len(way) < MIN_LEVELS + 1:
        return ""
    return (
        f"{', '.join(names)} {'does' if len(names) == 1 else 'do'} not converge in order "
        "(singular, or the mesh is far from resolving it); ask for other numbers"
    )
