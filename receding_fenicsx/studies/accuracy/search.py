"""Search for the mesh on which the numbers of a run meet a tolerance.

Meshes of one family are solved from a coarse one on; those on the way are the coarser meshes of the
estimates. The size of the next one follows from the observed orders.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from receding_fenicsx.errors import InputError, MeshMisfit, SolveError
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.options import LOCAL_NUMBERS
from receding_fenicsx.studies.accuracy.estimate import (
    MIN_RATIO,
    ORDERS,
    Estimate,
    Level,
    estimates_of,
    shown,
)
from receding_fenicsx.studies.accuracy.meshes import (
    doublings,
    elements_near,
    first_that_fits,
    is_graded,
    is_refined,
    scaled_mesh,
    to_limit,
)

log = logging.getLogger(__name__)

MIN_LEVELS = 3
"""Smallest number of meshes of an accepted estimate."""
RATIOS = (1.6, 2.8)
"""Smallest and largest ratio of the elements of two successive meshes: smaller ones repeat work,
larger ones leave the estimate without meshes to compare with."""
MOST_NODES = 8000
"""Largest number of contact nodes: their condensed stiffness takes 2 GB."""


@dataclass
class Search:
    """A search: the meshes so far, and how it ended.

    Attributes:
        scene: the scene of the last mesh.
        levels: the meshes, from the coarsest.
        failures: (elements, reason) of meshes on which the scene has no answer.
        way: for each mesh the estimates of the asked numbers.
        met: the tolerance is met.
        reason: why it is not; "" where it is.
    """

    scene: Scene
    levels: list[Level] = field(default_factory=list)
    failures: list[tuple[int, str]] = field(default_factory=list)
    way: list[dict[str, Estimate]] = field(default_factory=list)
    met: bool = False
    reason: str = ""

    def shown(self) -> dict[str, Any]:
        """Return the key "accuracy" of the summary."""
        options = self.scene.accuracy
        return {
            "tolerance": options.tolerance,
            "budget_seconds": options.budget_seconds,
            "met": self.met,
            "graded": is_graded(self.scene),
            "reason": self.reason,
            "seconds": sum(level.seconds for level in self.levels),
            "failures": [list(failure) for failure in self.failures],
            "way": [
                {
                    "elements": level.elements,
                    "nodes": level.nodes,
                    "seconds": level.seconds,
                    "numbers": shown(found),
                }
                for level, found in zip(self.levels, self.way, strict=True)
            ],
        }


Solve = Callable[[Scene, int], Level]
"""Goes from a scene and its elements to what a run found, on all ranks alike."""


def search(
    scene: Scene, solve: Solve, graded: Callable[[Scene], Scene | None] = lambda _: None
) -> Search:
    """Solve a scene on finer and finer meshes until its numbers meet its tolerance; collective.

    Args:
        scene: a scene with ``accuracy.tolerance``.
        solve: runs the scene of a mesh; raises MeshMisfit where its vertices do not fit the scene.
        graded: returns a scene whose meshes are graded, None where they cannot be; called where the
            first mesh has sharp corners in contact, which then begins anew.

    Returns:
        The search; the run of the last mesh is the last that ``solve`` has done.

    Raises:
        InputError: no mesh fits the scene, or the run has no such number.
        SolveError: the scene has no answer on a mesh as fine as its own.
    """
    tolerance = scene.accuracy.tolerance
    assert tolerance is not None
    scene, own = to_limit(scene), scene.mesh.contact_elements
    found = Search(scene)
    while True:
        wanted = next_elements(scene, found.levels, found.failures)
        found.reason = _too_much(scene, found.levels, wanted)
        if found.reason:
            found.reason += _wants(found)
            return found
        try:
            level = _solved(scene, wanted, solve)
        except SolveError as error:
            if found.levels or wanted >= own:
                raise
            # a mesh as coarse as this may have no answer
            found.failures.append((wanted, str(error)))
            continue
        found.scene = scaled_mesh(scene, level.elements)
        anew = level.sharp and not found.levels and not is_graded(scene)
        finer = graded(found.scene) if anew else None
        if finer is not None:
            log.info("sharp corners in contact: meshes are graded")
            scene = finer
            continue
        found.levels.append(level)
        found.way.append(asked_numbers(scene, found.levels))
        for name, e in found.way[-1].items():
            log.info("%d elements: %s %.6g, error %.1e", level.elements, name, e.value, e.relative)
        found.met = len(found.levels) >= MIN_LEVELS and is_met(found.way[-1], tolerance)
        if found.met:
            return found
        found.reason = nonconvergence(found.way)
        if found.reason:
            return found


def next_elements(
    scene: Scene, levels: Sequence[Level], failures: Sequence[tuple[int, str]] = ()
) -> int:
    """Choose the next mesh from what was found: the one that is predicted to meet the tolerance.

    The error of a number falls with elements^-p, p its observed order. A mesh much finer than the
    last is approached in equal ratios. The finest is tried where no other could follow the next.
    """
    if not levels:
        first = doublings(scene)[0] if is_refined(scene) else 24
        return max([first, *(2 * elements for elements, _ in failures)])
    last = levels[-1].elements
    if is_refined(scene):
        return 2 * last
    ratio = 2.5  # from which the orders are seen
    if len(levels) >= MIN_LEVELS:
        asked, tolerance = asked_numbers(scene, levels), scene.accuracy.tolerance or 1.0
        needed = max(needed_ratio(asked, 0.75 * tolerance), RATIOS[0])
        # coarse meshes may have shown too little: mostly the next one shows a higher order
        slow = any(e.order < 1.0 and 2.0 * e.relative > tolerance for e in asked.values())
        most = 1.8 if slow else RATIOS[1]
        ratio = needed ** (1.0 / math.ceil(math.log(needed) / math.log(most)))
        finest = MOST_NODES / max(levels[-1].nodes, 1)
        does = needed_ratio(asked, tolerance) <= finest < ratio
        # after another mesh the finest would be too near to it
        is_last = ratio < needed and ratio <= finest < MIN_RATIO * ratio
        if finest >= MIN_RATIO and (does or is_last):
            return 2 * int(0.5 * finest * last)
    return 2 * math.ceil(0.5 * ratio * last)


def needed_ratio(asked: Mapping[str, Estimate], tolerance: float) -> float:
    """Return how many times as many elements the worst number needs, as errors fall with p."""
    return max((_needed(e, tolerance) for e in asked.values()), default=1.0)


def _needed(e: Estimate, tolerance: float) -> float:
    if not math.isfinite(e.error):
        return RATIOS[1]
    order = 1.0 if math.isnan(e.order) else min(max(e.order, ORDERS[0]), ORDERS[1])
    return float((2.0 * e.relative / tolerance) ** (1.0 / order))


def _too_much(scene: Scene, levels: Sequence[Level], wanted: int) -> str:
    """Return why a mesh is not begun: beyond the finest mesh or the budget; "" where it is."""
    if not levels:
        return ""
    last, budget = levels[-1], scene.accuracy.budget_seconds
    spent = sum(level.seconds for level in levels)
    ratio = wanted / last.elements
    if ratio * last.nodes > MOST_NODES or wanted > _most_elements(scene):
        return (
            f"the tolerance needs a mesh finer than the finest of {MOST_NODES} contact nodes"
            if not is_refined(scene)
            else "the tolerance needs more refinements of the mesh file than there are"
        )
    power = 2.0  # of the elements, with which the time of a run grows
    if len(levels) > 1 and levels[-2].seconds > 0.0 and last.seconds > levels[-2].seconds:
        seen = math.log(last.seconds / levels[-2].seconds)
        power = min(seen / math.log(last.elements / levels[-2].elements), 3.0)
    next_seconds = last.seconds * ratio**power
    if spent + next_seconds > budget:
        return (
            f"the budget of {budget:g} s ends first: {spent:.3g} s are spent, and a mesh of "
            f"{wanted} elements needs about {next_seconds:.2g} s"
        )
    return ""


def _wants(found: Search) -> str:
    """Return which numbers keep a search from its tolerance, with the meshes that they need."""
    tolerance, elements = found.scene.accuracy.tolerance or 1.0, found.levels[-1].elements
    words = ""
    for name, e in found.way[-1].items():
        if tolerance < 2.0 * e.relative < math.inf and not math.isnan(e.order):
            least = float(f"{elements * _needed(e, tolerance):.2g}")
            words += (
                f"; {name} needs about {least:g} elements, it converges with order {e.order:.1f}"
            )
    return words


def _most_elements(scene: Scene) -> int:
    """Return the elements of the finest mesh."""
    return doublings(scene)[-1] if is_refined(scene) else 4000


def _solved(scene: Scene, wanted: int, solve: Solve) -> Level:
    """Solve on the mesh nearest to a wanted one whose vertices fit the scene, or on a finer one."""
    near, reason = 1.0 if is_refined(scene) else 1.3, ""
    while wanted <= _most_elements(scene):
        numbers = elements_near(scene, wanted, (wanted / near, wanted * near))
        try:
            found = first_that_fits(scene, numbers, solve)
        except MeshMisfit as error:
            found, reason = None, str(error)
        if found is not None:
            return found[1]
        wanted *= 2
    raise InputError(f"[mesh]: no mesh that was tried fits the scene; on the last one: {reason}")


# -- the numbers that are asked for ------------------------------------------------------------


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


def nonconvergence(way: Sequence[Mapping[str, Estimate]]) -> str:
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
