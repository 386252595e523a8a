"""Profiles: values along an edge, given as a number, an expression or a table; files of columns.

An expression such as ``"0.3 + 0.1*cos(pi*x)"`` is parsed by :mod:`ast`, and only the operations
listed below are evaluated. Nothing is passed to ``eval``, so a scene file cannot run code.

Files of columns are profiles or measured rows of load factors: a line with the names of the
columns, then a row of numbers on each line. Columns are separated by semicolons, commas or tabs, or
else by blanks. Text after ``#``, lines that begin with ``%``, and empty lines are comments.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from re import sub
from typing import Annotated, Any, NoReturn, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene import checks
from receding_fenicsx.scene.checks import ByType, Number, OneOf

TableProfile = dict[Annotated[str, OneOf("x", "value")], list[Number]]
Profile = Annotated[Number | str | TableProfile, ByType()]
"""A number, an expression in x (and y), or a table {"x": [...], "value": [...]}."""

DIRECTIONS = ("forward", "backward")
"""Directions of slip, keys of a friction that differs between them."""

FrictionProfile = Annotated[
    Number | str | TableProfile | dict[Annotated[str, OneOf(*DIRECTIONS)], Profile], ByType()
]
"""A profile, or one for each of the ``DIRECTIONS``."""


def directions(friction: FrictionProfile, where: str = "friction") -> tuple[Profile, Profile]:
    """Return the profiles of friction for forward and backward slip."""
    if not isinstance(friction, dict) or set(friction) <= {"x", "value"}:
        profile = cast(Profile, friction)
        return profile, profile
    if set(friction) != set(DIRECTIONS):
        raise InputError(f"{where}: needs both, {{forward = ..., backward = ...}}")
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
        raise InputError(f"{where}: a table needs two lists of one length above 1, not {n} and {m}")
    if np.any(np.diff(profile["x"]) <= 0.0):
        raise InputError(f"{where}: x of the table must increase from value to value; sort it")


def evaluate_checked(profile: Profile, x: Array, y: Array | None, where: str) -> Array:
    """Check a profile and evaluate it at points; ``y`` is None where it may use x only.

    InputError: a table is incomplete, unsorted or beside all points, an expression cannot be read,
    or a value is not finite or too large.
    """
    check_table(profile, where)
    if isinstance(profile, dict) and len(x) and min(profile["value"]) < max(profile["value"]):
        (low, high), (left, right) = ((p[0], p[-1]) for p in (profile["x"], np.sort(x)))
        slack = 1e-9 * (right - left)
        if high < left - slack or low > right + slack:
            edge = f"the edge, which runs from {left:g} to {right:g}; check its unit and origin"
            raise InputError(f"{where}: the table runs from x = {low:g} to {high:g}, beside {edge}")
    try:
        found = evaluate(profile, x, y)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    largest = float(np.abs(found).max(initial=0.0))
    if largest > checks.LARGEST:
        raise InputError(f"{where}: {largest:g} is beyond {checks.LARGEST:g}; choose other units")
    return found


# -- expressions

FUNCTIONS: dict[str, tuple[Callable[..., Array], int, int]] = {
    **{name: (getattr(np, name), 1, 1) for name in "sqrt sin cos exp log tanh abs".split()},
    "min": (lambda *values: reduce(np.minimum, values), 2, 20),
    "max": (lambda *values: reduce(np.maximum, values), 2, 20),
    "where": (lambda test, yes, no: np.where(test != 0, yes, no), 3, 3),
}
"""Functions in expressions: implementation, smallest and largest number of arguments."""


def evaluate(profile: Profile, x: ArrayLike, y: ArrayLike | None = None) -> Array:
    """Evaluate a profile at points; a table is linear between its points, constant beyond them.

    An expression may use numbers, ``x``, ``y`` unless None, ``pi``, ``+ - * / **``, comparisons (1
    if true, else 0) and ``min max abs sqrt sin cos exp log tanh where(test, yes, no)``.
    """
    points = np.asarray(x, dtype=float)
    if isinstance(profile, dict):
        return np.interp(points, profile["x"], profile["value"])
    if not isinstance(profile, str):
        return np.full(points.shape, float(profile))
    text = profile
    if len(text) > 1000:  # longer ones may exceed the recursion limit of the parser
        raise InputError(f"expression of {len(text)} characters: at most 1000 are allowed")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(f"'{text}' is not an expression like 0.3 + 0.1*cos(pi*x)") from None
    names: dict[str, Array] = {"x": points, "pi": np.asarray(np.pi)}
    if y is not None:
        names["y"] = np.asarray(y, dtype=float)
    with np.errstate(all="ignore"):
        try:
            value = _walk(tree.body, names, text)
        except RecursionError:
            raise InputError(f"'{text}': nested too deeply") from None
    result = np.broadcast_to(np.asarray(value, dtype=float), points.shape).copy()
    for bad in points[~np.isfinite(result)]:
        raise InputError(f"'{text}' is not a finite number at x = {bad:.6g}; change it")
    return result


def _walk(node: ast.expr, names: dict[str, Array], text: str) -> Array:
    """Return the value of one node of the parsed expression."""
    operators: dict[type[ast.AST], Callable[[Array, Array], NDArray[Any]]]
    operators = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide}
    operators |= {ast.Pow: np.power, ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater}
    operators |= {ast.GtE: np.greater_equal, ast.Eq: np.equal, ast.NotEq: np.not_equal}
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return np.asarray(float(str(node.value)))  # of too large a number infinite
    if isinstance(node, ast.Name):
        if node.id in names:
            return names[node.id]
        hint = checks.suggestion(node.id, [*names, *FUNCTIONS])
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
        steps = zip(node.ops, values, values[1:], strict=False)
        return reduce(np.multiply, [operators[type(op)](a, b) for op, a, b in steps], np.ones(()))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        checks.check_known(node.func.id, list(FUNCTIONS), f"'{text}'", "name")
        function, least, most = FUNCTIONS[node.func.id]
        if not least <= len(node.args) <= most:
            count = str(least) if least == most else f"{least} to {most}"
            raise InputError(f"'{text}': {node.func.id}() takes {count}, not {len(node.args)}")
        return np.asarray(function(*[_walk(a, names, text) for a in node.args]), dtype=float)
    hint = " (write ** for a power)" if "^" in text else ""
    known = f"numbers, x, y, pi, + - * / **, comparisons and {', '.join(FUNCTIONS)}"
    raise InputError(f"'{text}': '{ast.unparse(node)}' is not allowed{hint}; use {known}")


# -- files of columns


@dataclass(frozen=True)
class Columns:
    """Numbers of a text file, all finite."""

    label: str  # key and path of the file, for messages
    names: tuple[str, ...]
    values: Array  # (rows, columns)
    lines: tuple[int, ...]  # line of each row

    def refuse(self, reason: str, row: int | None = None) -> NoReturn:
        """Raise InputError with the file, the line of a row if given, and a reason."""
        line = "" if row is None else f" line {self.lines[row]}:"
        raise InputError(f"{self.label}:{line} {reason}")

    def check_sorted(self, name: str, values: Array, wrong: NDArray[np.bool_]) -> None:
        """Refuse the first of the steps between the values of a column that are wrong."""
        for k in np.flatnonzero(wrong):
            follows = f"{name} = {values[k + 1]:g} follows {values[k]:g}"
            self.refuse(f"{follows}; sort the rows by {name}", int(k) + 1)


def read_columns(
    name: str, folder: Path, where: str, known: Sequence[str], default: Sequence[str] = ()
) -> Columns:
    """Read a text file of columns; ``where`` begins messages, ``default`` are names it may lack.

    The first line above the numbers with as many cells as they have names the columns; a comment
    does so only where it holds one of the known names.
    """
    label = f'{where} file "{name}"'
    text = read_text(folder / name, label).splitlines()
    without = ("" if line.lstrip()[:1] == "%" else line.partition("#")[0].strip() for line in text)
    filled = [(i, line) for i, line in enumerate(without, 1) if line]
    numbered = (any(n is not None for n in numbers_in(_cells(line))) for _, line in filled)
    first = next((k for k, found in enumerate(numbered) if found), None)
    if first is None:
        raise InputError(f"{label}: has no row of numbers; write one row a line")
    rows, head = filled[first:], filled[first][0] - 1
    mark = next((mark for mark in ";,\t" if mark in rows[0][1]), None)
    values: list[list[float]] = []
    for i, line in rows:
        cells = _cells(line, mark)
        numbers = numbers_in(cells)
        values.append([number for number in numbers if number is not None])
        for count, (cell, number) in enumerate(zip(cells, numbers, strict=True), 1):
            if "," in cell or number is None or not math.isfinite(number):
                what = f'column {count} is "{cell[:40]}", not a finite number with a decimal point'
                raise InputError(f"{label}: line {i}: {what}; mend it, or begin the line with #")
        if len(cells) != len(values[0]):
            first_row = f"line {rows[0][0]} has {len(values[0])}; all rows need the same"
            raise InputError(f"{label}: line {i}: has {len(cells)} column(s), {first_row}")

    def names_in(line: str) -> tuple[str, ...]:
        unit = r"\s*[\[(][^\])]*[\])]$"
        return tuple(cell if cell in known else sub(unit, "", cell) for cell in _cells(line, mark))

    headers = [names_in(line) for _, line in filled[:first]]
    comments = [names_in(line.strip()[1:].strip()) for line in text[:head] if line[:1] in "#%"]
    comments = [names for names in comments if {*known} & {*map(str.lower, names), *names}]
    found = [n for n in (*headers, *comments[::-1]) if len(n) == len(values[0]) and all(n)]
    if not found and (headers or len(default) != len(values[0])):
        reason = f"no line above the numbers names their {len(values[0])} column(s)"
        raise InputError(f"{label}: line {head or 1}: {reason}; name each, as in x,value")
    names = found[0] if found else tuple(default)
    columns = Columns(label, names, np.array(values), tuple(i for i, _ in rows))
    for one in (name for name in names if names.count(name) > 1):
        columns.refuse(f"the column '{one}' occurs twice; name each once")
    return columns


def _cells(line: str, separator: str | None = "") -> list[str]:
    """Return the cells of a line; separators are None for blanks, and "" for that of the line."""
    if separator == "":
        separator = next((mark for mark in ";,\t" if mark in line), None)
    return [cell.strip().strip("\"'").strip() for cell in line.split(separator)]


def numbers_in(cells: list[str]) -> list[float | None]:
    """Return numbers, also those with a decimal comma or D before the exponent; None for others."""
    found: list[float | None] = []
    for cell in cells:
        try:
            found.append(float(sub("[dD]", "E", cell.replace(",", ".").replace("_", "no number"))))
        except ValueError:
            found.append(None)
    return found


def _is_file(value: object) -> bool:
    """Return whether a value of a scene file is ``{file = "..."}``."""
    return isinstance(value, dict) and set(value) == {"file"} and isinstance(value["file"], str)


def with_files(raw: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace every ``{file = "..."}`` of a parsed scene by values, which are stored with it."""
    history = raw.get("history")
    if isinstance(history, dict):
        raw = {**raw, "history": _with_signals(history, raw.get("load", []), folder)}
    return {key: _with_profiles(value, folder, key) for key, value in raw.items()}


