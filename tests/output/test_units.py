"""Every axis of every figure, of a run whose pressure, height, modulus and largest load differ.

Where they are all 1 a figure that divides by the wrong one of them looks the same.
"""

import re
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures
from images import played
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

import receding_fenicsx as rf
from receding_fenicsx.output.plots import labels

pytestmark = pytest.mark.one_rank

PRESSURE, HEIGHT, YOUNG, LARGEST = 2.0, 3.0, 5.0, 4.0
CYCLES = 10
KINEMATICS = ("plane strain", "axisymmetric")


def scene_of(kinematics: str, p: float, h: float, E: float, largest: float) -> rf.Scene:
    """The paper's block, or a cylinder of the same section, in other units."""
    begin = 0.0 if kinematics == "axisymmetric" else -h
    return rf.Scene(
        body=rf.Body(width=4.0 * h, height=h),
        material=rf.Material(young=E, kinematics=kinematics),
        mesh=rf.MeshOptions(contact_elements=40, degree=1, growth=1.4),
        loads=(rf.Load("p0", "top", (begin, h), pressure=p),),
        probes=(
            rf.Probe("point", point=(0.5 * h, 0.5 * h)),
            rf.Probe("row", points=((0.5 * h, 0.25 * h), (h, 0.25 * h), (h, 0.75 * h))),
        ),
        history=rf.HistoryOptions(maximum=largest, minimum=largest / 3.0, cycles=CYCLES),
        output=rf.OutputOptions(samples_per_leg=10),
    )


@cache
def run(kinematics: str, *units: float) -> rf.Record:
    """Condense and play a scene; in units 1, 1, 1, 1 unless others are given."""
    return played(scene_of(kinematics, *(units or (1.0, 1.0, 1.0, 1.0))))


def odd(kinematics: str) -> rf.Record:
    """The run whose units are no ones."""
    return run(kinematics, PRESSURE, HEIGHT, YOUNG, LARGEST)


def drawn_in(figure: Figure) -> tuple[list[str], list[np.ndarray]]:
    """All texts of a figure, and the data of all that is drawn of numbers."""
    texts = [text.get_text() for text in figure.findobj(Text) if "$" in text.get_text()]
    shapes: list[np.ndarray] = []
    for axes in figure.axes:
        shapes += [np.array([*axes.get_xlim(), *axes.get_ylim()])]
        shapes += [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines]
        for collection in axes.collections:
            shapes += [np.asarray(path.vertices) for path in collection.get_paths()]
        for patch in axes.patches:
            # the path of a rectangle is that of the unit square
            shapes += [patch.get_patch_transform().transform(patch.get_path().vertices)]
    return texts, shapes


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_figures_without_units_are_the_same_in_all_units(kinematics: str) -> None:
    ones, others = (rf.figures.draw_all(record) for record in (run(kinematics), odd(kinematics)))
    for (name, figure), (other_name, other) in zip(ones, others, strict=True):
        (texts, shapes), (other_texts, other_shapes) = drawn_in(figure), drawn_in(other)
        assert (name, texts) == (other_name, other_texts)
        for a, b in zip(shapes, other_shapes, strict=True):
            assert a.shape == b.shape, texts
            assert b == pytest.approx(a, rel=1e-6, abs=1e-8), texts


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_figures_draw_what_is_known(kinematics: str) -> None:
    drawn = rf.figures.draw_all(odd(kinematics))
    if kinematics == "plane strain":
        check_figures(drawn, REPORTS / "block.txt")
    else:
        figures = dict(drawn)
        along = [each for each in figures.items() if each[0].startswith(("tr", "dis", "pr"))]
        check_figures(along, REPORTS / "cylinder.txt")
        # positions are radii, in legends too
        texts = [text for figure in figures.values() for text in drawn_in(figure)[0]]
        assert not any("$x" in text for text in texts) and any("$r" in text for text in texts)


def factor(label: str, symbol: str, now: float = np.nan) -> float:
    r"""What a label says its quantity is multiplied by, "$v\,E/(p_{0}^{max}\,h)$" of v."""
    text = label.strip("$")
    assert text.startswith(symbol), (label, symbol)
    text = text[len(symbol) :].replace(r"p_{0}^{\,\mathrm{max}}", "peak").replace("p_{0}", "now")
    text = text.replace(r"\,", "*").replace("^", "**")
    known = {"peak": PRESSURE * LARGEST, "now": PRESSURE * now, "h": HEIGHT, "E": YOUNG}
    assert set(re.findall(r"\w+", text)) <= {*known, "2", "3"}, label
    return float(eval(f"1.0{text}", known))


