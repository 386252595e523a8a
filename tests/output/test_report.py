"""The report: complete in itself, its numbers those of the summary."""

import base64
import dataclasses
import io
import json
import re
from functools import cache
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import models
import numpy as np
import pytest
from drawn_text import REPORTS, check_words
from PIL import Image
from small import cyclic

import receding_fenicsx as rf
from receding_fenicsx.evolution.record_data import Limit, PathUniqueness, Steady
from receding_fenicsx.interface.branches.choice import Choice
from receding_fenicsx.output.report import contact
from receding_fenicsx.output.report import run as sections
from receding_fenicsx.output.report.summary import SECTIONS, report_html
from receding_fenicsx.store.run_folder import write_summary

pytestmark = pytest.mark.one_rank

SCENE = rf.Scene(
    title="a < b & c",
    loads=(rf.Load("p0", "top", (-1.0, 1.0), pressure=1.0),),
    solver=rf.SolverOptions(branch="least dissipation"),
)
COSTS = {
    "timings": {"mesh": 0.125, "evolve": 2.5, "pictures": 1.0},
    "peak_memory_MB": 321.0,
    "ranks": 2,
    "versions": {"numpy": "1.2.3"},
}


class Page:
    """Text, table rows, headings and references of a page whose elements all end in order."""

    def __init__(self, text: str) -> None:
        closed = re.sub(r"<(meta|img|br)([^>]*)>", r"<\1\2/>", text.partition(">")[2])
        root = ET.fromstring(closed)
        self.text = "".join(root.find("body").itertext())  # type: ignore[union-attr]
        self.rows = [["".join(cell.itertext()) for cell in row] for row in root.iter("tr")]
        self.headings = ["".join(heading.itertext()) for heading in root.iter("h2")]
        attributes = [(k, v) for element in root.iter() for k, v in element.items()]
        self.references = [v for k, v in attributes if k in ("src", "href", "srcset")]


@cache
def run(cycles: int = 22) -> tuple:
    system = models.block_system(20, 10, half=True)
    record = rf.evolve(system, cyclic(cycles))
    record.scene_toml = rf.to_toml(SCENE)
    return record, rf.summarise(record, COSTS)


PICTURES = (
    "figures/tractions_first_loading figures/zones_first_unloading figures/slip_per_cycle "
    "figures/zones_by_cycle figures/dissipation_per_cycle figures/left/dissipation_density "
    "figures/hysteresis figures/trajectories figures/tractions_last_cycle figures/fatigue_top "
    "figures/accuracy figures/mine snapshots/cycle0022_leg1_s0.250_von_mises "
    "snapshots/cycle0022_leg1_s1.000_max_shear"
).split()
"""In the order of the page."""


def test_report_holds_every_picture_over_its_own_words_and_nothing_from_outside(
    tmp_path: Path,
) -> None:
    """No text breaks it either."""
    record, summary = run()
    shades = {}
    for k, name in enumerate(PICTURES):
        path = tmp_path / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        # each of a grey of its own; two are as wide as the page
        shades[path.stem] = 17 * k
        size = (2244, 30) if "snapshots" in name or "hysteresis" in name else (1060, 40)
        Image.new("RGB", size, (17 * k,) * 3).save(path)
    write_summary(tmp_path / "summary.json", summary)
    scene = f"{record.scene_toml}# </pre><script>alert(1)</script>"
    text = rf.write_report(tmp_path, scene).read_text(encoding="utf-8")
    page = Page(text)
    assert len(page.references) == len(PICTURES) and scene in page.text
    shown = re.findall(
        r'<figure( class="page")?><img alt="(.*?)" src="data:image/(png|jpeg);base64,(.*?)">'
        r"<figcaption>(.*?)</figcaption>",
        text,
    )
    assert [alt for _, alt, *_ in shown] == [Path(name).name for name in PICTURES]
    for wide, name, kind, data, _ in shown:
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            pixels = np.asarray(image.convert("L"))
            assert image.format == kind.upper()
            assert image.width == (1122 if kind == "jpeg" else 2244 if wide else 1060)
        assert np.abs(pixels.astype(int) - shades[name]).max() <= 2, name
        assert bool(wide) == (kind == "jpeg" or name == "hysteresis"), name
    captions = [f"{name}: {unescape(caption)}" for _, name, *_, caption in shown]
    check_words(captions, REPORTS / "captions.txt")
    assert not re.search(r"https?://|@import|url\(|<script|<link", text)
    heads = "Turning points", "Figures", "Stresses in the body", "Steady state and limit"
    assert tuple(page.headings[:4]) == heads


