"""Fields of the body, and pictures of them, on any number of ranks."""

import os
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import h5py
import matplotlib as mpl
import numpy as np
import pytest
from pictured import instant_of_row, small_block
from PIL import Image

from receding_fenicsx import workers
from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import RecedingError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.mpi import given
from receding_fenicsx.output.plots import style
from receding_fenicsx.output.snapshots.draw import snapshots
from receding_fenicsx.output.snapshots.page import QUANTITIES, colours_of
from receding_fenicsx.output.snapshots.render import Pixels, render
from receding_fenicsx.pictures import picture_body, shown_instant
from receding_fenicsx.scene.model import HistoryOptions
from receding_fenicsx.studies.run import condense

COMM = MPI.COMM_WORLD


def test_pictures_of_an_instant_show_the_body(shared_tmp_path: Path) -> None:
    chosen = tuple(q for q in QUANTITIES if q.name in ("syy", "max_shear"))
    scene = small_block()
    _, now = instant_of_row(scene)
    with picture_body(scene, COMM) as bulk:
        made = snapshots(bulk, [now], shared_tmp_path / "snapshots", chosen)
    if COMM.rank != 0:
        assert made is None
        return
    assert made is not None
    pictures = [path for path in made if path.suffix == ".png"]
    assert [path.name for path in pictures] == [
        f"cycle0001_leg0_s1.000_{quantity.name}.png" for quantity in chosen
    ]
    for path in pictures:
        image = Image.open(path).convert("RGB")
        assert image.size[0] == round(style.PAGE * style.DPI)
        pixels = np.asarray(image)
        body = pixels[pixels.shape[0] // 4 : pixels.shape[0] // 2]
        assert body.std() > 10.0, f"{path} is blank where the body should be"
    assert not any(name.startswith("vtkmodules") for name in sys.modules)


@pytest.mark.one_rank
@pytest.mark.parametrize("corners", [(), (0.5, 1.0), (0.7, 0.2, 0.4, 1.0)])
def test_times_of_instants_count_cycles_and_in_them_legs(
    corners: tuple[float, ...], tmp_path: Path
) -> None:
    rows, loop = ((0.5,), (0.8,), (1.0,)), tuple((factor,) for factor in corners)
    history = HistoryOptions("table", columns=("p0",), rows=rows, cycle_rows=loop)
    scene = replace(small_block(), history=replace(history, cycles=2 if corners else 0))
    system = given(condense(scene, COMM))
    table = (record := evolve(system, scene)).turning_points
    places = [*zip(table.cycle.tolist(), map(str, table.leg), table.s.tolist(), strict=True)]
    with picture_body(scene, COMM) as bulk:
        instants = [shown_instant(scene, system, record, place) for place in places]
        files = given(snapshots(bulk, instants, tmp_path / "snapshots", ()))
    times = [h5py.File(path.with_suffix(".h5")).attrs["time"] for path in files]
    known = [np.arange(1, n + 1) / n + k for k, n in enumerate((3, *[len(corners)] * 2)) if n]
    assert times == pytest.approx(np.concatenate(known))


SQUARE = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])


@pytest.mark.one_rank
@pytest.mark.parametrize("cells", [[[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3]]])
def test_rendered_field_has_the_colours_of_its_values(cells: list[list[int]]) -> None:
    """A square whose field is x: black at the left, white at the right."""
    grey = np.repeat(np.linspace(0.0, 1.0, 256)[:, None], 3, axis=1)

    def drawn(window: tuple[float, float, float, float], size: int) -> Pixels:
        x = SQUARE[:, 0]
        return render(SQUARE, np.array(cells), x, (0.0, 1.0), grey, window, (size, size))

    near, far = (-0.5, 1.5, -0.5, 1.5), (-2.0, 3.0, -2.0, 3.0)
    pixels = drawn(near, 400)
    assert pixels.shape == (400, 400, 3)
    edge = 3  # pixels that antialiasing may touch
    assert np.all(pixels[: 100 - edge] == 255), "the picture is not white beyond the body"
    row = pixels[200, 100:300, 0].astype(float)
    expected = 255.0 * (np.arange(200) + 0.5) / 200
    assert np.abs(row - expected)[edge:-edge].max() < 4.0
    # one window draws all pictures, and keeps nothing of those before
    wider = drawn(far, 500)
    assert wider.shape == (500, 500, 3)
    assert np.all(wider[: 200 - edge] == 255)
    assert np.array_equal(drawn(near, 400), pixels)


