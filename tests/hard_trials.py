"""Hard cases from scene files, each at several sizes: ``hard.py`` judges them."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from hard import SOLVED, Case, Tally, require
from hard_block import summed
from hard_bodies import solve

from receding_fenicsx.scene.toml_file import read_scene

HERE = Path(__file__).parent
DEMOS = HERE.parent / "demos"


def trial(path: Path, elements: int, tally: Tally, *overrides: str) -> str:
    """Play a scene at a number of elements."""
    scene = read_scene(path, [f"mesh.contact_elements={elements}", *overrides])
    _, record = solve(tally, scene)
    return summed(record.cycles.dissipation)


def beams(elements: int, cell: str, tally: Tally) -> str:
    """Bend two clamped beams to and fro (Goodman & Klumpp 1956): every cycle is like the first."""
    path = HERE / "trials" / "goodman_klumpp.toml"
    overrides = (f"mesh.contact_elements={elements}", f'mesh.cell="{cell}"', "history.cycles=6")
    _, record = solve(tally, read_scene(path, overrides))
    D = record.cycles.dissipation
    require(np.abs(D / D[0] - 1.0).max() <= 1e-9, "the dissipation of cycles differs")
    require(record.steady.kind == "cyclic slip", f"the state is called {record.steady.kind}")
    return summed(D)


def strip(elements: int, tally: Tally) -> str:
    """Pull a strip on a frictional wall (shear lag): a cycle dissipates F^3 / (12 q E A).

    The traction limit is q = f p, the slip length F / q = 6; what is left is of the order of the
    square of height over slip length.
    """
    path = HERE / "trials" / "strip_on_wall.toml"
    scene = read_scene(path, [f"mesh.contact_elements={elements}"])
    _, record = solve(tally, scene)
    height, pull, limit = 0.125, 0.024 * 0.125, 0.5 * 0.001
    D, exact = record.cycles.dissipation, pull**3 / (12.0 * limit * height)
    require(np.abs(D / exact - 1.0).max() <= 0.005, f"D is {D} in place of {exact:.4e}")
    return f"D over that of shear lag {D[-1] / exact:.5f}"


def rock(elements: int, tally: Tally) -> str:
    """Press a round body that balances on one node: Hertz, p_0 = 2 P / (pi a), a^2 = 4 P R / pi."""
    path = HERE / "trials" / "rock.toml"
    _, record = solve(tally, read_scene(path, [f"mesh.contact_elements={elements}"]))
    ends, half_width = record.turning_points, np.sqrt(4.0 * 0.3848 / np.pi)
    ratio = ends.p[-1].max() * np.pi * half_width / 2.0
    require(abs(ratio - 1.0) <= 1e-3, f"the largest pressure is {ratio:.5f} of Hertz's")
    return f"largest pressure over Hertz's {ratio:.5f}"


SIZES: dict[str, tuple[int, ...]] = {
    "roller": (80, 160, 280, 320),
    "ring": (20, 40, 80, 160),
    "lap_joint": (60, 120, 240, 480),
    "fretting_out_of_phase": (40, 80, 160, 320),
}
"""Elements on the contact edge; the first is for the suite."""

CASES = (
    *(
        Case(f"{name}, {elements} elements", SOLVED,
             partial(trial, HERE / "trials" / f"{name}.toml", elements), fast=elements == sizes[0])
        for name, sizes in SIZES.items()
        for elements in sizes
    ),
    *(
        Case(f"strip on a wall, {elements} elements", SOLVED, partial(strip, elements),
             fast=elements == 100)
        for elements in (100, 200, 400, 600)
    ),
    *(
        Case(f"round body on one node, {elements} elements", SOLVED, partial(rock, elements),
             fast=elements == 80)
        for elements in (40, 80, 160, 320)
    ),
    *(
        Case(f"two clamped beams, {elements} {cell}s", SOLVED, partial(beams, elements, cell),
             fast=elements == 80)
        for cell in ("triangle", "quadrilateral")
        for elements in (40, 80, 160, 320)
    ),
    *(
        Case(f"sheared polygon, {elements} elements", SOLVED,
             partial(trial, DEMOS / "sheared_polygon.toml", elements), fast=elements == 40)
        for elements in (40, 80, 160, 320)
    ),
)  # fmt: skip
