"""Whole messages of calls that are refused, and calls beside them that are not: see calls.txt."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import models
import numpy as np
import pytest
import shakedown_cases
import small

import receding_fenicsx as rf
from receding_fenicsx import atomic
from receding_fenicsx.interface import system
from receding_fenicsx.scene import history, profiles, symmetry
from receding_fenicsx.store import run_folder
from receding_fenicsx.studies.joint import fits

pytestmark = [pytest.mark.one_rank, pytest.mark.once]

ROWS = Path(__file__).with_name("calls.txt").read_text(encoding="utf-8").splitlines()[1:]
DEMOS = Path(__file__).parents[1] / "demos"
ONE = small.small_system(np.eye(4), {"p0": [0.0, 0.0, 1.0, 0.2]}, 0.4)
TWO = small.small_system(np.eye(4), {"p0": [0, 0, 1, 1], "q0": [0.1, 0.1, 0, 0]}, 0.3)


@cache
def played() -> rf.Record:
    return rf.evolve(models.block_system(20, 10), small.cyclic(3, 0.25))


def arrays(**change: Any) -> None:
    rf.evolve(replace(ONE, **change), small.cyclic(1))


def along(path: Any, loop: Any = ()) -> None:
    rf.evolve(TWO, small.table(TWO, path, loop, 1))


@cache
def block_scene() -> rf.Scene:
    return rf.read_scene(DEMOS / "block.toml", ["mesh.contact_elements=40", "history.cycles=2"])


@cache
def condensed() -> rf.ContactSystem:
    return rf.given(rf.condense(block_scene()))


NAMES = globals() | {"SIX": np.linspace(0.5, 1.0, 6)}
rooms = (np, models, shakedown_cases, atomic, run_folder, history, profiles, symmetry)
for room in (*rooms, small, system, fits):
    NAMES |= vars(room)
NAMES |= {name: getattr(rf, name) for name in rf.__all__}


@pytest.mark.parametrize(("call", "said"), [*zip(ROWS[::2], ROWS[1::2], strict=True)])
def test_a_call_is_refused_by_its_whole_message_or_accepted(call: str, said: str) -> None:
    try:
        eval(call, NAMES)
    except (rf.RecedingError, ValueError) as error:
        assert str(error).replace(str(DEMOS), "demos") == said.strip()
    else:
        assert said == "    ok"
