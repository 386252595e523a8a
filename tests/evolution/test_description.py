"""Descriptions for the screen: short whatever they describe, and true."""

import dataclasses
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import models
import numpy as np
import pytest
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.evolution.description import STATE_COLOURS
from receding_fenicsx.scene.model import TABLE_OF

pytestmark = pytest.mark.one_rank

DEMOS = Path(__file__).parents[2] / "demos"
TABLE: dict[str, list[float]] = {"x": np.arange(1e3).tolist(), "value": np.ones(1000).tolist()}


@cache
def system() -> rf.ContactSystem:
    return models.block_system(40, 20, half=True)


@cache
def record() -> rf.Record:
    return rf.evolve(system(), cyclic(9, 0.25))


def long_scene() -> rf.Scene:
    scene = rf.read_scene(DEMOS / "dovetail.toml")
    contacts = tuple(replace(scene.contacts[0], friction=TABLE) for _ in range(50))
    rows = tuple((float(k), -float(k)) for k in range(1000))
    history = replace(scene.history, kind="table", columns=("F", "G"), rows=rows)
    return replace(scene, title="long " * 50, contacts=contacts, history=history)


@pytest.mark.parametrize(
    "item",
    [
        lambda: record(),
        system,
        long_scene,
        lambda: long_scene().contacts[0],
        lambda: rf.History(("a", "b"), np.ones((900, 2)), np.zeros((0, 2))),
        lambda: rf.read_scene(DEMOS / "punch_axisymmetric.toml"),
    ],
)
def test_descriptions_are_short(item: object) -> None:
    lines = repr(item()).splitlines()  # type: ignore[operator]
    assert 1 <= len(lines) <= 30
    if len(lines) > 1:
        assert max(map(len, lines)) <= 100
    assert len(repr(item())) < 3000  # type: ignore[operator]


@pytest.mark.parametrize("name", ["blade_root", "bolted_joint", "fatigue", "frictionless_block"])
def test_a_scene_is_described_by_the_calls_that_make_its_tables(name: str) -> None:
    scene = rf.read_scene(DEMOS / f"{name}.toml")
    head, *lines = repr(scene).splitlines()
    said, public = " ".join(" ".join(lines).split()), {name: getattr(rf, name) for name in dir(rf)}
    assert head == f"Scene {scene.title!r}"
    for field in dataclasses.fields(scene):
        value = getattr(scene, field.name)
        parts = value if isinstance(value, tuple) else (value,) * dataclasses.is_dataclass(value)
        for part in parts:
            assert f"{TABLE_OF.get(field.name, field.name)} {part!r}" in said
            assert eval(repr(part).replace("0.333333", "1/3"), public) == part


def test_a_record_and_its_system_are_described_by_their_numbers_line_by_line() -> None:
    """Node 0 has f P = 1/2 and slips by 1/2, then by 1 both ways in each cycle; 1 has no friction.

    Each cycle has 4 changes of state. The numbers of uncertain size are put in.
    """
    loads = {"press": [0, 0, 1, 1], "pull": [1, -1, 0, 0], **dict.fromkeys("cde", [0] * 4)}
    pair = small_system(np.eye(4), loads, [0.5, 0.0])
    pair = replace(pair, edge=np.array([0, 1]), edge_names=("foot", "heel"))
    path = np.pad([[0, 0], [1, 0], [1, 1], [1, -1], [1, 1]], ((0, 0), (0, 3)))
    found = rf.evolve(pair, table(pair, path[:3], path[2:], 3), None, rf.OutputOptions(5, (0, 3)))
    found.residual_max, found.energy_error_max, found.jumps, found.released = 2e-13, 3e-12, 2, 0.125
    half = replace(pair, half=True, f_backward=2.0 * pair.f, rigid=np.zeros((4, 1)))
    assert f"{found!r}\n\n{half!r}\n" == Path(__file__).with_name("described.txt").read_text()
    doubtful = replace(rf.given(found.uniqueness), first_loading=1, first_loading_proved=False)
    known = record().turning_points
    states = np.broadcast_to(np.arange(len(record().x)) % 2 + 1, known.state.shape)
    long = replace(record(), uniqueness=doubtful, turning_points=replace(known, state=states))
    long.samples = replace(long.samples, cycle=np.arange(14))
    for words in ("certified after the first loading, ", " 10, 11, ...", "| 73 more"):
        assert words in repr(long)
    assert "modelled: half" in repr(record())
    first, *_ = record().at(9, leg=0).zones
    assert f"cycle 9, leg 0  {first[0]} {first[1]:.4g} to {first[2]:.4g}" in repr(record())


def test_the_progress_of_a_cycle_tells_what_the_record_has() -> None:
    """Of the whole contact, also where half of it is modelled."""
    told = list[tuple[int, int, str]]()
    note, output = lambda *step: told.append(step), rf.OutputOptions(1, "all")
    found = rf.evolve(system(), cyclic(3, 0.25), None, output, progress=note)
    for number, cycles, text in told:
        D, change = found.cycles.dissipation[number - 1], found.steady.change[number - 1]
        events = np.count_nonzero(found.events.cycle == number)
        said = f"{events} events, residual 0, dissipation {D:.6g}, change {change:.1e}"
        assert cycles == 3 and re.sub("(?<=residual )[^,]+", "0", text) == said
    assert [number for number, *_ in told] == [1, 2, 3]


def test_a_notebook_shows_the_zones_of_the_last_cycle_to_scale() -> None:
    found = record()
    page = ET.fromstring(found._repr_html_().replace("&nbsp;", ""))
    boxes = list(page.iter("i"))
    zones = [zone for leg in (0, 1) for zone in found.at(9, leg=leg).zones]
    length = found.x[-1] - found.x[0]
    colours = {rf.STATE_NAMES[state]: colour for state, colour in STATE_COLOURS.items()}
    for box, (state, a, b) in zip(boxes, zones, strict=True):
        style = dict(part.split(":") for part in box.attrib["style"].split(";"))
        assert style["background"] == colours[state]
        assert float(style["flex"]) == pytest.approx(100.0 * (b - a) / length, abs=1e-4)
    labels, legend = (list(page.iter("span"))[part] for part in (slice(2), slice(2, None)))
    assert [label.text for label in labels] == ["cycle 9, leg 0", "cycle 9, leg 1"]
    assert {each.text: each.attrib["style"].split()[-1] for each in legend} == colours
    # texts are escaped
    named = replace(found, edge_names=("<b>&",))
    ET.fromstring(named._repr_html_().replace("&nbsp;", ""))
