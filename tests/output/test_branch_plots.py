"""Figures of branches and of slip modes show the numbers of their trees and modes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import models
import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba, to_rgba_array
from matplotlib.figure import Figure
from small import cyclic, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.output.plots.study_plots import draw_search
from receding_fenicsx.output.snapshots import draw
from receding_fenicsx.output.snapshots.page import compose
from receding_fenicsx.output.snapshots.view import View

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"

pytestmark = pytest.mark.one_rank


def test_each_branch_is_a_line_from_rest_and_ends_are_crossed() -> None:
    K = np.kron([[2.0, 1.5], [1.5, 2.0]], np.eye(2))
    system = small_system(K, {"a": [1.0, 2.0, 0.5, 2.0], "b": [0.5, 0.0, 0.0, 0.0]}, 2.0)
    tree = rf.branches(system, table(system, [[0, 0], [1, 0], [0, 1], [0, 0], [1, 0]]))
    figure = rf.figures.branches(tree)
    first = figure.axes[0]
    # node 0 open under "a": K u = -(1, .5) gives u = (-5 / 7, 2 / 7), delta = -r* . u
    opened, end = (np.array(first.lines[k].get_data(), dtype=float).T for k in (2, 1))
    assert opened[0].tolist() == [0.0, 0.0]
    assert np.abs(opened - [4 / 7, 1.0]).sum(axis=1).min() < 1e-12
    assert end.tolist() == [[0.0, 1.0]]
    check_figures([("branches", figure)], REPORTS / "branches.txt")
    with pytest.raises(rf.InputError, match=r"^branches: no branch comes to the end of its first"):
        rf.figures.branches(rf.branches(system, table(system, [[0, 0], [0, 0]])))


def test_a_mode_is_drawn_with_its_own_numbers() -> None:
    """Slipping nodes as lines of their assumed direction, open ones as an area, p and q below."""
    system = models.block_system(20, 10)
    found = rf.evolve(system, cyclic(1))
    whole = mirror_of(system)
    critical = rf.critical_friction(system, found.at(1, "minimum").state[found.x >= 0.0])
    # turned round, the mode opens nodes
    critical = replace(
        critical, mode=-critical.mode, signs=-critical.signs, reactions=-critical.reactions
    )
    x, v, signs = (whole.odd(a) for a in (system.x, critical.mode[: system.n], critical.signs))
    w = whole.even(critical.mode[system.n :])
    with pytest.raises(rf.InputError, match=r"^slip_mode: no slip mode was found; the contact has"):
        rf.figures.slip_mode(system, replace(critical, mode=0.0 * critical.mode))
    figure = rf.figures.slip_mode(system, critical)
    check_figures([("slip mode", figure)], REPORTS / "slip_mode.txt")
    above, below = figure.axes
    area, *fans = above.collections
    for sign, state in ((1.0, rf.State.FORWARD_SLIP), (-1.0, rf.State.BACKWARD_SLIP)):
        own = signs == sign
        colour = rf.style.STATE_COLOURS[state]
        lines = (c for c in fans if isinstance(c, LineCollection))
        (fan,) = (c for c in lines if np.allclose(to_rgba_array(c.get_color()), to_rgba(colour)))
        drawn = np.array([path.vertices for path in fan.get_paths()])
        assert own.any() and np.array_equal(drawn[:, :, 0], np.stack(2 * [x[own]], axis=1))
        assert np.array_equal(drawn[:, 1, 1], v[own]) and not drawn[:, 0, 1].any()
    assert np.asarray(area.get_paths()[0].vertices)[:, 1].max() == w[signs == 0.0].max() > 0.0
    Q, P = np.split(critical.reactions, 2)
    q, p = (a / whole.total(system.weight) for a in (whole.odd_total(Q), whole.total(P)))
    for line, values in zip(below.lines, (p, q), strict=False):
        assert line.get_ydata() == pytest.approx(values / max(np.abs(p).max(), np.abs(q).max()))


def test_body_in_a_slip_mode_has_its_picture(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[tuple[View, Figure]] = []

    def noted(view: View, *rest: Any) -> Figure:
        drawn.append((view, compose(view, *rest)))
        return drawn[-1][1]

    monkeypatch.setattr(draw, "compose", noted)
    scene = rf.read_scene(BLOCK, ["mesh.contact_elements=8", "history.cycles=1"])
    system = rf.given(rf.condense(scene))
    critical = rf.critical_friction(system, rf.evolve(system, scene).at(cycle=0).state)
    file = rf.draw_slip_mode(scene, critical, shared_tmp_path / "mode.png")
    assert file is not None and file.is_file()
    ((view, page),) = drawn
    assert any(f"{critical.factor:.4g}" in text.get_text() for text in page.texts)
    strip, signs = view.strips[0], critical.signs
    bears = np.abs(critical.reactions.reshape(2, -1)).max(axis=0) > 1e-9
    known = np.where(signs > 0.0, 3, np.where(signs < 0.0, 4, np.where(bears, 1, 2)))
    assert np.array_equal(strip.state[strip.x > -1e-9], known) and not bears.all()
    shape = np.reshape(critical.mode, (2, -1)).T
    apart = np.abs(view.points[:, None] - system.points[::2]).max(axis=2)
    corner = apart.argmin(axis=0)  # nodes between the vertices are not drawn
    assert apart.min(axis=0).max() < 1e-9
    drawn_mode = (view.moved - view.points)[corner] / view.factor
    assert drawn_mode == pytest.approx(shape[::2], abs=1e-9)
    # changes at the friction of the mode; the node on the axis has no shear
    (tractions,) = [axes for axes in page.axes if "$p$" in str(axes.get_ylabel())]
    p, q = (np.asarray(line.get_ydata()) for line in tractions.lines[-2:])
    slips = np.abs(q) > 1e-9
    assert slips.sum() > 4
    assert np.abs(q[slips]) == pytest.approx(critical.factor * 0.35 * np.abs(p[slips]))
    coarser = rf.read_scene(BLOCK, ["mesh.contact_elements=4"])
    with pytest.raises(rf.InputError, match="slip mode: a mode of the scene's 5 contact nodes"):
        rf.draw_slip_mode(coarser, critical, shared_tmp_path / "other.png")
    critical = replace(critical, mode=0.0 * critical.mode)
    with pytest.raises(rf.InputError, match="with largest entry 0"):
        rf.draw_slip_mode(scene, critical, shared_tmp_path / "other.png")
    assert not (shared_tmp_path / "other.png").exists()


def test_a_search_draws_twice_its_estimates_over_its_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A number has no estimate on the first mesh, another one on none."""
    errors = ({"a_b": None, "c": None, "d": 0.02}, {"a_b": 0.004, "c": None, "d": 0.008})
    way = [
        {"seconds": seconds, "numbers": {name: {"relative": e} for name, e in level.items()}}
        for seconds, level in zip((2.0, 5.0), errors, strict=True)
    ]
    drawn: list[tuple[str, Figure]] = []
    monkeypatch.setattr(rf.style, "save", lambda figure, path: drawn.append((path.name, figure)))
    draw_search({"way": way, "tolerance": 0.01}, tmp_path)
    lines = [np.nan, np.nan], [0.04, 0.016], [np.nan, 0.008]
    check_curves(drawn[0][1].axes[0], *(([2.0, 7.0], y) for y in lines), ([0.0, 1.0], 0.01))
    check_figures(drawn, REPORTS / "search.txt")