def _with_profiles(raw: Any, folder: Path, where: str) -> Any:
    """Return a part of a parsed scene with tables of x and value for files."""
    if isinstance(raw, list):
        return [_with_profiles(item, folder, where) for item in raw]
    if not isinstance(raw, dict):
        return raw
    if not _is_file(raw):
        return {key: _with_profiles(item, folder, f"{where} {key}") for key, item in raw.items()}
    columns = read_columns(raw["file"], folder, where, ("x", "value"), ("x", "value"))
    names = [name.lower() for name in columns.names]
    if len(names) == 2 and ("x" in names or "value" not in names):
        # the one beside x may have any name, and so may both
        at = [1, 0] if names[1] == "x" else [0, 1]
    elif names.count("x") == names.count("value") == 1:
        at = [names.index("x"), names.index("value")]
    else:
        columns.refuse(f"its columns are {', '.join(columns.names)}; it needs one x and one value")
    x, value = columns.values[:, at].T
    columns.check_sorted("x", x, np.diff(x) <= 0.0)
    return {"x": x.tolist(), "value": value.tolist()}


def _with_signals(history: dict[str, Any], loads: Any, folder: Path) -> dict[str, Any]:
    """Return [history] with ``columns`` and rows of load factors in place of files."""
    given = [key for key in ("rows", "cycle_rows") if key in history]
    files = [key for key in given if _is_file(history[key])]
    wanted = history.get("columns")
    if wanted is None and files not in ([], given):
        raise InputError("[history] columns: is missing, as one of rows and cycle_rows is no file")
    listed = isinstance(wanted, list) and all(isinstance(name, str) for name in wanted)
    if files and not (wanted is None or listed):
        raise InputError("[history] columns: must be a list of strings in quotes")
    names = [table.get("name") for table in checks.as_list(loads, "load")]
    known = [name for name in names if isinstance(name, str)]
    # columns that are checked and dropped
    times = {"time", "t"} - {*known}
    history = dict(history)
    for key in files:
        file, where = history[key]["file"], f"[history] {key}"
        columns = read_columns(file, folder, where, wanted or known, wanted or ())
        chosen = [name for name in wanted or columns.names if name.lower() not in times]
        for name in chosen:
            if wanted and name not in columns.names:
                have = ", ".join(columns.names)
                columns.refuse(f"has no column '{name}'; its columns are {have}")
            if not wanted and name not in known:
                other = f"the column '{name}' is no load, {checks.suggestion(name, known)}"
                columns.refuse(f"{other}; rename it, or choose the columns by [history] columns")
        for name, values in zip(columns.names, columns.values.T, strict=True):
            if name.lower() in times:
                columns.check_sorted("time", values, np.diff(values) < 0.0)
        rows = columns.values[:, [columns.names.index(name) for name in chosen]]
        moves = np.concatenate([[True], np.any(np.diff(rows, axis=0) != 0.0, axis=1)])
        history |= {"columns": chosen, key: rows[moves].tolist()}
        wanted = wanted or chosen
    return history