def test_numbers_have_five_digits_of_the_largest_on_any_edge_and_no_round_off() -> None:
    point = {"p_max": 2.0e7, "q_min": -1.3e-8, "q_max": 3.0e-4}
    assert contact.extremes_of(point) == [2.0e7, 0.0, 3.0e-4]
    assert contact.extremes_of({"p_max": 0.0, "q_min": 0.0, "q_max": 0.0}) == [0.0, 0.0, 0.0]
    assert contact.length_format({"turning_points": []}) == "z.4f"
    shown = {0.05: "0.050000", 99.5: "99.5000", 123.456: "123.46", 3e5: "3.0000e+05"}
    for x, text in shown.items():
        points = [{"zones": [["stick", -end, 0.0]]} for end in (1e-3, x)]
        assert f"{x:{contact.length_format({'turning_points': points})}}" == text


@pytest.mark.parametrize("name", ["well", "doubts", "ring", "tiny"])
def test_the_whole_text_of_a_run_of_everything(name: str) -> None:
    """Of made-up summaries, one in large units: text, console, all lines, the page's top."""
    summary = json.loads((REPORTS / f"{name}.json").read_text(encoding="utf-8"))
    page = Page(report_html(summary))
    top = re.sub(r"\s*\n\s*", "\n", page.text.partition(page.headings[0])[0]).strip()
    lines = "\n".join(line for each in SECTIONS.values() for line in each.tell(summary).lines)
    parts = rf.run_table(summary, everything=True), rf.run_table(summary), lines, top
    known = (REPORTS / f"{name}.txt").read_text(encoding="utf-8")
    assert "\n\n-- next --\n\n".join(parts).splitlines() == known.splitlines()
    # all sections of the page are those of the text
    for words in (*page.headings, *map(" ".join, page.rows)):
        assert " ".join(words.replace("\u2013", "-").split()) in " ".join(parts[0].split())


def crowded() -> dict[str, Any]:
    """A summary with everything that wants a line on the console."""
    _, summary = run()
    points = [
        {**p, "edge": edge, "load": {f"load number {k}": 1.0 / 3.0 for k in range(9)}}
        for p in summary["turning_points"]
        for edge in ("left", "right")
    ]
    errors = {f"number_{k}": {"value": 1.0, "error": 0.1, "relative": 0.1} for k in range(9)}
    forces = {f"bolt {k}": [1.0, 2.0] for k in range(9)}
    return {**summary, "turning_points": points, "errors": errors, "bolts": forces}


@pytest.mark.parametrize("warnings", [0, 1, 20])
@pytest.mark.parametrize("full", [False, True])
def test_console_has_ten_lines_of_100_columns_and_warnings_first(full: bool, warnings: int) -> None:
    texts = [f"number {k}: {'a mesh too coarse ' * 3}" for k in range(warnings)]
    text = rf.run_table({**(crowded() if full else run()[1]), "warnings": texts})
    lines, flat = text.splitlines(), " ".join(text.split())
    # one more says where the files are
    assert len(lines) <= 9 and max(map(len, lines)) <= 100
    for words in ("a < b & c: 41 contact nodes", "cycle", "22 ", *texts[:1]):
        assert words.strip() in flat, words
    assert ("the rest is in report.html" in text) == (full or warnings > 1)
    if not full and not warnings:
        assert "only symmetric path from its start" in text and "largest residual" in text


