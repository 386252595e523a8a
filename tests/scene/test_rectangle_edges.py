from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.symmetry import edge_points, edge_range
from receding_fenicsx.scene.toml_file import read_scene

pytestmark = pytest.mark.one_rank

DEMOS = Path(__file__).parents[2] / "demos"


def test_edges_are_measured_from_the_centre() -> None:
    scene = read_scene(DEMOS / "block.toml")
    assert edge_range(scene, "bottom") == (-2.0, 2.0)
    assert edge_range(scene, "left") == (-0.5, 0.5)
    for edge, point in {
        "bottom": (0.25, 0.0),
        "top": (0.25, 1.0),
        "left": (-2.0, 0.75),
        "right": (2.0, 0.75),
    }.items():
        x, y = edge_points(scene, edge, 0.25)
        assert (float(x), float(y)) == point
    with pytest.raises(InputError, match="no edge"):
        edge_range(scene, "roof")


def test_edges_move_with_their_body() -> None:
    scene, offset = read_scene(DEMOS / "block.toml"), (3.0, -7.0)
    moved = replace(scene, body=replace(scene.body, position=offset))
    for edge in ("bottom", "top", "left", "right"):
        before, after = (np.stack(edge_points(s, edge, [-0.5, 0.25])) for s in (scene, moved))
        assert np.array_equal(after, before + np.array(offset)[:, None]), edge
