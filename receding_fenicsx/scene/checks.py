"""Types of single values of a scene with their ranges, and checks of names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

import numpy as np
from annotated_types import Ge, Le, Lt

from receding_fenicsx.arrays import call_of
from receding_fenicsx.errors import InputError, InputErrors

LARGEST, SMALLEST = 1e50, 1e-50
"""Range of numbers in which products and quotients of up to six of them stay finite."""

Number = Annotated[float, Ge(-LARGEST), Le(LARGEST)]
Positive = Annotated[float, Ge(SMALLEST), Le(LARGEST)]
NotNegative = Annotated[float, Ge(0.0), Le(LARGEST)]
Tolerance = Annotated[float, Ge(SMALLEST), Lt(1.0)]
"""Relative error or change."""
Count = Annotated[int, Ge(1)]
Thousand = Annotated[int, Ge(1), Le(1000)]
Million = Annotated[int, Ge(1), Le(1_000_000)]
Pair = tuple[Number, Number]


class OneOf:
    """Annotation of a text with its choices; the static type stays ``str``."""

    def __init__(self, *choices: str) -> None:
        """Set the choices."""
        self.choices = choices

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return Pydantic's schema of the choices."""
        return handler.generate_schema(Literal.__getitem__(self.choices))


WORDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    **dict.fromkeys(("str", "string"), "a string in quotes"),
    **dict.fromkeys(("tuple", "list"), "a list in brackets"),
    **dict.fromkeys(("dict", "dataclass"), "a table"),
    "directions": "a table of both directions",
}
"""Types of values in messages, by their names in Python and in Pydantic's errors."""


class ByType:
    """Annotation of alternatives; a value decides by its type, a table by ``forward``."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return Pydantic's schema of the alternatives, tagged by their ``WORDS``."""
        from pydantic_core.core_schema import tagged_union_schema

        choices: dict[str, Any] = {}
        for part in get_args(source):
            inner = get_args(part)[0] if get_origin(part) is Annotated else part
            word = WORDS[(get_origin(inner) or inner).__name__]
            choices[WORDS["directions"] if word in choices else word] = handler(part)

        def word_of(value: Any) -> str:
            directed = isinstance(value, dict) and {*value} & {"forward", "backward"}
            names = ["directions"] if directed else []
            names += ["int", "float"] if type(value) is int else [type(value).__name__]
            return next((WORDS[name] for name in names if WORDS.get(name) in choices), "")

        return tagged_union_schema(choices, discriminator=word_of)


class Table:
    """Table of a scene: a dataclass whose types and ``Attributes`` say what its keys may be."""

    __pydantic_config__: ClassVar = {"extra": "forbid", "strict": True, "allow_inf_nan": False}

    def __post_init__(self) -> None:
        """Store lists and arrays as tuples, in profiles as lists, NumPy's numbers as Python's."""
        for name, value in list(vars(self).items()):
            object.__setattr__(self, name, _stored(value, tuple))

    def __repr__(self) -> str:
        """Return the values, long ones cut; empty ones are left out."""
        return call_of(self)


def _stored(value: Any, rows: type) -> Any:
    """Return a value as Pydantic reads it from a file."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _stored(item, list) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return rows(_stored(item, rows) for item in value)
    return str(value) if isinstance(value, Path) else value


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a name, None if no one is similar."""
    return next(iter(difflib.get_close_matches(name, list(known), n=1)), None)


def suggestion(name: str, known: Sequence[str]) -> str:
    """Return "did you mean" with the nearest known name, or the list of known names."""
    close = nearest(name, known)
    return f"did you mean '{close}'?" if close else f"known are {', '.join(known)}"


def check_known(name: str, known: Sequence[str], where: str, what: str) -> None:
    """Raise InputError for an unknown name, with a suggestion."""
    if name not in known:
        hint = suggestion(name, known) if known else f"the scene has no {what}"
        raise InputError(f"{where}: unknown {what} '{name}'; {hint}")


def as_list(value: object, name: str) -> list[dict[str, Any]]:
    """Return the tables of an array [[name]]; a single table [name] is an array of one."""
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"'{name}' must be a table; write [[{name}]]")
    return tables


def check_name(name: str, where: str) -> None:
    """Raise InputError for an empty name, and for one that messages of one line cannot hold."""
    if not name.strip():
        raise InputError(f"{where}: is missing or empty; give a name")
    if not name.isprintable():
        raise InputError(f"{where}: {name!r} holds a character that cannot be printed; remove it")


# -- rules between values ------------------------------------------------------------------------

Rules = Iterator[str]
"""Rules of one part of a scene, a generator. Each that is broken yields one line: the table and
key, what is wrong, what to do. Only the first line counts: a rule may rely on those before it."""


def broken(rules: Iterable[Iterable[str]]) -> list[InputError]:
    """Return the first broken rule of each part."""
    errors = []
    for part in rules:
        try:
            errors += [InputError(line) for line in (next(iter(part), None),) if line]
        except InputError as error:
            errors.append(error)
    return errors


def refuse(errors: list[InputError]) -> None:
    """Raise all errors if there are any; a single one as it is."""
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise InputErrors(*dict.fromkeys(str(error) for error in errors))


def is_given(part: Any, key: str) -> bool:
    """Return whether a key has another value than its default, which is a dictionary or fixed."""
    return bool(getattr(part, key) != getattr(type(part), key, {}))


def unused(part: Table, at: str, useless: object, keys: Sequence[str], reason: str) -> Rules:
    """Refuse keys that are given where a condition leaves them without meaning, with a reason."""
    for key in keys if useless else ():
        if is_given(part, key):
            yield f"{at} {key}: {reason}; remove {key}"


def one_of(part: Table, at: str, keys: Sequence[str]) -> Rules:
    """Demand exactly one of some keys."""
    have = " and ".join(key for key in keys if is_given(part, key)) or "none"
    if have not in keys:
        yield f"{at}: has {have} of {', '.join(keys)}; give exactly one of them"
