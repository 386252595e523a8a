"""Cases of a sweep: the scene of every combination of the values."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.arrays import shortened
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.identity import digest
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.toml_file import from_raw, set_value, to_toml

MAX_CASES = 1_000_000
"""Largest number of cases in a sweep."""

Label = float | int | str | bool
"""A value as the table shows it."""


@dataclass(frozen=True)
class Case:
    """One combination of values.

    Attributes:
        labels: the value of each key, as the table shows it.
        identity: digest of the scene and its mesh files, "" where there is no scene.
        scene: the scene; None where this combination cannot be modelled.
        body: digest of what determines the condensed system, and of the probes.
        error: why it cannot be modelled.
    """

    labels: tuple[Label, ...]
    identity: str
    scene: Scene | None
    body: str = ""
    error: str = ""


@dataclass(frozen=True)
class Grid:
    """All cases of a sweep; the values of the last key vary fastest.

    Attributes:
        keys: "table.key" or "load.NAME.key", as for ``--set``.
        labels: the values of each key, as the table shows them.
        cases: the cases.
    """

    keys: tuple[str, ...]
    labels: tuple[tuple[Label, ...], ...]
    cases: tuple[Case, ...]


def grid_of(scene: Scene, over: Mapping[str, Any], folder: Path | None = None) -> Grid:
    """Return the scenes of all combinations of values.

    Args:
        scene: the scene that is changed.
        over: a list of values for each key; or a dictionary of values by the names that the table
            shows.
        folder: folder that paths of files among the values are relative to.

    Raises:
        InputError: a key or a value cannot be used in any combination; one line.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"sweep: a Scene is needed, not a {type(scene).__name__}")
    if not isinstance(over, Mapping) or not over:
        raise InputError('sweep: give keys and values, {"contact.friction": [0.1, 0.2]}')
    values = {key: _labelled(key, given) for key, given in over.items()}
    count = int(np.prod([float(len(v)) for v in values.values()]))
    if count > MAX_CASES:
        raise InputError(f"sweep: has {count} cases; at most {MAX_CASES} are possible")
    raw, folder = tomllib.loads(to_toml(scene)), folder or Path()
    cases = tuple(
        _case(raw, dict(zip(values, chosen, strict=True)), folder)
        for chosen in itertools.product(*(v.items() for v in values.values()))
    )
    for k, (key, of_key) in enumerate(values.items()):
        good = {case.labels[k] for case in cases if case.scene is not None}
        for label in set(of_key) - good:
            alone = _case(raw, {key: (label, of_key[label])}, folder)
            if alone.scene is None:
                raise InputError(f"sweep over {key} = {shortened(str(label))}: {alone.error}")
    if all(case.scene is None for case in cases):
        raise InputError(f"sweep over {', '.join(values)}: {cases[0].error}")
    return Grid(tuple(values), tuple(tuple(v) for v in values.values()), cases)


def _labelled(key: object, given: Any) -> dict[Label, Any]:
    """Return the values of a key by their labels."""
    if not isinstance(key, str) or "." not in key:
        raise InputError(f"sweep over {key}: write table.key, for example contact.friction")
    if isinstance(given, Mapping):
        return {str(name): _plain(value) for name, value in given.items()} or _no_values(key)
    if isinstance(given, str) or not hasattr(given, "__iter__"):
        raise InputError(f"sweep over {key}: give a list of values, [{given!r}]")
    found: dict[Label, Any] = {}
    for value in map(_plain, given):
        label = value if isinstance(value, str | bool | int | float) else _text(value)
        if label in found:
            raise InputError(f"sweep over {key}: the value {label} occurs twice; remove one")
        found[label] = value
    return found or _no_values(key)


def _no_values(key: str) -> dict[Label, Any]:
    raise InputError(f"sweep over {key}: has no values; give at least one")


def _plain(value: Any) -> Any:
    """Return a value in the types of parsed TOML."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def _text(value: Any) -> str:
    """Return the label of a list or a table."""
    if isinstance(value, dict) and set(value) == {"file"}:
        return str(value["file"])
    return json.dumps(value, default=str)


def _case(raw: dict[str, Any], chosen: dict[str, tuple[Label, Any]], folder: Path) -> Case:
    """Return the case of one combination, with the reason where it cannot be modelled."""
    labels = tuple(label for label, _ in chosen.values())
    try:
        changed = copy.deepcopy(raw)
        for key, (_, value) in chosen.items():
            set_value(changed, key, copy.deepcopy(value), "the scene")
        scene = from_raw(changed, folder)
        # a condensed system holds the matrices of its probes
        body = hashlib.sha256(f"{digest(scene)}\n{scene.probes!r}".encode()).hexdigest()
    except InputError as error:
        return Case(labels, "", None, error=str(error).replace("\n", " "))
    identity = hashlib.sha256(f"{body}\n{to_toml(scene)}".encode()).hexdigest()
    return Case(labels, identity, scene, body)
