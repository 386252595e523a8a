"""Profiles: values along an edge, given as a number, an expression or a table.

An expression such as ``"0.3 + 0.1*cos(pi*x)"`` is parsed by :mod:`ast`, and only the operations
listed below are evaluated. Nothing is passed to ``eval``, so a scene file cannot run code.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import reduce
from typing import Annotated, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import LARGEST, ByType, Number, OneOf, check_known, suggestion

TableProfile = dict[Annotated[str, OneOf("x", "value")], list[Number]]
Profile = Annotated[Number | str | TableProfile, ByType()]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""

DIRECTIONS = ("forward", "backward")
"""Directions of slip, keys of a friction that differs between them."""

FrictionProfile = Annotated[
    Number | str | TableProfile | dict[Annotated[str, OneOf(*DIRECTIONS)], Profile], ByType()
]
"""A profile, or one for each of the ``DIRECTIONS``."""


def evaluate(profile: Profile, x: ArrayLike, y: ArrayLike | None = None) -> Array:
    """Evaluate a profile at points; a table is linear between its points, constant beyond them."""
    points = np.asarray(x, dtype=float)
    if isinstance(profile, str):
        return evaluate_expression(profile, points, y)
    if isinstance(profile, dict):
        return np.interp(points, profile["x"], profile["value"])
    return np.full(points.shape, float(profile))


def directions(friction: FrictionProfile, where: str = "friction") -> tuple[Profile, Profile]:
    """Return the profiles of friction for forward and backward slip."""
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
    """Raise InputError for a table that is incomplete or unsorted; other profiles pass."""
    if not isinstance(profile, dict):
        return
    if set(profile) != {"x", "value"}:
        raise InputError(f"{where}: a table needs two lists, {{x = [...], value = [...]}}")
    n, m = len(profile["x"]), len(profile["value"])
    if n != m or n < 2:
        raise InputError(
            f"{where}: a table needs two lists of equal length (at least 2), not {n} and {m} values"
        )
    if np.any(np.diff(profile["x"]) <= 0.0):
        raise InputError(f"{where}: x of the table must increase from value to value; sort it")


def evaluate_checked(profile: Profile, x: Array, y: Array | None, where: str) -> Array:
    """Check a profile and evaluate it at points; ``y`` is None where it may use x only.

    InputError: a table is incomplete, unsorted or beside all points, an expression cannot be read,
    or a value is not finite or too large.
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
    largest = float(np.abs(found).max(initial=0.0))
    if largest > LARGEST:
        nearer = "choose units in which it is nearer to 1"
        raise InputError(f"{where}: {largest:g} is beyond {LARGEST:g}; {nearer}")
    return found


# -- expressions

FUNCTIONS: dict[str, tuple[Callable[..., Array], int, int]] = {
    **{name: (getattr(np, name), 1, 1) for name in "sqrt sin cos exp log tanh abs".split()},
    "min": (lambda *values: reduce(np.minimum, values), 2, 20),
    "max": (lambda *values: reduce(np.maximum, values), 2, 20),
    "where": (lambda test, yes, no: np.where(test != 0, yes, no), 3, 3),
}
"""Functions in expressions: implementation, smallest and largest number of arguments."""


def evaluate_expression(text: str, x: ArrayLike, y: ArrayLike | None = None) -> Array:
    """Evaluate an expression in ``x`` (and ``y``, unless None) at many points.

    It may use numbers, ``x``, ``y``, ``pi``, ``+ - * / **``, comparisons (1 if true, else 0) and
    ``min max abs sqrt sin cos exp log tanh where(test, yes, no)``.
    """
    if len(text) > 1000:  # longer ones may exceed the recursion limit of the parser
        raise InputError(f"expression of {len(text)} characters: at most 1000 are allowed")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(
            f"'{text}' is not an expression; write for example \"0.3 + 0.1*cos(pi*x)\""
        ) from None
    names: dict[str, Array] = {"x": np.asarray(x, dtype=float), "pi": np.asarray(np.pi)}
    if y is not None:
        names["y"] = np.asarray(y, dtype=float)
    with np.errstate(all="ignore"):
        try:
            value = _walk(tree.body, names, text)
        except RecursionError:
            raise InputError(f"'{text}': nested too deeply") from None
    result = np.broadcast_to(np.asarray(value, dtype=float), np.shape(x)).copy()
    bad = ~np.isfinite(result)
    if np.any(bad):
        where = np.asarray(x, dtype=float)[bad].flat[0]
        raise InputError(
            f"'{text}' is not a finite number at x = {where:.6g}; change the expression"
        )
    return result


def _walk(node: ast.expr, names: dict[str, Array], text: str) -> Array:
    """Return the value of one node of the parsed expression."""
    operators: dict[type[ast.AST], Callable[[Array, Array], NDArray[Any]]]
    operators = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide}
    operators |= {ast.Pow: np.power, ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater}
    operators |= {ast.GtE: np.greater_equal, ast.Eq: np.equal, ast.NotEq: np.not_equal}
    if isinstance(node, ast.Constant):
        number = node.value
        if isinstance(number, int | float) and not isinstance(number, bool):
            try:
                return np.asarray(float(number))
            except OverflowError:
                raise InputError(f"'{text}': a number is too large") from None
    if isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        hint = suggestion(node.id, [*names, *FUNCTIONS])
        hint = "only x may be used here" if node.id == "y" else hint
        raise InputError(f"'{text}': unknown name '{node.id}'; {hint}")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        value = _walk(node.operand, names, text)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in operators:
        sides = (_walk(side, names, text) for side in (node.left, node.right))
        return np.asarray(operators[type(node.op)](*sides), dtype=float)
    if isinstance(node, ast.Compare) and all(type(op) in operators for op in node.ops):
        values = [_walk(term, names, text) for term in (node.left, *node.comparators)]
        truth = np.asarray(1.0)
        for op, left, right in zip(node.ops, values, values[1:], strict=False):
            truth = truth * operators[type(op)](left, right)
        return truth
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        check_known(node.func.id, list(FUNCTIONS), f"'{text}'", "name")
        function, least, most = FUNCTIONS[node.func.id]
        if not least <= len(node.args) <= most:
            count = str(least) if least == most else f"{least} to {most}"
            raise InputError(
                f"'{text}': {node.func.id}() takes {count} argument(s), not {len(node.args)}"
            )
        arguments = [_walk(a, names, text) for a in node.args]
        return np.asarray(function(*arguments), dtype=float)
    hint = " (write ** for a power)" if "^" in text else ""
    raise InputError(
        f"'{text}': '{ast.unparse(node)}' is not allowed in an expression{hint}; use numbers, x, "
        f"y, pi, + - * / **, comparisons and {', '.join(FUNCTIONS)}"
    )
