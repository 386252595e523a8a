r"""History of kind "harmonic": an ellipse in the space of load factors, as a closed polygon.

Load $k$ follows

$$\lambda_k(\theta) = m_k + a_k \cos(\theta - \varphi_k)$$

with mean $m_k$, amplitude $a_k \ge 0$ and phase $\varphi_k$, the angle at which it is largest. A
cycle starts at the maximum of the first load with an amplitude.

The exact path needs straight legs, so the ellipse becomes a polygon with corners on it. The
extremes of every load are corners; the arcs between them are divided evenly. The polygon then
reaches the extreme load factors exactly, and deviates from the ellipse by $O(n^{-2})$ for $n$
corners. Where all loads are in phase or opposite, the ellipse is a straight line, and two corners
are exact.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.history.polyline import History
from receding_fenicsx.scene.model import Harmonic, HistoryOptions

FEWEST_CORNERS = 8
"""Corners of the coarsest polygon, where the scene does not fix their number."""
MOST_CORNERS = 4096
"""Corners of the finest polygon."""
DEFAULT_TOLERANCE = 1e-3
"""Largest error estimate of the dissipation per cycle due to the polygon, relative."""
SAME_ANGLE = 1e-9
"""Difference of angles, in degrees, that counts as round-off."""


def check_known(driven: Iterable[str], names: tuple[str, ...], key: str) -> None:
    """Raise InputError for a name under a key of [history] that no load has."""
    for name in driven:
        if name not in names:
            raise InputError(
                f"[history] {key}: no load is named '{name}'; {suggestion(name, names)}"
            )


def check_driven(
    driven: tuple[str, ...], names: tuple[str, ...], options: HistoryOptions, key: str
) -> None:
    """Check that a history drives all loads that are not constant, and these only.

    Args:
        driven: names of the loads that it drives.
        names: names of the loads that are not constant.
        options: the options of the history.
        key: key of [history] that names the driven loads.
    """
    for name in driven:
        if name in options.constant:
            raise InputError(
                f"[history] constant: load '{name}' varies, by [history] {key}; name it in one of "
                "them"
            )
    check_known(driven, names, key)
    for name in names:
        if name not in driven:
            raise InputError(
                f"load '{name}': is not driven by the history; remove it, name it in [history] "
                'constant, or use kind = "table" with a column for it'
            )


def from_harmonic(options: HistoryOptions, names: tuple[str, ...]) -> History:
    """Return the polygon of a harmonic history, and the path from rest to its first corner.

    The path leads from rest straight to the means, then straight to the first corner.

    Args:
        options: the options of the history; without ``corners`` the polygon is the coarsest one.
        names: names of the loads that are not constant.

    Raises:
        InputError: no load has an amplitude, or a load or an option is not valid.
    """
    loads = _checked_loads(options, names)
    angles = _angles(options, loads)
    mean = np.array([load.mean for load in loads])
    amplitude = np.array([load.amplitude for load in loads])
    phase = np.array([load.phase for load in loads])
    loop = mean + amplitude * _cosine(angles[:, None] - phase)
    loop = np.vstack([loop, loop[:1]])
    path = np.vstack([np.zeros_like(mean), mean, loop[0]])
    moves = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0.0, axis=1)])
    return History(names, path[moves], loop, options.cycles)


def corner_angles(options: HistoryOptions, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return the angles of the corners in degrees, from the start of a cycle to its end."""
    loads = [options.harmonic[name] for name in names if name in options.harmonic]
    angles = _angles(options, loads)
    return np.append(angles, angles[0] + 360.0)


def is_straight(options: HistoryOptions) -> bool:
    """Return whether all loads are in phase or opposite, so that two corners are exact."""
    return len(_extremes(list(options.harmonic.values()))) == 2


def _checked_loads(options: HistoryOptions, names: tuple[str, ...]) -> list[Harmonic]:
    """Return the loads in the order of their names."""
    if not options.harmonic:
        raise InputError(
            '[history] harmonic: is missing; give each load a table [history.harmonic."NAME"] with '
            "mean, amplitude and phase"
        )
    check_driven(tuple(options.harmonic), names, options, "harmonic")
    if not any(load.amplitude for load in options.harmonic.values()):
        raise InputError(
            "[history] harmonic: no load has an amplitude, so nothing is cyclic; give one an "
            'amplitude, or use kind = "monotonic"'
        )
    if options.corners is not None:
        least = len(_extremes(list(options.harmonic.values())))
        if options.corners < least:
            raise InputError(
                f"[history] corners: {options.corners} are too few; the extremes of the loads need "
                f"{least}"
            )
    return [options.harmonic[name] for name in names]


def _extremes(loads: list[Harmonic]) -> NDArray[np.float64]:
    """Return the angles of the loads' extremes, sorted, from 0 at the first load's maximum."""
    phases = np.array([load.phase for load in loads if load.amplitude])
    angles = np.concatenate([phases, phases + 180.0]) - phases[0]
    # round-off below a full turn is the first angle again
    angles = np.mod(angles + 0.5 * SAME_ANGLE, 360.0) - 0.5 * SAME_ANGLE
    angles = np.sort(angles)
    return angles[np.concatenate([[True], np.diff(angles) > SAME_ANGLE])]


def _angles(options: HistoryOptions, loads: list[Harmonic]) -> NDArray[np.float64]:
    """Return the angles of the corners in degrees, from the first load's maximum once around."""
    extremes = _extremes(loads)
    start = next(load.phase for load in loads if load.amplitude)
    if len(extremes) == 2:
        return start + extremes
    corners = max(options.corners or FEWEST_CORNERS, len(extremes))
    arcs = np.diff(np.append(extremes, 360.0))
    pieces = _shares(arcs / 360.0, corners)
    parts = [
        low + arc * np.arange(n) / n for low, arc, n in zip(extremes, arcs, pieces, strict=True)
    ]
    return start + np.concatenate(parts)


def _shares(parts: NDArray[np.float64], total: int) -> NDArray[np.int64]:
    """Divide a number in proportion to parts of 1, at least 1 to each.

    Twice a number gives twice the shares, so that no arc stays as it is when corners are doubled.
    """
    if total % 2 == 0 and total // 2 >= max(FEWEST_CORNERS, len(parts)):
        return 2 * _shares(parts, total // 2)
    found = np.ones(len(parts), dtype=np.int64)
    while found.sum() < total:
        # to the part whose pieces are the longest
        found[np.argmax(parts / found)] += 1
    return found


def _cosine(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosine of angles in degrees, exact at multiples of 90."""
    quarters = np.round(degrees / 90.0)
    rest = np.radians(degrees - 90.0 * quarters)
    turn = np.mod(quarters, 4.0)
    sign = np.where((turn == 1.0) | (turn == 2.0), -1.0, 1.0)
    return sign * np.where(turn % 2.0 == 1.0, np.sin(rest), np.cos(rest)) + 0.0
