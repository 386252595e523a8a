"""Meshes graded by a coarser run: where they are fine, and what they gain."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from demo_runs import DEMOS, sheared_block

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

BARE = rf.OutputOptions(samples_per_leg=1, cycles=())


def played(scene: rf.Scene) -> rf.Record:
    """Play a scene on this rank alone."""
    system = rf.given(rf.condense(scene, MPI.COMM_SELF))
    return rf.evolve(system, replace(scene, output=BARE))


def sheared(f: float, elements: int) -> rf.Scene:
    return sheared_block(f, f"mesh.contact_elements={elements}")


def graded_twice(scene: rf.Scene) -> rf.Record:
    """Play a scene on a mesh graded by the zone ends of a graded run."""
    record = played(rf.refined_at_zone_ends(scene, played(scene)))
    return played(rf.refined_at_zone_ends(scene, record, 8.0))


@pytest.mark.parametrize("f", [0.5, 0.8])
def test_graded_corners_need_less_than_half_the_nodes(f: float) -> None:
    scene = sheared(f, 24)
    limit = graded_twice(sheared(f, 100))
    equal = played(sheared(f, 160))
    better = played(rf.refined_at_zone_ends(scene, played(scene)))
    exact, of_equal, of_better = (r.cycles.dissipation[0] for r in (limit, equal, better))
    assert len(better.x) <= 0.5 * len(equal.x)
    assert abs(of_better - exact) < abs(of_equal - exact)


def test_places_lie_at_zone_ends_and_at_corners_that_touch() -> None:
    scene = rf.read_scene(DEMOS / "block.toml", ["history.cycles=1", "mesh.contact_elements=80"])
    record = played(scene)
    graded = rf.refined_at_zone_ends(scene, record, ratio=4.0)
    size = 4.0 / 80 / 4.0
    # the block's ends lift off
    assert [place.size for place in graded.mesh.places] == pytest.approx(
        [size] * len(graded.mesh.places)
    )
    first = rf.summarise(record)["turning_points"][0]
    for end in first["zone_ends"]:
        inside = (
            place.span[0] - 2 * size <= abs(end["value"]) <= place.span[1] + 2 * size
            for place in graded.mesh.places
        )
        assert any(inside)
    corner = sheared(0.8, 16)
    places = rf.refined_at_zone_ends(corner, played(corner), corner_ratio=50.0).mesh.places
    ends = [place.at for place in places if place.size == pytest.approx(2.0 / 16 / 50.0)]
    assert np.allclose(np.sort(np.array(ends, dtype=float)), [-1.0, 1.0])
    with pytest.raises(rf.InputError, match="must be positive"):
        rf.refined_at_zone_ends(scene, record, ratio=0.0)
    # what was refined before stays
    kept = replace(scene, mesh=replace(scene.mesh, refine=(rf.Refinement(0.01, 0.5),)))
    assert rf.refined_at_zone_ends(kept, record).mesh.places[0] == rf.Refinement(0.01, 0.5)


def test_every_edge_of_a_scene_gets_its_own_places() -> None:
    overrides = ["mesh.contact_elements=12", "mesh.growth=1.6", "history.cycles=1"]
    scene = rf.read_scene(DEMOS / "dovetail.toml", overrides)
    graded = rf.refined_at_zone_ends(scene, played(scene), corner_ratio=20.0)
    assert {place.edge for place in graded.mesh.places} == {"blade.right", "blade.left"}
    better = played(graded)
    assert len(better.x) > 2 * 25 and better.residual_max < 1e-10
