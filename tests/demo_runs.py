"""Functions and numbers of demos, and a run of one that several tests look at."""

from __future__ import annotations

import runpy
from functools import cache
from pathlib import Path
from typing import Any

import receding_fenicsx as rf

DEMOS = Path(__file__).parents[1] / "demos"


@cache
def demo(name: str) -> dict[str, Any]:
    """Functions and numbers of a demo, or "benchmarks/NAME"."""
    return runpy.run_path(str(DEMOS / f"{name}.py"))


@cache
def sheared_cylinders() -> rf.Record | None:
    """The record of the demo of Cattaneo and Mindlin on 120 elements, on rank 0."""
    record: rf.Record | None = demo("cattaneo_mindlin")["solve"](30.0, 120)
    return record


def sheared_block(f: float, *changes: str) -> rf.Scene:
    """The sheared block for one cycle without samples, its shear in proportion to friction."""
    scaled = [f"contact.friction={f}", f"load.Q.force=[{2 * f}, 0.0]", "history.cycles=1"]
    bare = ["output.samples_per_leg=1", "output.cycles=[]"]
    return rf.read_scene(DEMOS / "sheared_block.toml", [*scaled, *bare, *changes])
