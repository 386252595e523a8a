"""Validate requested cycles, legs and nodes."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.output.plots.loops import check_sampled, sampled_cycles
from receding_fenicsx.output.plots.series import legs_of


def whole(value: Any, what: str) -> int:
    """Return an integer; raise InputError if a value is not one."""
    try:
        return operator.index(value)
    except TypeError:
        raise InputError(f"{what} {value!r}: must be a whole number") from None


def cycles(record: Record, asked: int | Iterable[int]) -> list[int]:
    """Return the requested cycles, one or several.

    Raises:
        InputError: no cycle is requested, or the record has no samples of one.
    """
    found = [whole(cycle, "cycle") for cycle in _each(asked)]
    for cycle in found:
        check_sampled(record, cycle)
    if not found:
        raise InputError(f"cycles: name some of {sampled_cycles(record)}")
    return found


def legs(record: Record, asked: int | Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the requested legs as (cycle, leg); for a cycle all its legs.

    Raises:
        InputError: no leg is requested, or the record has no samples of one.
    """
    if not _several(asked):
        cycle = whole(asked, "cycle")
        check_sampled(record, cycle)
        return legs_of(record, cycle)
    found = []
    for pair in _each(asked):
        if not _several(pair) or len(pair) != 2:
            raise InputError(
                f"legs: give a cycle, or a list of (cycle, leg), legs from 0; {asked!r} is neither"
            )
        cycle, leg = whole(pair[0], "cycle"), whole(pair[1], "leg")
        check_sampled(record, cycle)
        if (cycle, leg) not in legs_of(record, cycle):
            known = [k for _, k in legs_of(record, cycle)]
            raise InputError(f"cycle {cycle}, leg {leg}: has no such leg, only {known}")
        found.append((cycle, leg))
    if not found:
        raise InputError(f"legs: none is asked for; cycles {sampled_cycles(record)} have samples")
    return found


def nodes(record: Record, asked: int | Iterable[int]) -> list[int]:
    """Return the requested contact nodes.

    Raises:
        InputError: no node is requested, or a node does not exist.
    """
    found = [whole(node, "node") for node in _each(asked)]
    if not found or not all(0 <= node < len(record.x) for node in found):
        raise InputError(f"nodes {found}: name some of 0 to {len(record.x) - 1}")
    return found


def _several(asked: Any) -> bool:
    return isinstance(asked, Iterable) and not isinstance(asked, str)


def _each(asked: Any) -> list[Any]:
    return list(asked) if _several(asked) else [asked]
