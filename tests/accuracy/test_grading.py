"""Meshes graded towards sharp corners and by a coarser run: where they are fine, what they gain."""

import json
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from demo_runs import DEMOS, sheared_block
from images import played

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
    coarse = "mesh.contact_elements=24", "accuracy.tolerance=1e-2"
    scene = sheared(*coarse, "accuracy.numbers=['largest_pressure']")
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


@pytest.mark.one_rank
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


# -- meshes graded by a coarser run ---------------------------------------------------------------


@pytest.mark.one_rank
def test_graded_corners_need_less_than_half_the_nodes() -> None:
    scene, fine, finest = (sheared_block(0.8, f"mesh.contact_elements={n}") for n in (16, 100, 60))
    graded, equal = played(rf.refined_at_zone_ends(scene, played(scene))), played(fine)
    # graded by the zone ends of a graded run
    once = played(rf.refined_at_zone_ends(finest, played(finest)))
    limit = played(rf.refined_at_zone_ends(finest, once, 8.0))
    exact, of_equal, of_graded = (r.cycles.dissipation[0] for r in (limit, equal, graded))
    assert len(graded.x) <= 0.5 * len(equal.x)
    assert abs(of_graded - exact) < abs(of_equal - exact)


@pytest.mark.one_rank
def test_places_lie_at_zone_ends_and_at_corners_that_touch() -> None:
    scene = rf.read_scene(DEMOS / "block.toml", ["history.cycles=1", "mesh.contact_elements=80"])
    record = played(scene)
    graded = rf.refined_at_zone_ends(scene, record, ratio=4.0)
    size = 4.0 / 80 / 4.0
    # the block's ends lift off
    assert [place.size for place in graded.mesh.places] == pytest.approx(
        [size] * len(graded.mesh.places)
    )
    ranges = [place.at for place in graded.mesh.places if isinstance(place.at, tuple)]
    assert all(low < high for low, high in ranges) and len(ranges) < len(graded.mesh.places)
    first = rf.summarise(record)["turning_points"][0]
    for end in first["zone_ends"]:
        inside = (
            place.span[0] - 2 * size <= abs(end["value"]) <= place.span[1] + 2 * size
            for place in graded.mesh.places
        )
        assert any(inside)
    corner = sheared_block(0.8, "mesh.contact_elements=16")
    places = rf.refined_at_zone_ends(corner, played(corner), corner_ratio=50.0).mesh.places
    ends = [place.at for place in places if place.size == pytest.approx(2.0 / 16 / 50.0)]
    assert np.allclose(np.sort(np.array(ends, dtype=float)), [-1.0, 1.0])
    # what was refined before stays
    kept = replace(scene, mesh=replace(scene.mesh, refine=(rf.Refinement(0.01, 0.5),)))
    assert rf.refined_at_zone_ends(kept, record).mesh.places[0] == rf.Refinement(0.01, 0.5)


@pytest.mark.one_rank
def test_every_edge_of_a_scene_gets_its_own_places() -> None:
    overrides = ["mesh.contact_elements=12", "mesh.growth=1.6", "history.cycles=1"]
    scene = rf.read_scene(DEMOS / "dovetail.toml", overrides)
    graded = rf.refined_at_zone_ends(scene, played(scene), corner_ratio=20.0)
    assert {place.edge for place in graded.mesh.places} == {"blade.right", "blade.left"}
    better = played(graded)
    assert len(better.x) > 2 * 25 and better.residual_max < 1e-10
