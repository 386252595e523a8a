"""Probes of a scene file: forms of their points, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

LOAD = '[[load]]\nname = "p"\nedge = "top"\npressure = 1.0\n'
ROUND = '[material]\nkinematics = "axisymmetric"\n'
PAIR = """
[[body]]
name = "a"
position = [0.0, 1.0]
[[body]]
name = "b"
[contact]
edge = "a.bottom"
against = "b.top"
[[load]]
name = "p"
edge = "a.top"
pressure = 1.0
"""
NAMED = '[[probe]]\nname = "one"\n'


def test_points_lists_and_segments_are_read_and_written() -> None:
    scene = rf.from_toml(
        LOAD
        + f"{NAMED}point = [0.5, 1]\n"
        + '[[probe]]\nname = "two"\npoints = [[0.5, 1.0], [0.0, 0.0]]\n'
        + '[[probe]]\nname = "line"\nsegment = [[-0.7, 0.0], [0.7, 1.0]]\ncount = 3\n'
    )
    found = [probe.coordinates for probe in scene.probes]
    assert found[:2] == [((0.5, 1.0),), ((0.5, 1.0), (0.0, 0.0))]
    # the middle of a symmetric segment lies on the axis of symmetry exactly
    assert found[2] == ((-0.7, 0.0), (0.0, 0.5), (0.7, 1.0))
    assert rf.from_toml(rf.to_toml(scene)) == scene
    fine = rf.Probe("fine", segment=((0.1, 0.0), (0.3, 0.9)), count=1000)
    steps = np.diff(np.array(fine.coordinates), axis=0)
    assert np.abs(steps - [0.2 / 999, 0.9 / 999]).max() < 1e-15
    assert fine.coordinates[-1] == (0.3, 0.9)
    changed = rf.from_toml(rf.to_toml(scene), ["probe.two.points=[[1, 0.5]]"])
    assert changed.probes[1].coordinates == ((1.0, 0.5),)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (LOAD + "[[probe]]\npoint = [0.0, 0.0]", "[[probe]] number 1: the key 'name' is missing"),
        (LOAD + NAMED, "probe 'one': has none of point, points, segment, edge; give exactly one"),
        (
            LOAD + NAMED + "point = [0, 0]\npoints = [[0, 0]]",
            "probe 'one': has point and points of point, points, segment, edge; give exactly one",
        ),
        (LOAD + NAMED + "point = [0, 0]\ncount = 3", "count: belongs to a segment; remove it"),
        (
            LOAD + NAMED + "segment = [[0, 0], [1, 1]]",
            "count: a segment needs its number of points; add count",
        ),
        (
            LOAD + NAMED + "segment = [[0, 0], [0, 0]]\ncount = 2",
            "segment: needs two different ends, [[x, y], [x, y]]",
        ),
        (LOAD + NAMED + "point = [0, 1.1]", "probe 'one': (0, 1.1) lies outside the body, -2 <= x"),
        (ROUND + LOAD + NAMED + "point = [-0.1, 0]", "outside the body, 0 <= x <= 2"),
        (LOAD + 2 * (NAMED + "point = [0, 0]\n"), "probe 'one': two probes have this name; rename"),
        (
            LOAD + NAMED + 'point = [0, 0]\n[[probe]]\nname = "ONE"\npoint = [0, 0]',
            "probe 'ONE': two probes have this name; rename one",
        ),
        (
            LOAD + '[[probe]]\nname = "a/b"\npoint = [0, 0]',
            "[[probe]] name: 'a/b' cannot be the name of a file; use letters",
        ),
        (LOAD + NAMED + 'point = [0, 0]\nbody = "a"', "one' body: the scene has one body only"),
        (PAIR + NAMED + "point = [0, 0]", "'one' body: must name the body of the point; give one"),
        (PAIR + NAMED + 'point = [0, 0]\nbody = "a"', "'one': (0, 0) lies outside the body, -2"),
        (
            LOAD
            + NAMED
            + "segment = [[0, 0], [1, 1]]\ncount = 999\n"
            + '[[probe]]\nname = "two"\npoints = [[0, 0], [1, 0]]',
            "[[probe]]: the probes have 1001 points, at most 1000 are possible",
        ),
    ],
)
def test_probes_that_cannot_be_are_refused_in_one_line(scene: str, message: str) -> None:
    with pytest.raises(rf.InputError) as caught:
        rf.from_toml(scene)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
