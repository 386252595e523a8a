"""Fields of the body, and pictures of them, on any number of ranks."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx import history_from_scene, read_scene, study
from receding_fenicsx.bulk import elasticity, meshing
from receding_fenicsx.errors import on_root
from receding_fenicsx.evolution import evolve
from receding_fenicsx.output.collect import Instant
from receding_fenicsx.output.fields import Fields, fields_at
from receding_fenicsx.output.snapshots import QUANTITIES, snapshot
from receding_fenicsx.replay import turning_point
from receding_fenicsx.scene import Scene

BLOCK = Path(__file__).parent.parent / "demos" / "block.toml"
COMM = MPI.COMM_WORLD


def small_block(symmetry: str) -> Scene:
    """Return the block on a coarse mesh, loaded once."""
    text = ["mesh.contact_elements=16", "history.cycles=1", f'solver.symmetry="{symmetry}"']
    return read_scene(BLOCK, text)


def instant(scene: Scene) -> Instant | None:
    """Return the block at one third of the load, on rank 0."""
    system = study.condense(scene, COMM)

    def make() -> Instant:
        assert system is not None
        record = evolve(system, history_from_scene(scene))
        state = turning_point(record, system, 1)
        return Instant(1, 0, 1.0, record.turning_points.load[1], state.v, state)

    return on_root(COMM, make)


def fields(symmetry: str) -> Fields | None:
    """Return the fields of the whole body from a half or a whole model."""
    scene = small_block(symmetry)
    now = COMM.bcast(instant(scene))
    half = symmetry == "auto"
    bulk = elasticity.build(scene, meshing.make_mesh(COMM, scene, half), half)
    try:
        return fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
    finally:
        bulk.destroy()


def by_place(found: Fields) -> dict[str, np.ndarray]:
    """Return all fields in the order of the points, those on the axis once."""
    points = np.round(found.points, 9) + 0.0
    _, first = np.unique(points, axis=0, return_index=True)
    values = {name: value[first] for name, value in found.stress.items()}
    return {"points": points[first], "u": found.displacement[first], **values}


def test_fields_of_the_half_body_mirrored_are_those_of_the_whole_body() -> None:
    half, whole = fields("auto"), fields("none")
    if COMM.rank == 0:
        assert half is not None
        assert whole is not None
        a, b = by_place(half), by_place(whole)
        off_axis = a["points"][:, 0] != 0.0
        assert np.array_equal(a["points"], b["points"])
        scale = np.abs(b["u"]).max()
        assert np.abs(a["u"] - b["u"]).max() < 1e-9 * scale
        for name in ("sxx", "syy", "sxy", "von_mises"):
            # beside the axis a half model averages over the cells of one side only
            difference = np.abs(a[name] - b[name])[off_axis]
            assert difference.max() < 1e-9 * np.abs(b[name]).max()


def test_pictures_of_an_instant_show_something(shared_tmp_path: Path) -> None:
    scene = small_block("auto")
    scene = replace(scene, mesh=replace(scene.mesh, growth=1.3))
    now = instant(scene)
    bulk = study.picture_body(scene, COMM)
    try:
        made = snapshot(bulk, now, shared_tmp_path / "snapshots")
    finally:
        bulk.destroy()
    if COMM.rank == 0:
        from PIL import Image

        assert made is not None
        pictures = [path for path in made if path.suffix == ".png"]
        assert len(pictures) == len(QUANTITIES)
        for path in pictures:
            pixels = np.asarray(Image.open(path).convert("L"), dtype=float)
            middle = pixels[pixels.shape[0] // 4 : pixels.shape[0] // 2]
            assert pixels.max() == 255.0, path
            assert middle.std() > 10.0, f"{path} is blank where the body should be"
        text = (shared_tmp_path / "fields" / "cycle0001_leg0_s1.000.xdmf").read_text()
        for name in ("displacement", "von_mises", "max_shear"):
            assert name in text


def test_missing_renderer_is_said_before_vtk_is_loaded(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ctypes.util

    from receding_fenicsx.errors import RecedingError

    scene = small_block("auto")
    now = instant(scene)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None)
    bulk = study.picture_body(scene, COMM)
    try:
        with pytest.raises(RecedingError, match="no off-screen renderer"):
            snapshot(bulk, now, shared_tmp_path / "snapshots")
    finally:
        bulk.destroy()
