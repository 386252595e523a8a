"""Profiles: values along an edge, given as a number, an expression, a table or a file."""

from __future__ import annotations

from typing import Annotated, cast

import numpy as np
from numpy.typing import ArrayLike

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import Number, OneOf, check_size
from receding_fenicsx.scene.expressions import evaluate_expression

Profile = Number | str | dict[Annotated[str, OneOf("x", "value")], list[Number]]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""

DIRECTIONS = ("forward", "backward")
"""Directions of slip, keys of a friction that differs between them."""

FrictionProfile = Profile | dict[Annotated[str, OneOf(*DIRECTIONS)], Profile]
"""A profile, or one for each of the ``DIRECTIONS``."""


def evaluate(profile: Profile, x: ArrayLike, y: ArrayLike | None = None) -> Array:
    """Evaluate a profile; a table is linear between its points and constant beyond its ends.

    Args:
        profile: number, expression or table.
        x: points.
        y: second coordinate of the points, for expressions that use it.

    Returns:
        Values, of the shape of ``x``.

    Raises:
        InputError: the expression cannot be read, or its value is not finite at one of the points.
    """
    points = np.asarray(x, dtype=float)
    if isinstance(profile, str):
        return evaluate_expression(
            profile, points, None if y is None else np.asarray(y, dtype=float)
        )
    if isinstance(profile, dict):
        return np.interp(points, profile["x"], profile["value"])
    return np.full(points.shape, float(profile))


def directions(friction: FrictionProfile, where: str = "friction") -> tuple[Profile, Profile]:
    """Return the profiles of friction for forward and backward slip.

    Args:
        friction: one profile, or one for each direction.
        where: table and key, for messages.

    Raises:
        InputError: one of the directions is missing, or there is another key.
    """
    if not isinstance(friction, dict) or set(friction) <= {"x", "value"}:
        profile = cast(Profile, friction)
        return profile, profile
    if set(friction) != set(DIRECTIONS):
        raise InputError(
            f"{where}: needs both directions of slip, {{forward = ..., backward = ...}}"
        )
    forward, backward = (cast(Profile, friction[key]) for key in DIRECTIONS)
    return forward, backward


def check_table(profile: Profile, where: str) -> None:
    """Raise InputError for a table that is incomplete or unsorted; other profiles pass.

    Args:
        profile: number, expression or table.
        where: table and key, for messages.
    """
    if not isinstance(profile, dict):
        return
    if set(profile) != {"x", "value"}:
        raise InputError(f"{where}: a table needs two lists, {{x = [...], value = [...]}}")
    points, values = (np.asarray(profile[key], dtype=float) for key in ("x", "value"))
    if len(points) != len(values) or len(points) < 2:
        raise InputError(
            f"{where}: a table needs two lists of equal length (at least 2), not "
            f"{len(points)} and {len(values)} values"
        )
    if np.any(np.diff(points) <= 0.0):
        raise InputError(f"{where}: x of the table must increase from value to value; sort it")


def evaluate_checked(profile: Profile, x: Array, y: Array | None, where: str) -> Array:
    """Check a profile and evaluate it.

    Args:
        profile: number, expression or table.
        x: points along the whole edge, or along the part of it that the profile is for.
        y: second coordinate of the points; None where an expression may use x only.
        where: table and key, for messages.

    Raises:
        InputError: the table is incomplete, unsorted or beside all points, the expression cannot be
            read, or a value is not finite or too large.
    """
    check_table(profile, where)
    if isinstance(profile, dict) and min(profile["value"]) < max(profile["value"]):
        (low, high), (left, right) = ((p[0], p[-1]) for p in (profile["x"], np.sort(x)))
        slack = 1e-9 * (right - left)
        if high < left - slack or low > right + slack:
            raise InputError(
                f"{where}: the table runs from x = {low:g} to {high:g}, beside the edge, which "
                f"runs from {left:g} to {right:g}; check its unit and origin"
            )
    try:
        found = evaluate(profile, x, y)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    check_size(float(np.abs(found).max(initial=0.0)), where)
    return found
