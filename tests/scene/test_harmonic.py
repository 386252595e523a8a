"""Harmonic histories as polygons, and constant loads beside cyclic ones."""

import numpy as np
import pytest

from receding_fenicsx.scene.history import History, history_from_scene
from receding_fenicsx.scene.toml_file import from_toml, to_toml

pytestmark = pytest.mark.one_rank

BODY = """
[[load]]
name = "P"
edge = "top"
pressure = 1.0
[[load]]
name = "Q 1"
edge = "top"
traction = [1.0, 0.0]
"""
OUT_OF_PHASE = """
[history]
kind = "harmonic"
cycles = 3
[history.harmonic.P]
mean = 1.0
amplitude = 0.5
phase = 20
[history.harmonic."Q 1"]
amplitude = 0.25
phase = 110
"""


def made(history: str, *changes: str) -> History:
    scene = from_toml(f"{BODY}{history}", changes)
    assert from_toml(to_toml(scene)) == scene
    return history_from_scene(scene)


def test_corners_lie_on_the_ellipse_and_hold_the_extremes_of_each_load() -> None:
    for corners in (4, 7, 16, 100):
        history = made(OUT_OF_PHASE, f"history.corners={corners}")
        assert history.loop.shape == (corners + 1, 2)
        P, Q = history.loop.T
        np.testing.assert_allclose(((P - 1.0) / 0.5) ** 2 + (Q / 0.25) ** 2, 1.0, atol=1e-14)
        assert (P.min(), P.max(), Q.min(), Q.max()) == (0.5, 1.5, -0.25, 0.25)
        # once around: the angle from corner to corner has one sign and adds up to a turn
        way = np.diff(np.unwrap(np.arctan2(Q / 0.25, (P - 1.0) / 0.5)))
        assert np.all(way > 0.0)
        np.testing.assert_allclose(way.sum(), 2.0 * np.pi, rtol=1e-14)
        np.testing.assert_array_equal(history.loop[0], history.loop[-1])


def test_path_leads_over_the_means_to_the_maximum_of_the_first_load() -> None:
    assert made(OUT_OF_PHASE).path.tolist() == [[0.0, 0.0], [1.0, 0.0], [1.5, 0.0]]
    still = made(OUT_OF_PHASE, "history.harmonic.P={mean=1.0}")
    assert still.path.tolist() == [[0.0, 0.0], [1.0, 0.0], [1.0, 0.25]]
    preloaded = made(OUT_OF_PHASE, "history.harmonic={P={amplitude=0.5}}", "history.constant.Q 1=2")
    assert preloaded.path.tolist() == [[0.0, 0.0], [0.0, 2.0], [0.5, 2.0]]


@pytest.mark.parametrize(
    ("phase", "second"), [(20, -0.25), (200, 0.25), (380, -0.25), (-160, 0.25)]
)
def test_loads_in_phase_or_opposite_need_two_corners(phase: float, second: float) -> None:
    history = made(OUT_OF_PHASE, f"history.harmonic.Q 1.phase={phase}", "history.corners=64")
    np.testing.assert_array_equal(history.loop, [[1.5, -second], [0.5, second], [1.5, -second]])


def test_arcs_between_close_extremes_are_divided_evenly() -> None:
    loop = made(OUT_OF_PHASE, "history.harmonic.Q 1.phase=50", "history.corners=24").loop
    angles = np.degrees(np.arccos(np.clip((loop[:13, 0] - 1.0) / 0.5, -1.0, 1.0)))
    np.testing.assert_allclose(angles, 15.0 * np.arange(13), atol=1e-6)


@pytest.mark.parametrize("phase", [22, 50, 110, 199])
def test_doubled_corners_divide_every_piece(phase: float) -> None:
    # else the dissipation does not change where an arc between close extremes keeps its piece,
    # and the error estimate is too small
    change = f"history.harmonic.Q 1.phase={phase}"
    for corners in (8, 9, 24, 32):
        coarse, fine = (
            made(OUT_OF_PHASE, change, f"history.corners={n}").loop for n in (corners, 2 * corners)
        )
        np.testing.assert_allclose(fine[::2], coarse, atol=1e-14)


@pytest.mark.parametrize(
    ("history", "path", "loop"),
    [
        (
            'kind = "cyclic"\nminimum = -1\nconstant = {P = 2}',
            [[0, 0], [2, 0], [2, 1]],
            [[2, 1], [2, -1], [2, 1]],
        ),
        ('kind = "monotonic"\nconstant = {"Q 1" = -1}', [[0, 0], [0, -1], [1, -1]], []),
        ('kind = "cyclic"\nconstant = {P = 0}', [[0, 0], [0, 1]], [[0, 1], [0, 1 / 3], [0, 1]]),
    ],
)
def test_constant_loads_are_applied_first_and_kept(
    history: str, path: list[list[float]], loop: list[list[float]]
) -> None:
    found = made(f"[history]\n{history}")
    np.testing.assert_array_equal(found.path, path)
    np.testing.assert_array_equal(found.loop, np.reshape(loop, (-1, 2)))
