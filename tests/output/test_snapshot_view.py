"""What a picture of the body shows, as numbers: units, parity, gaps, colours against the legend."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_page, check_words, names_of_colours, told
from kinds import EVEN, UNEVEN
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.tri import TriContourSet
from pictured import instant_of_row, small_block, view_at

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.evolution.instants import Instant
from receding_fenicsx.interface.law import Friction
from receding_fenicsx.output.plots.labels import length_of
from receding_fenicsx.output.snapshots.page import QUANTITIES, Clock, colours_of, compose, layout_of
from receding_fenicsx.output.snapshots.page import _draw_clock as draw_clock
from receding_fenicsx.output.snapshots.page import _draw_line as draw_line
from receding_fenicsx.output.snapshots.page import _draw_plane as draw_plane
from receding_fenicsx.output.snapshots.view import Arrows, View, _caption, _traction, outline

DEMOS = Path(__file__).parents[2] / "demos"
PRESSURE, HEIGHT, YOUNG, LARGEST = 2.0, 3.0, 5.0, 4.0
"""Where they are all 1, what divides by the wrong one looks the same."""

BLOCK = rf.Scene(
    body=rf.Body(width=4.0 * HEIGHT, height=HEIGHT),
    material=rf.Material(young=YOUNG),
    mesh=rf.MeshOptions(contact_elements=16, degree=2, growth=1.4),
    contacts=(rf.Contact(friction=0.35, initial_gap="0.002*x**2"),),
    loads=(rf.Load("p0", "top", (-HEIGHT, HEIGHT), pressure=PRESSURE),),
    history=rf.HistoryOptions(maximum=LARGEST, minimum=LARGEST / 3.0, cycles=1),
)


def seen(scene: rf.Scene, row: int = 1) -> tuple[View, Fields, rf.Record] | None:
    """View, fields and record of a turning point, on rank 0."""
    record, now = instant_of_row(scene, row)
    made = view_at(scene, now)
    return None if made is None else (*made, record)


def above_top(view: View, ends: np.ndarray) -> np.ndarray:
    """How far ends of arrows lie above the deformed top."""
    edge = view.moved[np.isclose(view.points[:, 1], 1.0)]
    edge = edge[np.argsort(edge[:, 0])]
    return ends[:, 1] - np.interp(ends[:, 0], *edge.T)


@pytest.mark.parametrize("symmetry", ["auto", "none"])
def test_view_is_over_the_height_and_the_pressure_that_acts(symmetry: str) -> None:
    contact = replace(BLOCK.contacts[0], shear_limit=50.0)  # beyond what acts
    solver = rf.SolverOptions(symmetry=symmetry)
    made = seen(replace(BLOCK, contacts=(contact,), solver=solver))
    if made is None:
        return
    view, fields, record = made
    acting = PRESSURE * LARGEST / 3.0
    table = record.turning_points
    assert record.half == (symmetry == "auto")
    assert view.x == pytest.approx(record.x / HEIGHT, rel=1e-14)
    assert view.points.min(axis=0) == pytest.approx([-2.0, 0.0], abs=1e-14)
    assert view.points.max(axis=0) == pytest.approx([2.0, 1.0], abs=1e-14)
    # the record's tractions: normal even, tangential odd
    assert view.p == pytest.approx(table.p[1] / acting, rel=1e-9)
    assert view.q == pytest.approx(table.q[1] / acting, abs=1e-9)
    assert np.abs(view.q).max() > 0.05
    known = record.traction_law(acting).limits(100.0 * view.p)
    assert np.allclose(view.f.limits(100.0 * view.p), known) and np.max(known) < 20.0
    for name, value in fields.stress.items():
        if name != "sxy":  # that of the axis is made zero
            assert view.stress[name].min() == pytest.approx(value.min() / acting, rel=1e-12)
            assert view.stress[name].max() == pytest.approx(value.max() / acting, rel=1e-12)
    # below the load the body is pressed by the pressure
    above = np.isclose(view.points[:, 1], 1.0) & (np.abs(view.points[:, 0]) < 0.8)
    assert view.stress["syy"][above] == pytest.approx(-1.0, abs=0.1)
    assert view.caption == r"first unloading, $p_{0} = \frac{1}{3}\,p_{0}^{\,\mathrm{max}}$"
    (load,) = view.arrows
    # the largest load's arrow is 0.24 of the height long
    assert np.allclose(load.heads - load.tails, [0.0, -0.08], rtol=0.0, atol=1e-12)
    # they end 0.02 of it above the deformed edge
    assert above_top(view, load.heads) == pytest.approx(0.02, abs=2e-3)


def test_a_pull_by_a_pressure_with_a_negative_factor_is_a_tension_in_the_picture() -> None:
    history = rf.HistoryOptions("table", columns=("p0",), rows=((LARGEST,), (-LARGEST,)))
    supports = tuple(rf.Support("xy", edge=edge) for edge in ("left", "right"))
    made = seen(replace(BLOCK, history=history, supports=supports))
    if made is None:
        return
    view, *_ = made
    assert np.all(view.strips[0].state == rf.State.SEPARATION)
    above = np.isclose(view.points[:, 1], 1.0) & (np.abs(view.points[:, 0]) < 0.8)
    assert view.stress["syy"][above] == pytest.approx(1.0, abs=0.1)
    assert above_top(view, view.arrows[0].tails) == pytest.approx(0.02, abs=2e-3)


def test_pictures_are_in_the_units_of_the_scene() -> None:
    made = seen(replace(BLOCK, units=rf.Units("mm", "MPa")))
    if made is None:
        return
    view, fields, record = made
    assert view.x == pytest.approx(record.x, rel=1e-14)
    assert view.p == pytest.approx(record.turning_points.p[1], rel=1e-9)
    assert view.stress["von_mises"].max() == pytest.approx(fields.stress["von_mises"].max())
    shown = told(page_of(view), "in units")
    # a mesh on several ranks begins elsewhere
    known = [line for line in shown if not line.startswith("LineCollection")]
    check_words(known, REPORTS / "page_in_units.txt")


@pytest.mark.one_rank
def test_captions_tell_the_first_unloading_later_ones_and_legs_of_other_cycles() -> None:
    block, none = small_block(), cast(Any, None)
    ends = (0.5,), (0.7,), (1.0,)
    table = rf.HistoryOptions("table", columns=("p0",), rows=((1.0,),), cycle_rows=ends)
    legs = {(0, 0): "first loading", (1, 0): "first unloading", (1, 1): "reloading, cycle 1"}
    legs |= {(2, 0): "unloading, cycle 2", (2, 2): "cycle 2, leg 2"}
    for (cycle, leg), words in legs.items():
        scene = replace(block, history=table) if leg == 2 else block
        now = Instant(cycle, leg, 1.0, np.ones(1), none, none)
        assert _caption(scene, now).startswith(f"{words}, $p_{{0}}")


@pytest.mark.one_rank
@pytest.mark.parametrize("axisymmetric", [True, False])
def test_arrows_of_all_kinds_of_loads_are_what_acts_in_a_section_too(axisymmetric: bool) -> None:
    area = np.pi * 1.5**2 if axisymmetric else 3.0
    scene = rf.Scene(
        body=rf.Body(width=3.0, height=1.0),
        material=rf.Material(kinematics="axisymmetric" if axisymmetric else "plane strain"),
        loads=(
            rf.Load("F", "top", platen=True, force=(0.0, -7.0)),
            rf.Load("p", "top", pressure=7.0 / area),
            rf.Load("s", "top", traction=("x", 0.0)),
            rf.Load("g", "top", pressure="2 + x"),
        ),
    )
    moved = rf.Load("m", "top", (-0.5, 0.5), pressure="2 + x", travel=(1.25,))
    x, there = np.linspace(-1.5, 1.5, 11), np.linspace(0.75, 1.5, 4)
    mean, away = 0.0 * x + 7.0 / area, np.abs if axisymmetric else np.positive
    sizes = mean, mean, 0.0 * x, 2.0 + away(x), 2.0 + away(there - 1.25)
    for load, r, p in zip((*scene.loads, moved), (x, x, x, x, there), sizes, strict=True):
        q = r * (load.name == "s")
        at, _, found = _traction(scene, load, 0.3)
        assert np.hstack([at, found]) == pytest.approx(np.stack([r, 1.0 + 0.0 * r, q, -p], axis=1))


@pytest.mark.one_rank
def test_in_a_section_forward_friction_is_that_of_outward_slip_on_both_sides() -> None:
    friction: Any = {"forward": 0.4, "backward": 0.1}
    round_, pressed = rf.Material(kinematics="axisymmetric"), rf.Load("p0", "top", pressure=1.0)
    scene = replace(small_block(), material=round_, loads=(pressed,))
    made = seen(replace(scene, contacts=(rf.Contact(friction=friction),)), 0)
    assert made is not None
    view, *_ = made
    left = view.x < 0.0
    assert left.any() and (~left).any()
    # slip towards +x is inward on the left
    assert np.array_equal(view.f.forward, np.where(left, 0.1, 0.4))
    assert np.array_equal(view.f.backward, np.where(left, 0.4, 0.1))
    # pictures have the states that they are told to show
    now = instant_of_row(small_block(), 0)[1]
    slips = view_at(small_block(), now._replace(shown=np.full_like(now.state.state, 4)))
    assert slips is not None and set(slips[0].strips[0].state) == {3, 4}  # mirrored on the left
    # a ring has one side
    made = seen(replace(scene, contacts=(rf.Contact(span=(0.5, 1.0)),)), 0)
    assert made is not None and made[0].x.min() > 0.15


# -- the page ------------------------------------------------------------------------------------


@cache
def view_alone() -> View:
    """The block at a third of its load, all four states in its contact, on one rank."""
    made = seen(BLOCK)
    assert made is not None and set(made[0].strips[0].state) == {1, 2, 3, 4}
    return made[0]


def page_of(view: View, stress: str = "max_shear", clock: Clock | None = None) -> Figure:
    """The page around an empty field, with contour lines of a stress."""
    quantity = next(q for q in QUANTITIES if q.name == stress)
    values = view.stress[stress] * (2.0 if stress == "max_shear" else 1.0)
    colours = colours_of(values, quantity, view.pressure_symbol)
    with mpl.rc_context(rf.style.RC):
        layout = layout_of(view, dpi=50.0)
        empty = np.zeros((*layout.pixels[::-1], 4), dtype=np.uint8)
        return compose(view, layout, empty, colours, clock, values)


@pytest.mark.one_rank
def test_band_of_states_has_the_colours_of_the_legend_where_the_states_are() -> None:
    view = view_alone()
    figure = page_of(view)
    named, body = names_of_colours(figure), figure.axes[0]
    assert len(named) == 4
    (boxes,) = [c for c in body.collections if isinstance(c, PolyCollection)]
    ends, expected = [], rf.zones(view.x, view.strips[0].state)
    fills: Any = boxes.get_facecolor()
    for path, colour in zip(boxes.get_paths(), map(to_hex, fills), strict=True):
        x, y = np.asarray(path.vertices).T
        ends.append((named[colour], x.min(), x.max()))
        assert y.max() < 0.0  # below the plane
    # the tractions stand below their nodes, those of an upright edge over all of it
    (strip,), half = view.strips, np.array([-1.0, 1.0])
    turned = replace(strip, place=strip.place * half, normal=-strip.normal)
    for shown, page in ((strip, figure), (turned, page_of(replace(view, strips=(turned,))))):
        places = page.axes[0].transData.transform(shown.place)[:, 0]
        x = np.column_stack([shown.x, 0.0 * shown.x])
        assert places == pytest.approx(page.axes[1].transData.transform(x)[:, 0], abs=0.01)
    upright = replace(view, strips=(replace(strip, normal=np.array([1.0, 0.0])),))
    assert page_of(upright).axes[1].get_xlim() == (strip.x[0], strip.x[-1])
    # beyond a shorter contact edge no plane is known
    inner = np.abs(strip.x) <= 1.0
    cut: Any = {key: getattr(strip, key)[inner] for key in ("x", "place", "moved", "gap", "state")}
    steep = replace(strip, gap=0.1 * (strip.x - strip.x[0]))
    for shown, end in ((steep, 2.0 + 0.05 * view.size), (replace(strip, **cut), 1.0)):
        draw_plane(axes := Figure().subplots(), view, shown)
        x, y = np.array(axes.lines[0].get_data())
        assert x.max() == pytest.approx(end)
        # below the edge by the gap and a little, and the band below it
        assert -y == pytest.approx(np.interp(x, shown.x, shown.gap) + 0.01 * view.size)
        corners = np.vstack([np.asarray(box.vertices) for box in axes.collections[0].get_paths()])
        assert corners[:, 1].max() < y.min()
    # between bodies the states are on the first one's edge where it is drawn
    draw_line(axes := Figure().subplots(), strip)
    pieces = [np.asarray(path.vertices) for path in axes.collections[1].get_paths()]
    assert np.array_equal([pieces[0][0], pieces[-1][-1]], strip.moved[[0, -1]])
    smooth = page_of(replace(view, f=Friction(0.0 * strip.x, 0.0 * strip.x)))
    assert [*names_of_colours(smooth).values()] == ["contact", "separation"]
    for found, zone in zip(ends, expected, strict=True):
        assert found[0] == zone[0] and found[1:] == pytest.approx(zone[1:])


@pytest.mark.one_rank
def test_contours_cross_the_cells_and_outlines_are_those_before_and_after() -> None:
    """Of the field x on a square, a cell of four corners, that moves aside by a half."""
    square = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    cells, stress, aside = np.array([[0, 1, 2, 3]]), {"syy": square[:, 0]}, np.array([0.5, 0.0])
    view = replace(view_alone(), points=square, moved=square + aside, cells=cells, stress=stress)
    drawn = page_of(view, "syy").axes[0].collections
    before, after, *_ = (c for c in drawn if isinstance(c, LineCollection))
    for sides, left in ((before, 0.0), (after, 0.5)):
        corners = np.vstack([np.asarray(path.vertices) for path in sides.get_paths()])
        assert [*corners.min(axis=0), *np.ptp(corners, axis=0)] == [left, 0.0, 1.0, 1.0]
    (contours,) = (c for c in drawn if isinstance(c, TriContourSet))
    lines = [line for line in (np.asarray(p.vertices) for p in contours.get_paths()) if len(line)]
    assert len(lines) > 4 and min(line[0, 0] for line in lines) > 0.5
    assert np.allclose([np.ptp(line, axis=0) for line in lines], [0.0, 1.0])


@pytest.mark.one_rank
@pytest.mark.parametrize("name", EVEN | UNEVEN)
def test_pictures_of_scenes_of_all_kinds_show_every_contact_edge_as_the_record_has_it(
    name: str,
) -> None:
    made = seen((EVEN | UNEVEN)[name], -1)
    assert made is not None
    view, fields, record = made
    parts, scene = [*record.by_edge().values()], rf.given(record.scene)
    assert view.factor <= 1.0 or not all(body.is_half_plane for body in scene.bodies)
    # lengths are as large upwards as along, at most 4.5 inches, and all the body shows
    layout = layout_of(view)
    left, right, bottom, top = layout.window
    assert np.divide(*layout.pixels) == pytest.approx((right - left) / (top - bottom), rel=0.01)
    both = np.vstack([view.points, view.moved])
    sides = both.min(axis=0) - (left, bottom), (right, top) - both.max(axis=0)
    assert layout.height < 4.5001 and (view.near or np.min(sides) > 0.0)
    longest = [np.linalg.norm(a.heads - a.tails, axis=1).max() for a in view.arrows]
    assert max(longest, default=0.0) < 0.2401 * view.size
    # one end of most is a little beside an edge of a deformed body
    begin, end = np.moveaxis(view.moved[outline(view.cells)], 1, 0)
    along = end - begin
    for arrows in view.arrows:
        ends = np.stack([arrows.tails, arrows.heads])[:, :, None]
        s = np.clip(np.sum((ends - begin) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
        off = np.linalg.norm(ends - begin - s[..., None] * along, axis=-1).min(axis=2)
        assert np.median(np.abs(off / view.size - 0.02).min(axis=0)) < 0.002
    length = length_of(scene) or 1.0
    # a round number by which the largest displacement is a tenth of the height, or less
    largest, high = np.linalg.norm(fields.displacement, axis=1).max(), np.ptp(view.points[:, 1])
    assert float(f"{view.factor:.0e}") == view.factor
    assert 0.5 * (name != "half-planes") < 10.0 * view.factor * largest / (length * high) <= 1.0
    for strip, part in zip(view.strips, parts, strict=True):
        here = strip.x > -1e-9 if record.axisymmetric else np.isfinite(strip.x)
        table, shown = part.turning_points, (strip.moved - strip.place)[here] * length / view.factor
        assert strip.x[here] == pytest.approx(part.x / length, abs=1e-12)
        assert np.array_equal(strip.state[here], table.state[-1])
        if not strip.rigid:
            continue
        # a node is as far from the plane as the record has it, also where a load moves that
        n, gap = strip.normal, strip.gap[here] * length / view.factor
        moved = np.outer(table.v[-1], [n[1], -n[0]]) + np.outer(table.w[-1] + part.g0, n)
        off = np.abs(shown + gap[:, None] * n - moved).max(axis=1)
        vertex = off <= 1e-9 * max(np.abs(moved).max(), np.abs(shown).max())
        assert vertex[0] and vertex[-1] and vertex.sum() >= len(vertex) // 2
    here = view.x > -1e-9 if record.axisymmetric else np.isfinite(view.x)
    p, q = (getattr(parts[0].turning_points, key)[-1] for key in "pq")
    unit = np.abs(p).max() / np.nanmax(np.abs(view.p[here]))
    for values, known in ((view.p, p), (view.q, q)):
        tells = here & np.isfinite(values)
        assert unit * values[tells] == pytest.approx(known[tells[here]], abs=1e-9 * np.abs(p).max())
    law, shown = parts[0].traction_law(unit)[tells[here]], view.f[tells]
    assert np.allclose(shown.limits(view.p[tells]), law.limits(view.p[tells]), atol=1e-9)


@pytest.mark.one_rank
@pytest.mark.parametrize("near", [False, True])
def test_a_close_up_shows_the_arrows_that_end_in_it(near: bool) -> None:
    """Of arrows along the edge, and from it, those that come from beyond the window too."""
    inside, beyond = np.array([[0.2, 0.1], [-0.3, 0.0]]), np.array([[90.0, 80.0], [0.0, -70.0]])
    ends = (beyond, inside), (inside, beyond), (inside, inside[::-1])
    arrows = [Arrows(tails, heads, k == 1) for k, (tails, heads) in enumerate(ends)]
    body, *_ = page_of(replace(view_alone(), near=near, arrows=arrows)).axes
    notes = [text for text in body.texts if isinstance(text, Annotation) and not text.get_text()]
    drawn = [(*note.xyann, *note.xy) for note in notes]
    shown = [np.hstack(both) for both in ends if not near or both[1] is not beyond]
    assert np.array_equal(drawn, np.vstack(shown))
    (joint,) = (line for line in body.lines if line.get_color() == "#202020")
    assert np.array_equal(joint.get_xydata(), inside)


@pytest.mark.one_rank
def test_pages_draw_what_is_known() -> None:
    """All four states; two edges, one of them between bodies; a load that travels, in a film."""
    coarse = ["mesh.contact_elements=16", "history.cycles=1"]
    stack = rf.read_scene(DEMOS / "stack.toml", coarse)
    limited = replace(stack.contacts[0], shear_limit="0.05 + 0.002*x")
    heavy = [*coarse, "load.weight.body_force=[0,-1]"]
    travelling = rf.read_scene(DEMOS / "moving_load.toml", heavy)
    scenes = {
        "block": (BLOCK, 1),
        "stack": (replace(stack, contacts=(limited, stack.contacts[1])), 1),
        "travelling": (replace(travelling, contacts=(rf.Contact(cohesion="0.02 + 0.001*x"),)), 6),
    }
    found = []
    for name, (scene, row) in scenes.items():
        made = seen(scene, row)
        assert made is not None
        view, _, record = made
        table = record.turning_points
        load = table.load[:, :2] / np.abs(table.load[:, :2]).max(axis=0)
        time = np.linspace(0.0, 1.0, len(load))
        names = tuple(f"${load_name}$" for load_name in record.load_names[:2])
        clock = Clock(time, load, names, 0.25, load[row], (-0.6, 2.5), "upper left")
        for stress in ("syy", "max_shear"):
            own = clock if name == "travelling" else None
            check_page(page := page_of(view, stress, own), name)
            body, *_, bar = page.axes
            for band in (c for c in body.collections if isinstance(c, PolyCollection)):
                corners = [body.transData.transform(path.vertices) for path in band.get_paths()]
                assert min(np.ptp(box[:, 1]) for box in corners) > 0.122 * 50.0  # room for numbers
                assert min(box[:, 1].min() for box in corners) > body.bbox.y0
            high, tall = bar.bbox.height / 50.0, np.ptp(body.transData.transform(view.moved)[:, 1])
            assert high == pytest.approx(max(tall / 50.0, 0.7), rel=0.07)  # inches, as the body
            assert 0.18 <= high * np.diff(bar.get_yticks())[0] / np.ptp(bar.get_ylim()) < 0.5
            found += told(page, f"{name} {stress}")
            x, *curves = view.x, view.p, view.q
            for line, values in zip(page.axes[1].lines[-2:], curves, strict=True):
                known = np.isfinite(values)
                assert np.array_equal(line.get_xydata(), np.transpose([x, values])[known])
            if own is not None:  # over time each load, and a dot
                dots = [([own.now], [own.now_load[k]]) for k in range(2)]
                check_curves(page.axes[2], (time, load[:, 0]), dots[0], (time, load[:, 1]), dots[1])
                assert page.axes[1].get_ylim() == own.tractions
                legend = page.axes[1].get_legend().get_window_extent()  # type: ignore[union-attr]
                assert legend.x1 < np.mean(page.axes[1].bbox.intervalx)
    # a load that is always there is drawn from zero on, a name as a word has its own line
    for sign, ticks in ((1.0, [0.0, 0.75]), (-1.0, [-0.75, 0.0])):
        load = sign * np.array([[0.25], [0.75]])
        alone = Clock(np.array([0.0, 1.0]), load, (r"$\mathrm{press}$",), 0.0, load[0], (0.0, 1.0))
        draw_clock(axes := Figure().subplots(), alone)
        assert axes.get_yticks().tolist() == ticks and axes.lines[0].get_color() == "black"
        assert axes.get_xlabel() == "$\\mathrm{press}$\nover time"
    check_words(found, REPORTS / "pages.txt")


@pytest.mark.one_rank
@pytest.mark.parametrize(("scale", "apart"), [(1.0, 0.2), (1e6, 2e5), (3.0, 0.5)])
def test_fringes_are_white_at_whole_orders_and_black_halfway(scale: float, apart: float) -> None:
    """Photoelasticity: light of a crossed polariscope counts 2 tau_max, the stress difference."""
    fringes = next(q for q in QUANTITIES if q.name == "max_shear")
    colours = colours_of(scale * np.array([0.0, 2.0, 1.0, 0.5]), fringes, "p_0")
    # the largest, 2, has at least ten
    assert colours.note == rf"one fringe {apart:g}$\,p_0$"
    assert colours.limits == (0.0, pytest.approx(2.0 * scale)) and len(colours.levels) == 0
    assert colours.extend == "neither"
    at = np.linspace(*colours.limits, len(colours.table))
    for order in range(10):
        for part, grey in ((0.0, 1.0), (0.25, 0.5), (0.5, 0.0), (0.75, 0.5)):
            shown = [np.interp((order + part) * apart, at, c) for c in colours.table.T]
            assert shown == pytest.approx([grey] * 3, abs=0.01), (order, part)


def test_small_contact_is_shown_from_near_by() -> None:
    punch = rf.read_scene(DEMOS / "punch.toml", ["mesh.contact_elements=16"])
    made = seen(punch, row=0)
    if made is None:
        return
    view, *_ = made
    assert view.near
    left, right, bottom, top = layout_of(view).window
    length = float(np.ptp(view.x))
    moved = np.hypot(*(view.moved - view.points).T).max()
    assert 0.5 < moved / (0.05 * length) <= 1.0  # a tenth of half the contact, rounded down
    # the contact is a third of the page wide, and what is far away is not shown
    assert length > 0.3 * (right - left)
    assert np.ptp(view.points, axis=0).max() > 10.0 * length
    assert left < view.x[0] and view.x[-1] < right and top - bottom < 4.0 * length