def along(axes: Axes, n: int) -> np.ndarray:
    """Coordinates of the curves of axes, else their limits."""
    lines = [np.asarray(line.get_xydata())[:, n] for line in axes.lines]
    limits = np.array((axes.get_xlim(), axes.get_ylim())[n])
    return np.concatenate([line for line in lines if len(line) > 2] or [limits])


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_tractions_are_over_the_size_of_the_pressure_that_acts_if_it_does(kinematics: str) -> None:
    record = odd(kinematics)
    low, high = record.at(1, "minimum"), record.at(1, "maximum")
    pulled, free = (replace(low, load={"p0": load}) for load in (-0.5 * LARGEST, 0.0))
    loads = {1 / 3: low, 1.0: high, 0.5: pulled, 1.0 / (PRESSURE * LARGEST): free}
    for part, moment in loads.items():
        axes = rf.figures.tractions(record, moment).axes[1]
        x = record.x * factor(axes.get_xlabel(), "r" if kinematics == "axisymmetric" else "x")
        units = map(partial(factor, now=part * LARGEST), axes.get_ylabel().split(",  "), "pq")
        both = zip((moment.p, moment.q), units, strict=True)
        check_curves(axes, *((x, values * unit) for values, unit in both), guides=False)


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_labels_of_all_figures_say_what_the_same_in_units_is_divided_by(kinematics: str) -> None:
    record = odd(kinematics)
    pairs = (rf.figures.draw_all(found) for found in (record, given_units(record, UNITS)))
    checked = 0
    for (name, figure), (_, in_units) in zip(*pairs, strict=True):
        # tractions are divided by the pressure of their instant, and D_N/D_1 has no unit
        for axes, plain in zip(figure.axes, in_units.axes, strict=True):
            for n, label in enumerate((axes.get_xlabel(), axes.get_ylabel())):
                found = re.search(r"\$[^$]*?((?:\\,E)?/[^$]+)\$", label)
                if found and not name.startswith(("tractions", "dissipation_per", "slip")):
                    shown, others = (along(panel, n) for panel in (axes, plain))
                    wanted = others * factor(found[1], "")
                    assert shown == pytest.approx(wanted, rel=1e-9, abs=1e-15), (name, label)
                    checked += 1
    assert checked > 12
    # of the slip other nodes are shown
    axes = rf.figures.slip_per_cycle(record).axes[0]
    N, drawn = np.array(axes.lines[0].get_data())
    gained = np.abs(record.cycles.slip_increment)[N.astype(int) - 1]
    gained *= factor(axes.get_ylabel().removeprefix("slip gained in a cycle, "), r"|\Delta v_i|")
    assert min(np.abs(gained - drawn[:, None]).max(axis=0)) < 1e-12 * drawn.max()


UNITS = rf.Units("mm", "MPa", "N")


def given_units(record: rf.Record, units: rf.Units) -> rf.Record:
    """The same record of a scene with units."""
    assert record.scene is not None
    return replace(record, scene_toml=rf.to_toml(replace(record.scene, units=units)))


@pytest.mark.parametrize(
    ("load", "size", "unit", "conjugate"),
    [
        (rf.Load("a", "top", pressure=3.0), 3.0, "MPa", "mm²"),
        (rf.Load("a", "top", traction=(3.0, -4.0)), 5.0, "MPa", "mm²"),
        (rf.Load("a", "top", displacement=("free", -2.0)), 2.0, "mm", "N/mm"),
        (rf.Load("a", "top", platen=True, force=(0.0, -7.0)), 7.0, "N/mm", "mm"),
        (rf.Load("a", "top", pressure="1 + x"), 1.0, "", "MPa mm²"),
        (rf.Load("a", "top", traction=("x", 1.0)), 1.0, "", "MPa mm²"),
    ],
)
def test_a_load_and_its_conjugate_have_the_units_whose_product_is_work(
    load: rf.Load, size: float, unit: str, conjugate: str
) -> None:
    scene = rf.Scene(loads=(load,), bolts=(rf.Bolt("b", "top", "bottom"),), units=UNITS)
    both, scales = (
        replace(scene, loads=(load, replace(load, edge="bottom"))),
        labels.Scales(odd("plane strain")),
    )
    scales.units, scales.nondimensional = UNITS, False
    # work for unit thickness is stress times area, that of the full circle stress times volume
    circle = {"N/mm": "N", "mm²": "mm³", "MPa mm²": "MPa mm³"}
    for around, shown in ((False, {}), (True, circle)):
        kind = labels.kind_of(scene, "a", around)
        assert kind.size == size
        assert np.add(kind.unit, kind.conjugate_unit).tolist() == [1, 2 + around]
        bolt = labels.kind_of(scene, "b", around)
        assert (bolt.unit, bolt.conjugate_unit) == ((0, 1), (1, 1 + around))
        scales.kinds, scales.axisymmetric = [kind], around
        assert scales.load_unit(0) == shown.get(unit, unit)
        label = f"$ ({shown.get(conjugate, conjugate)})"
        assert scales.conjugate(0, prescribed=False) == (size, label, False)
        # a prescribed displacement, or a tension that does its work on the negative
        pulls = unit == "MPa"
        assert scales.conjugate(0, prescribed=True) == (-size if pulls else size, label, not pulls)
        assert (labels.kind_of(both, "a", around) == kind) == (unit in ("MPa", ""))


