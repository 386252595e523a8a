"""Figures of the probes show the recorded stresses."""

from dataclasses import replace
from functools import cache

import models
import numpy as np
import pytest
from small import cyclic

import receding_fenicsx as rf
from receding_fenicsx.interface.system import ProbeMatrix
from receding_fenicsx.output.plots.figures import draw_all

pytestmark = pytest.mark.one_rank


@cache
def record() -> rf.Record:
    """The block with two probes, one of them of three points, whose rows are any numbers."""
    system = models.block_system(16, 6)
    rows = np.random.default_rng(3).standard_normal((4, 6, 2 * system.n + 1))
    points = np.array([[0.5, 0.5], [0.0, 0.0], [0.3, 0.4], [0.3, 1.0]])
    probes = ProbeMatrix(("one", "row", "row", "row"), points, rows)
    return rf.evolve(replace(system, probes=probes), cyclic(3, minimum=0.3))


def lines(axes: object) -> list[tuple[np.ndarray, np.ndarray]]:
    return [line.get_data() for line in axes.lines if len(line.get_xdata()) > 2]  # type: ignore[attr-defined]


def test_each_probe_has_its_figure() -> None:
    names = [name for name, _ in draw_all(record())]
    assert {"probe_one", "probe_row"} <= set(names)
    with pytest.raises(rf.InputError, match="'rwo': is not in the record; did you mean 'row'"):
        rf.figures.probe_stresses(record(), "rwo")


def test_stresses_of_a_point_are_drawn_along_the_legs() -> None:
    figure = rf.figures.probe_stresses(record(), "one")
    probe = record().probe("one")
    for axes, cycle in zip(figure.axes, (0, 1, 3), strict=True):
        rows = probe.cycle == cycle
        for (x, y), values in zip(lines(axes), probe.stress[:, 0].T, strict=False):
            # each panel begins where the cycle before ends
            assert np.array_equal(x[1:], (probe.leg + probe.s)[rows]) and x[0] == 0.0
            assert np.array_equal(y[1:], values[rows])
        assert len(lines(axes)) == 5
        # a guide where each leg but the last one ends
        places = [np.asarray(line.get_xdata(), dtype=float) for line in axes.lines]
        guides = [x[0] for x in places if len(x) == 2]
        assert sorted(set(guides) - {0.0}) == list(range(1, int(probe.leg[rows].max()) + 1))
        assert np.array_equal(lines(axes)[4][1][1:], probe.von_mises[rows, 0])


def test_stresses_of_several_points_are_drawn_along_them() -> None:
    figure = rf.figures.probe_stresses(record(), "row")
    probe = record().probe("row")
    ends = np.flatnonzero((probe.cycle == 3) & (probe.kind == "turning point"))
    for axes, row in zip(figure.axes, ends, strict=True):
        for (x, y), values in zip(lines(axes), probe.stress[row].T, strict=False):
            assert np.allclose(x, [0.0, 0.5, 1.1])
            assert np.array_equal(y, values)
