"""Probes of a scene file: forms of their points, and what is refused."""

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
