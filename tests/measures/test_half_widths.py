"""Half widths below node spacing of a record: the same body on either side of its edge."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bodies import ROUND, block
from drawn_text import REPORTS, check_figures
from images import Image, played
from kinds import EVEN
from models import block_system, pushed_block
from small import cyclic, table

import receding_fenicsx as rf
from receding_fenicsx.measures.ends import contact_betas, half_width_estimates, half_widths
from receding_fenicsx.measures.limit_nodes import limit_nodes, shown_states
from receding_fenicsx.output.report.summary import SECTIONS, report_html, summarise
from receding_fenicsx.store.run_folder import write_summary

pytestmark = pytest.mark.one_rank

STRAIN = "plane strain"
BETA = rf.dundurs_beta((2.0, 0.3, STRAIN))
KEYS = ("contact_half_width_estimate", "stick_half_width_estimate")


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_block_on_any_edge_has_the_ends_of_zones_of_one_lying_on_it(quarters: int) -> None:
    foot, cycle = rf.Contact(friction=0.35), rf.HistoryOptions(cycles=1)
    lying = block(degree=2, elements=160, contacts=(foot,), history=cycle)
    known, image = played(lying), Image(quarters=quarters)
    assert contact_betas(known) == pytest.approx((BETA,))
    betas = (BETA,), (-BETA,), (BETA, -BETA)
    one, two, both = (half_width_estimates(known, 0, each) for each in betas)
    for key in KEYS:
        ends = np.array([one[key]["interval"], two[key]["interval"]])
        assert one[key]["fitted"] and both[key]["interval"] == [ends.min(), ends.max()]
    image.check(played(image.of(lying)), known, 1e-8)


def test_dundurs_constant_is_that_of_an_edge_and_of_both_bodies_with_one_material() -> None:
    pair, (flat, steep) = played(EVEN["pair"]), (rf.Contact(), rf.Contact("top"))
    assert contact_betas(pair) == (rf.dundurs_beta((2.0, 0.3, STRAIN), (3.0, 0.2, STRAIN)),)
    own, layers = rf.Body(mesh="own.geo"), tuple(rf.Material(name=name) for name in ("a", "b"))
    wood = rf.Material(2.0, 0.3, "plane stress", young_2=1.0, shear=0.5)
    parts: dict[str, Any]
    for edge, parts, betas in (
        (0, {"contacts": (flat, steep)}, (BETA,)),
        (1, {"contacts": (flat, steep)}, (-BETA,)),
        (0, {"body": own, "material": ROUND}, (BETA, -BETA)),
        (0, {"body": own, "materials": layers}, ()),
        (np.arange(len(pair.edge)) % 2, {"contacts": (flat, steep)}, ()),
        (0, {"material": wood}, ()),
    ):
        scene = rf.to_toml(block(**parts))
        other = replace(pair, edge=pair.edge + edge, scene_toml=scene)
        assert contact_betas(other) == betas, parts


def test_a_contact_off_the_middle_has_zones_and_no_half_width(tmp_path: Path) -> None:
    body = pushed_block()
    summary = summarise(rf.evolve(body, table(body, [[0, 0], [1, 0], [1, 0.45]])))
    pressed, pushed = summary["turning_points"]
    for point in (pressed, pushed):  # zone by zone an end, and the ends of the edge
        assert len(point["zone_ends"]) == len(point["zones"]) - 1
    assert pressed["contact_half_width"] > pressed["stick_half_width"] > 0.0
    assert all(pressed[key] is not None for key in KEYS)
    stick = [zone for zone in pushed["zones"] if zone[0] == "stick"]
    # what sticks lies on one side of the middle
    assert len(stick) == 1 and stick[0][1] * stick[0][2] >= 0.0
    for key in KEYS:
        assert pushed[key] is pushed[key.removesuffix("_estimate")] is None
    write_summary(tmp_path / "summary.json", summary)
    assert '"stick_half_width": null' in (tmp_path / "summary.json").read_text()
    assert SECTIONS["Turning points"].tell(summary).rows[2][2:6] == [None] * 4
    assert report_html(summary).count("<td>\u2013</td>") >= 2


@pytest.mark.parametrize("method", ["events", "gauss-seidel"])
def test_a_contact_without_force_has_no_half_width(method: str) -> None:
    solver = rf.SolverOptions(method=method, steps_per_leg=10)
    record = rf.evolve(block_system(16, 4), cyclic(1, minimum=0.0), solver)
    loaded, unloaded, again = summarise(record)["turning_points"]
    turned = replace(record, f=0.0 * record.f, f_backward=record.f)
    assert half_widths(turned, 0) == half_widths(record, 0)
    for key in KEYS:
        assert unloaded[key] is unloaded[key.removesuffix("_estimate")] is None
        for point in (loaded, again):
            assert point[key]["value"] > 0.0 and point[key.removesuffix("_estimate")] > 0.0


def test_slip_of_a_settled_cycle_that_is_negligible_is_shown_as_stick() -> None:
    record = rf.evolve(block_system(24, 6), cyclic(60), output=rf.OutputOptions(cycles="all"))
    assert record.steady.kind == "cyclic slip"
    last, samples = len(record.cycles.dissipation), record.samples
    rows = samples.cycle == last
    closed = np.all(samples.state[rows] != 2, axis=0)
    slip = np.where(closed, np.ptp(samples.v[rows], axis=0), np.inf)
    still, large = slip < 1e-13 * slip[closed].max(), slip > 0.1 * slip[closed].max()
    assert still.any() and large.any()
    state = np.full(len(record.x), 3, dtype=np.int8)
    assert np.array_equal(shown_states(record, 0, state), state)
    shown = shown_states(record, last, state)
    assert np.all(shown[still] == 1) and np.all(shown[large] == 3)
    for reached, first, settled in ((True, 5, 5), (True, 1, 2), (False, -1, last)):
        steady = replace(record.steady, reached=reached, cycle=first)
        other = replace(record, steady=steady)
        for cycle in (settled - 1, settled):
            if cycle in samples.cycle:
                turned = not np.array_equal(shown_states(other, cycle, state), state)
                assert turned == (cycle == settled), (steady, cycle)
    # of these a dashed line shows where they reach their limit
    check_figures([("zones", zones := rf.figures.zone_maps(record, last))], REPORTS / "settled.txt")
    found = limit_nodes(record, last)
    assert len(found.node) > 3 and not found.strict
    for node, leg, s in zip(found.node, found.leg, found.s, strict=True):
        place = rows & (samples.leg == leg)
        k = np.flatnonzero(place)[np.abs(samples.s[place] - s).argmin()]
        limit = record.f[node] * samples.P[k, node]
        assert abs(samples.Q[k, node]) == pytest.approx(limit, rel=0.02)
    own = (found.leg == 0) & (record.x[found.node] > 0.0) & (found.s < 0.995)
    (dashed,), () = (axes.lines for axes in zones.axes)  # over the load, which falls to a third
    x, load = record.x[found.node[own]], 1.0 - 2.0 / 3.0 * found.s[own]
    assert dashed.get_xydata() == pytest.approx(np.column_stack([x, load]))
    away = replace(record, method="gauss-seidel", samples=replace(samples, P=0.0 * samples.P))
    assert not len(limit_nodes(away, last).node)  # without a force there is no limit
    # where the loop runs twice in a cycle they reach it first in the first of both
    twice = replace(cyclic(30), loop=np.array([[1.0], [1 / 3], [1.0], [1 / 3], [1.0]]))
    again = limit_nodes(rf.evolve(block_system(24, 6), twice), 30)
    assert np.array_equal([again.node, again.leg], [found.node, found.leg])
    # an edge of a millionth of the slips shows what it would show alone
    edge = (record.x > 0.0).astype(np.int64)
    tables = {
        name: replace(part, v=part.v * np.where(edge, 1e-6, 1.0))
        for name, part in (("samples", samples), ("turning_points", record.turning_points))
    }
    two = replace(record, edge=edge, edge_names=("left", "right"), **tables)  # type: ignore[arg-type]
    for k, part in enumerate(two.by_edge().values()):
        alone = shown_states(part, last, state[edge == k])
        assert np.array_equal(shown_states(two, last, state)[edge == k], alone)