@pytest.mark.one_rank
def test_field_is_interpolated_before_it_is_coloured() -> None:
    """Between the values 0 and 1 of one triangle all fringes show."""
    points, values = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]), np.array([0.0, 2.0, 0.0])
    stripes = np.repeat([[1.0] * 3, [0.0] * 3] * 4, 10, axis=0)
    image = render(
        points, np.array([[0, 1, 2]]), values, (0.0, 1.0), stripes, (0.0, 1.0, 0.0, 1.0), (80, 80)
    )
    inner = np.delete(np.arange(80), [*range(9, 80, 10), *range(10, 80, 10)])
    assert np.array_equal(image[60, inner, 0], np.repeat([255, 0] * 4, 10)[inner])


@pytest.mark.one_rank
def test_renderer_that_crashes_is_said_and_replaced() -> None:

    def drawn(values: Array) -> Pixels:
        window, colours = (0.0, 1.0, 0.0, 1.0), np.zeros((2, 3))
        triangle = SQUARE[:3], np.array([[0, 1, 2]])
        return render(*triangle, values, (0.0, 1.0), colours, window, (40, 40))

    process = workers.result("pictures", workers.submit("pictures", os.getpid))
    os.kill(process, signal.SIGSTOP)  # so that it is killed while it has a job
    threading.Timer(0.5, os.kill, (process, signal.SIGKILL)).start()
    with pytest.raises(RecedingError, match=r"ended by SIGKILL.*libosmesa6") as told:
        drawn(np.zeros(3))
    assert "\n" not in str(told.value)
    with pytest.raises(RecedingError, match="off-screen rendering failed"):
        drawn(np.zeros(2))
    assert drawn(np.zeros(3)).shape == (40, 40, 3)


def test_colours_of_a_signed_stress_are_pale_at_zero_only() -> None:
    values = 40.0 * np.linspace(-1.0, 0.1, 2001)
    quantity = next(q for q in QUANTITIES if q.name == "syy")
    colours = colours_of(values, quantity, "p_0")
    levels = colours.levels / 40.0
    low, high = np.divide(colours.limits, 40.0)
    assert (low, high) == pytest.approx((-1.0, 0.1), abs=0.01)
    brightest = np.argmax(colours.table[:, :3].sum(axis=1))
    assert abs(low + brightest / 255.0 * (high - low)) < 0.01
    assert colours.extend == "both"
    assert len(levels) > 5 and np.ptp(np.diff(levels)) < 1e-12
    assert levels[1] > low >= levels[0] and levels[-2] < high <= levels[-1]
    # a peak of few values is beyond the end of the bar that has its sign
    for peak, end in ((9.0, "max"), (-9.0, "min")):
        flat = np.append(np.full(2000, 1.0 if peak > 0.0 else -1.0), peak)
        assert colours_of(flat, quantity, "").extend == end
    # as strong as the larger of both signs: a tenth of it is pale
    at = np.linspace(low, high, len(colours.table))
    for value, part in ((-1.0, 0.0), (-0.5, 0.25), (0.0, 0.5), (0.1, 0.55)):
        shown = [np.interp(value, at, column) for column in colours.table.T]
        assert shown == pytest.approx(mpl.colormaps["RdBu_r"](part), abs=0.03), value


def test_half_of_the_area_lies_below_the_middle_colour_however_fine_the_mesh_is() -> None:
    """A field x on [0, 1] with nine tenths of the vertices in the last tenth of the area."""
    x = np.concatenate([np.linspace(0.0, 0.9, 100), np.linspace(0.9, 1.0, 901)[1:]])
    areas = np.gradient(x)
    von_mises = next(q for q in QUANTITIES if q.name == "von_mises")
    for sign, each, end in ((1, areas, 0.995), (-1, areas, 0.995), (1, None, 0.9995)):
        colours = colours_of(sign * x, von_mises, "", each)
        # zero is one end of what has one sign
        assert colours.limits[::sign] == (0.0, pytest.approx(sign * end, abs=1e-3))
        if sign > 0:
            assert np.array_equal(colours.table[[0, -1]], mpl.colormaps["viridis"]([0.0, 1.0]))
