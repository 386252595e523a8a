"""Every demo runs, on coarse meshes, and prints what is known of its problem."""

import re
import runpy
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from demo_runs import DEMOS
from gallery_pages import demo_names

import receding_fenicsx as rf

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


class Coarse(NamedTuple):
    """What a demo's lines have to say, and how it is made cheap.

    Every group of ``line`` is a number that is ``known`` to an ``error``, relative unless it is 0.
    The demo's scenes start from ``changes``; ``numbers`` replace those of its module.
    """

    line: str
    known: float
    error: float
    changes: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    numbers: dict[str, Any] = {}  # noqa: RUF012 - a tuple's default
    pictures: int = 0


def mesh(elements: int, *others: str) -> tuple[str, ...]:
    return f"mesh.contact_elements={elements}", *others


NUMBER = r"([-+]?[\d.]+(?:e[-+]\d+)?)"
LAST = rf"{NUMBER}\n"
HERTZ = rf.reference.closed_forms.Hertz(1.0, 100.0, 0.5 * 200.0 / (1.0 - 0.3**2))
SWT = (1.0 - 0.3**2) * HERTZ.p0**2 * 0.6 / 200.0
COARSER_PUNCH = {"RADII": (10.0, 20.0), "FINER": mesh(100)}
FEW_STARTS = ("--nodes", "25", "--samples", "6", "--map", "2", "2", "--seeds", "2")
# Signs and sizes are the demos' own assertions too, at tolerances that coarse meshes meet.
CASES = {
    # the slip per cycle follows its power on finer meshes only
    "block": Coarse(
        rf"over that of the first: {NUMBER}",
        0.56,
        0.02,
        mesh(24),
        numbers={"slip_exponent": lambda _: -3.1, "STEPPED": 5},
        pictures=5,
    ),
    "branches": Coarse(r": (\d) branches", 3, 0.0, (), ("--elements", "36", "40"), pictures=4),
    "cattaneo_mindlin": Coarse(
        rf"a = {NUMBER}", HERTZ.a, 5e-3, mesh(24, "mesh.growth=1.6"), (), {"TOLERANCE": 0.03}, 1
    ),
    # both pads slide under the full pull: sqrt(2) P (1 + f) = F
    "dovetail": Coarse(rf"F = 1.0: normal force {NUMBER}", np.sqrt(2.0) / 3.0, 1e-3, mesh(8)),
    "fatigue": Coarse(rf": {NUMBER} \(", SWT, 0.09, pictures=1),
    "fretting": Coarse(
        LAST, 0, 0.01, mesh(60, "history.tolerance=0.01"), (), {"PHASES": (0, 90)}, 1
    ),
    "half_planes": Coarse(rf"error of D {NUMBER}", 0, 0.02, mesh(60)),
    "initial_slip": Coarse(r"; (\d+) of 8", 0, 0.0, (), FEW_STARTS, pictures=2),
    "joints": Coarse(rf"bolt: force {NUMBER}", 0.02, 0.05, (), ("--count", "3")),
    "lap_joint": Coarse(rf"slip length {NUMBER}", 0, 0.08, mesh(240), pictures=1),
    "layer": Coarse(
        LAST, 0, 5e-3, mesh(120, "mesh.growth=1.3"), (), {"ALPHAS": (0.5, -0.5), "TOLERANCE": 5e-3}
    ),
    "limit": Coarse(
        LAST,
        0,
        1e-8,
        (),
        ("--nodes", "13", "--random", "1", "--map", "2", "1"),
        {"PLAIN_CYCLES": 300},
        1,
    ),
    "moving_load": Coarse(rf"rough: creep {NUMBER}", 0, 0.0, mesh(8)),
    "pin": Coarse(rf"on the pin: \S+ {NUMBER}", 0.003 * 80 * np.sin(np.pi / 80), 1e-6),
    "press_fit": Coarse(rf"12.0 +1.0 +\S+ +{NUMBER}", 1.0 / (1.0 - 0.3**2), 1e-3),
    "problem_figure": Coarse("", 0, 0.0, pictures=1),
    "punch": Coarse(LAST, 0, 0.01, mesh(72), (), COARSER_PUNCH),
    "rolling": Coarse(rf"creep {NUMBER}", 0.3 * 0.5 / 100.0, 1e-3),
    "shakedown": Coarse(
        rf"safe slip: shakedown, dissipation per cycle {NUMBER}",
        0,
        0.0,
        mesh(12),
        ("--starts", "6"),
        pictures=3,
    ),
    "sheared_block": Coarse(
        rf"(?:slip|ratchetting) +\S+ +{NUMBER}", 1.0, 1e-3, mesh(24), ("--no-pictures",)
    ),
    "stack": Coarse(r" (\de-\d\d)", 0, 1e-3, mesh(48), (), {"CASES": ((4.0, 1.0), (0.5, 2.0))}),
    "time_error": Coarse(
        rf"steps: {NUMBER}", 2.0, 0.15, mesh(16), (), {"STEPS": (10, 40, 80, 160, 240, 320)}, 1
    ),
    "two_blocks": Coarse(r" (\d.\de-\d\d)", 0, 5e-3, mesh(480), (), {"WIDTH_TOLERANCE": 5e-3}),
    "wear": Coarse(
        rf"pressure {NUMBER}", 0, 0.01, mesh(52, "wear.tolerance=0.6"), (), {"MESHES": (150,)}, 1
    ),
}


def test_every_demo_is_run() -> None:
    # a script of README.md runs the other one
    assert set(demo_names(DEMOS)) - {"frictionless_block"} == set(CASES)


@pytest.mark.parametrize("name", CASES)
def test_demo_prints_what_is_known(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case, read, options = CASES[name], rf.read_scene, rf.RunOptions
    main = runpy.run_path(str(DEMOS / f"{name}.py"))["main"]
    for key, value in case.numbers.items():
        monkeypatch.setitem(main.__globals__, key, value)
    monkeypatch.setattr(rf, "read_scene", lambda path, own=(): read(path, [*case.changes, *own]))
    monkeypatch.setattr(rf, "RunOptions", lambda **own: options(**{**own, "pictures": False}))
    monkeypatch.setattr(sys, "argv", [name, *case.arguments])
    monkeypatch.chdir(tmp_path)
    main()
    printed = capsys.readouterr().out
    found = [float(number) for number in re.findall(case.line, printed) if case.line]
    assert found or not case.line, printed
    assert found == pytest.approx(
        [case.known] * len(found), rel=case.error, abs=0.0 if case.known else case.error
    )
    pictures = [path for path in tmp_path.rglob("*.png") if path.stat().st_size > 4000]
    assert len(pictures) == case.pictures, pictures
