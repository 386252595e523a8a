"""Numbers that tests of sweeps take from records, in a module that new processes can import."""

import os
from dataclasses import dataclass
from typing import Any

import receding_fenicsx as rf


def half(record: rf.Record) -> dict[str, Any]:
    return {"half": 0.5 * record.turning_points.P[-1].max(), "name": "half"}


def times(record: rf.Record, factor: float) -> dict[str, Any]:
    return {"half": factor * record.turning_points.P[-1].max()}


@dataclass
class Times:
    factor: float

    def __call__(self, record: rf.Record) -> dict[str, Any]:
        return times(record, self.factor)


def syy(record: rf.Record) -> dict[str, Any]:
    return {"syy": record.probe("a").stress[..., 1].sum()}


def dies_at_three_tenths(record: rf.Record) -> dict[str, Any]:
    if record.f.max() == 0.3:
        os._exit(7)
    return {"f": record.f.max()}


def wrong(_: rf.Record, found: Any = None) -> dict[str, Any]:
    return found or {"half": 1 / 0}