@pytest.mark.parametrize("unit", ["$", "$$", r"\$x", "%_^{}", "µm", "$\\frac", "a$b"])
def test_no_unit_is_taken_for_mathematics(unit: str) -> None:
    record = given_units(odd("plane strain"), rf.Units(unit, unit, unit))
    draw, low = rf.figures, record.at(1, "minimum")
    for figure in (draw.tractions(record, low), draw.hysteresis(record, CYCLES)):
        figure.canvas.draw()
        shown = [text.get_text() for text in figure.findobj(Text) if unit[-1] in text.get_text()]
        assert shown


def test_the_height_is_the_unit_of_length_only_where_it_means_something() -> None:
    block = rf.Scene(body=rf.Body("a", height=2.0), loads=(rf.Load("p", "top", pressure=1.0),))
    assert labels.length_of(block) == 2.0
    assert labels.length_of(replace(block, units=rf.Units(length="mm"))) == 0.0
    assert labels.length_of(replace(block, units=rf.Units(stress="MPa"))) == 2.0
    for side in ("left", "right"):
        assert labels.length_of(replace(block, contacts=(rf.Contact(), rf.Contact(side)))) == 0.0
    assert labels.length_of(replace(block, others=(rf.Body("b", height=2.0),))) == 2.0
    assert labels.length_of(replace(block, others=(rf.Body("b", height=3.0),))) == 0.0
    assert labels.length_of(replace(block, others=(rf.Body("b", shape="half-plane"),))) == 2.0
    # nor with the unit of one of them is anything over the other
    for units, shown in ((UNITS, " (mm)"), (rf.Units("mm"), " (mm)"), (rf.Units(None, "MPa"), "")):
        scales = labels.Scales(given_units(odd("plane strain"), units))
        assert scales.elastic("w", 1, 1) == (1.0, f"$w${shown}")
    own = replace(block, body=rf.Body("a"), materials=(rf.Material(7.0, name="a"),))
    found = replace(odd("plane strain"), scene_toml=rf.to_toml(own))
    assert labels.Scales(found).young == 7.0 != block.material.young
    # along the wall of a cylinder positions are no radii
    cylinder = odd("axisymmetric")
    assert labels.Scales(replace(cylinder, x=cylinder.x + 1.0)).x_label == "$x/h$"
    assert labels.length_of(replace(block, body=rf.Body(mesh="body.geo"))) == 0.0


def test_tractions_are_divided_by_the_one_pressure_of_a_scene() -> None:
    divided = (2.0,), (2.0, 2.0)
    others: tuple[Any, ...] = (2.0, 3.0), (-2.0,), ("x",)
    for pressures in (*divided, *others):
        spans = zip(((-1.0, 0.0), (0.0, 1.0)), pressures, strict=False)
        loads = tuple(rf.Load("p0", "top", span, pressure=p) for span, p in spans)
        found = labels.pressure_of(rf.Scene(loads=loads), ("p0",))
        assert found == ((2.0, "p_{0}") if pressures in divided else (1.0, ""))


def test_numbers_in_titles_have_three_digits_and_no_letter_e() -> None:
    shown = {1040.0: "1040", -123456.0: "-123000", 0.0123456: "0.0123", -0.0: "0", 29.74: "29.7"}
    assert {value: labels.three_digits(value) for value in shown} == shown
    assert labels.three_digits(2.5e7) == r"2.5 \times 10^{7}"
    assert labels.three_digits(-3e-6) == r"-3 \times 10^{-6}"
    # of more loads than eight those that act, if one does
    for number, told in ((8, [*range(8)]), (9, [3])):
        names, load = tuple("abcdefghi"[:number]), np.arange(number) == 3
        assert labels.told_loads(None, names, load) == told
        assert labels.told_loads(None, names, 0.0 * load) == [*range(number)]
    parts = {0.0: "0", -1.0: "-P", 1.0: "P", 1 / 3: r"\frac{1}{3}\,P", 2 / 3: r"\frac{2}{3}\,P"}
    for part, text in (parts | {-1 / 3: r"-0.333\,P", 1e-7: r"1 \times 10^{-7}\,P"}).items():
        assert labels.describe_factor("P", part) == f"$P = {text}$".replace(
            "P$", f"{labels.peak('P')}$"
        )
        assert (
            labels.describe_factor("wheel", part)
            == f"wheel at ${labels.three_digits(part)}$ of its largest"
        )
