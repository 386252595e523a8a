"""Searches on meshes graded towards sharp corners, and numbers that are singular there."""

import json
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from demo_runs import DEMOS, sheared_block

import receding_fenicsx as rf
from receding_fenicsx.bulk.stack import contact_of
from receding_fenicsx.studies import run as study

COMM = MPI.COMM_WORLD
PLAIN = study.RunOptions(pictures=False)


def sheared(*changes: str) -> rf.Scene:
    """The sheared block of friction .8, whose corners stick, for plain cycles."""
    scene = sheared_block(0.8, *changes)
    return replace(scene, history=replace(scene.history, until=None))


def test_the_largest_pressure_at_a_sharp_corner_is_called_singular(shared_tmp_path: Path) -> None:
    scene = sheared("accuracy.numbers=['largest_pressure']", "accuracy.tolerance=1e-2")
    with pytest.raises(rf.ToleranceNotMet, match="largest_pressure does not converge: singular"):
        study.run(scene, shared_tmp_path / "run", PLAIN)
    if COMM.rank == 0:
        summary = json.loads((shared_tmp_path / "run" / "summary.json").read_text())
        assert len(summary["accuracy"]["way"]) == 2
        assert summary["errors"]["largest_pressure"]["value"] is None
        assert summary["errors"]["largest_pressure"]["converges"] is False


@pytest.mark.one_rank
@pytest.mark.parametrize("file", sorted(DEMOS.glob("*.toml")), ids=lambda file: file.stem)
def test_scenes_on_finer_and_coarser_meshes_are_valid(file: Path) -> None:
    scene = rf.read_scene(file)
    for factor in (0.5, 2):
        rf.validate(rf.scaled_mesh(scene, int(factor * scene.mesh.contact_elements)))


def test_sizes_of_a_graded_family_are_in_proportion() -> None:
    scene = sheared()
    (size,) = contact_of(scene)[1]
    assert size == pytest.approx(2.0 / 64)
    graded = rf.graded_at_ends(scene, [size])
    (place,) = graded.mesh.places
    assert place.at == "ends" and place.size == pytest.approx(size / 100.0)
    coarse = rf.scaled_mesh(graded, 24).mesh.places[0]
    assert coarse.growth == pytest.approx(2.0) and coarse.size == pytest.approx(2.0 / 2400)
    assert rf.graded_at_ends(graded, [size]) == graded
    inclined = rf.read_scene(DEMOS / "dovetail.toml")
    sizes = contact_of(inclined)[1]
    assert len(sizes) == len(inclined.contacts) and np.all(np.array(sizes) > 0.0)