def test_the_short_table_has_the_last_cycle_then_the_first_loading_and_the_largest_shear() -> None:
    _, summary = run()
    points = [{**point, "q_min": -0.7531, "q_max": 0.25} for point in summary["turning_points"]]
    _, *rows = contact.console_table({**summary, "turning_points": points}, 3)
    assert [row.split()[0] for row in rows] == ["0", "22", "22"]
    assert all("0.7531" in row for row in rows)
    # ends of zones are fitted in the first 20 cycles and the last
    assert {p["cycle"] for p in points if "zone_ends" not in p} == {21}
    # of several edges all at an instant, or none
    both = [{**point, "edge": edge} for point in points for edge in ("left", "right")]
    _, *rows = contact.console_table({**summary, "turning_points": both}, 5)
    assert [row.split()[:2] for row in rows] == 2 * [["left", "22"], ["right", "22"]]
    # fitted half widths where all are
    own = [p["contact_half_width"] for p in points[-2:]]
    for fitted, shown in ((True, [7.0, 7.0]), (False, own)):
        for k, every in ((-2, True), (-1, fitted)):
            points[k] |= {"contact_half_width_estimate": {"value": 7.0, "fitted": every}}
        _, *rows = contact.console_table({**summary, "turning_points": points}, 2)
        assert [float(row.split()[2]) for row in rows] == pytest.approx(shown, abs=1e-4)


@pytest.mark.parametrize("legs", [12, 13])
def test_of_a_cycle_of_many_legs_the_extremes_of_each_load_and_the_end_are_told(legs: int) -> None:
    """The load c rests, the last leg of the cycle ends between the extremes of a and b."""
    a, b = np.sin(1.0 + np.arange(legs)), np.cos(0.5 * np.arange(legs) - 1.0)
    loads = [{"a": float(x), "b": float(y), "c": 2.0} for x, y in zip(a, b, strict=True)]
    every = [(c, k, load) for c in (0, 1, 2, 5) for k, load in enumerate(loads)]
    points = [{"cycle": c, "leg": k, "load": load} for c, k, load in every]
    told = [(p["cycle"], p["leg"]) for p in contact.headline_points({"turning_points": points})]
    kept = {a.argmin(), a.argmax(), b.argmin(), b.argmax(), legs - 1} if legs > 12 else range(legs)
    assert told == [(c, k) for c in (0, 1, 5) for k in sorted(kept)]


def test_run_without_cycles_or_costs_has_a_report_too() -> None:
    system = models.block_system(20, 10, half=True)
    summary = rf.summarise(rf.evolve(system, cyclic(0)))
    page = Page(report_html(summary))
    assert page.headings == ["Turning points", "Checks"]
    assert all(line.strip() for line in rf.run_table(summary).splitlines())
    assert "Untitled run" in page.text


UNSURE = PathUniqueness(False, 1.25, 3, 2, 1, 0.375, np.array([4, 6]), 5, True)


def test_every_key_of_the_summary_is_what_the_record_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a whole body, a record with made-up numbers that all differ."""
    nodes = {25: [8, 9, 24], 14: [1, 2, 4, 5, 6], 11: [0, 1, 3]}
    at_limit: Any = lambda part, _: SimpleNamespace(node=np.array(nodes[len(part.x)]))  # noqa: E731
    monkeypatch.setattr(contact, "limit_nodes", at_limit)
    found = rf.evolve(models.block_system(24, 6, half=False), cyclic(5))
    slip = np.random.default_rng(1).standard_normal(found.cycles.slip_increment.shape)
    cycles = dataclasses.replace(
        found.cycles, dissipation=np.array([4.0, 9.0, 2.0, 1.0, 3.0]), slip_increment=slip
    )
    numbers: Any = dict(residual_max=0.125, energy_error_max=0.25, sweeps=7, jumps=2)
    choices = (Choice(1, 0, 0.5, (0.75,), (3, 4), 2, 1, ((1, 3), (2, 2))),)
    made = dataclasses.replace(
        found,
        **{**numbers, "released": 0.5, "dissipation_first_loading": 11.0, "n_events": 345},
        cycles=cycles,
        uniqueness=UNSURE,
        choices=choices,
        steady=Steady(True, 4, "ratchetting", 2, found.steady.change),
        limit=Limit(True, 4, 9, 0.0625, 0, "it was found", True),
        scene_toml=rf.to_toml(dataclasses.replace(SCENE, units=rf.Units("mm", "MPa", "N"))),
    )
    summary = rf.summarise(made)
    points, ends = summary.pop("turning_points"), found.turning_points
    for k, point in enumerate(points):
        assert (point["cycle"], point["leg"]) == (ends.cycle[k], ends.leg[k])
        assert point["load"] == {"p0": ends.load[k, 0]}
        largest = ends.p[k].max(), ends.q[k].min(), ends.q[k].max()
        assert (point["p_max"], point["q_min"], point["q_max"]) == largest
        assert list(map(tuple, point["zones"])) == rf.zones(found.x, ends.state[k])
    x = found.x.tolist()
    assert (len(points), summary.pop("limit_without_slip")) == (11, [x[8:10], 2 * x[24:]])
    edge = np.repeat([0, 1], [14, 11])
    parts = dataclasses.replace(made, edge=edge, edge_names=("a", "b"), scene_toml="")
    for point, corner in zip(
        contact.turning_points(parts)["turning_points"], 11 * x[13:15], strict=True
    ):
        assert [found["x"] for found in point["corners"]] == [corner]
    # ends of zones are fitted with the constants of their own edge
    monkeypatch.setattr(contact.ends, "contact_betas", lambda part: (len(part.x),))
    monkeypatch.setattr(contact.ends, "estimated_ends", lambda *given: given)
    monkeypatch.setattr(contact.ends, "half_width_estimates", lambda *given: {"width": given})
    for k, point in enumerate(contact.turning_points(parts)["turning_points"]):
        for part, row, betas in (point["zone_ends"], point["width"]):
            assert (len(part.x), row, betas) == ((14, 11)[k % 2], k // 2, ((14, 11)[k % 2],))
    several = contact.checks(parts)
    spans = ("a", 1, 2), ("a", 4, 6), ("b", 14, 15), ("b", 17, 17)
    assert several["limit_without_slip"] == [[x[a], x[b], name] for name, a, b in spans]
    gained = slip[-2:].mean(axis=0)
    assert summary == {
        **numbers,
        "title": "a < b & c",
        "units": {"length": "mm", "stress": "MPa", "force": "N"},
        "method": "events",
        "symmetry": "none",
        **{"nodes": 25, "dofs": 50, "modelled_nodes": 25, "modelled_dofs": 50},
        "warnings": [],
        "dissipation_first_loading": 11.0,
        "dissipation_per_cycle": [4.0, 9.0, 2.0, 1.0, 3.0],
        "dissipates": True,
        "dissipation_round_off": made.dissipation_round_off,
        "slip_per_cycle_max": np.abs(slip).max(axis=1).tolist(),
        "steady": {"reached": True, "cycle": 4, "kind": "ratchetting", "period": 2},
        # over a period of two cycles
        "limit": {
            **{"reached": True, "cycle": 4, "cycles_played": 9, "residual": 0.0625, "period": 2},
            **{"dissipation": 2.0, "dissipation_ratio": 0.5, "unique": False, "jumped": True},
            "walk": gained[np.abs(gained).argmax()],
            "reason": "it was found",
        },
        "jumps": {"count": 2, "energy_released": 0.5},
        "events": 345,
        "uniqueness": {
            **{"certified": False, "margin": 1.25, "solutions": 3, "symmetric_paths_only": False},
            "where": {"cycle": 2, "leg": 1, "s": 0.375, "nodes": [4, 6]},
            "first_loading": {"solutions": 5, "proved": True},
        },
        "branch": {"rule": "least dissipation", "choices": [vars(choice) for choice in choices]},
    }
    lost = dataclasses.replace(rf.given(made.limit), reached=False, unique=-1)  # not examined
    limit = rf.summarise(dataclasses.replace(made, limit=lost))["limit"]
    assert [limit[key] for key in ("reached", "period", "unique")] == [False, None, None]
    # what ratchets alone walks, and round-off has no ratio
    steady = dataclasses.replace(made.steady, kind="cyclic slip")
    faint = dataclasses.replace(cycles, dissipation=1e-30 * cycles.dissipation)
    limit = rf.summarise(dataclasses.replace(made, steady=steady, cycles=faint))["limit"]
    assert (limit["walk"], limit["dissipation_ratio"]) == (None, None) and limit["dissipation"]
    # of half a body
    half = dataclasses.replace(made, half=True, modelled_nodes=13, modelled_dofs=25)
    model = rf.summarise(half)
    assert model["symmetry"] == "mirror" and model["uniqueness"]["symmetric_paths_only"]
    assert (model["nodes"], model["modelled_nodes"], model["modelled_dofs"]) == (25, 13, 25)
    # a first loading that was not examined has no solutions
    unsure = dataclasses.replace(UNSURE, first_loading=0)
    model = rf.summarise(dataclasses.replace(half, uniqueness=unsure))
    assert model["uniqueness"]["first_loading"] is None
    head, words = contact.uniqueness_rows(model)[0]
    assert head == "only path from its start" and "among mirror-symmetric paths" in words


def test_a_bolt_that_pushes_has_its_warning_and_a_tight_one_none() -> None:
    force = np.array([[0.0, 5.0], [4.0, 5.0], [-1.0, 2.0], [3.0, -1e-12]])
    found: Any = SimpleNamespace(
        scene=SimpleNamespace(bolts=[SimpleNamespace(name="loose"), SimpleNamespace(name="tight")]),
        load_names=("loose", "tight"),
        turning_points=SimpleNamespace(load_displacement=force),
    )
    (line,) = sections.loose_warnings(found)
    assert line.startswith("bolt 'loose': its force falls to -1, a push")


def test_slips_of_nodes_that_touch_on_a_curved_edge_alone_have_a_warning() -> None:
    angle, v, P = np.linspace(0.0, 1.0, 5), np.full((2, 10), 9.0), np.ones((2, 10))
    curved, straight = (np.sin(angle), np.cos(angle)), (angle, np.ones(5))
    v[:, 5:], P[1, 5], v[1, 5] = 0.2, 0.0, 3.0
    found: Any = SimpleNamespace(
        edge=np.repeat([0, 1], 5),
        edge_names=("flat", "rim"),
        points=np.hstack([straight, curved]).T,
        turning_points=SimpleNamespace(v=v, P=P),
    )
    (line,) = sections.slip_warnings(found)
    assert line.startswith("points of the curved edge 'rim' slip by up to 0.2, 0.8 times the")


@pytest.mark.parametrize(("backward", "dissipates"), [(0.3, True), (0.0, False)])
def test_no_ratio_is_told_of_a_dissipation_that_is_round_off(
    backward: float, dissipates: bool
) -> None:
    """Without friction in one direction nothing resists a free body: Q = 0 at all nodes."""
    system = models.block_system(24, 6, half=False)
    f_backward = np.full(system.n, backward)
    record = rf.evolve(dataclasses.replace(system, f_backward=f_backward), cyclic(8))
    summary = rf.summarise(record)
    assert record.dissipates == summary["dissipates"] == dissipates
    assert ("of cycle 8 over cycle 1" in rf.run_table(summary)) == dissipates
    assert ("dissipation_ratio" in rf.headline(record)) == dissipates
    assert ("dissipation_limit" in summary["steady"]) == dissipates
    assert (record.cycles.dissipation[0] > 1e-3) == dissipates


def test_the_polygon_of_a_harmonic_history_has_the_last_estimate_and_the_tolerance() -> None:
    drives = {"p0": rf.Harmonic(1.0, 0.5), "q": rf.Harmonic(0.0, 0.5, 90.0)}
    loads = (*SCENE.loads, rf.Load("q", "top", traction=(1.0, 0.0)))
    doubling = np.array([[16, 0.02], [32, 0.004]])
    for tolerance in (None, 0.01):
        history = rf.HistoryOptions("harmonic", harmonic=drives, corners=32, tolerance=tolerance)
        text = rf.to_toml(dataclasses.replace(SCENE, loads=loads, history=history))
        found = dataclasses.replace(run()[0], scene_toml=text, doubling=doubling)
        polygon = sections.steady_state(found)["harmonic"]
        known = {"corners": 32, "error_estimate": 0.004, "tolerance": tolerance or 1e-3}
        assert polygon == {**known, "doubling": doubling.tolist()}
    told = sections.tell_steady({**run()[1], "harmonic": {**polygon, "error_estimate": np.nan}})
    assert "error of the dissipation per cycle unknown, the history" in told.lines[-1]
