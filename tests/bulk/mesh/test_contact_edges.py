"""Normals of contact edges, and facets that touch."""

import numpy as np
import pytest

from receding_fenicsx.bulk.mesh.contact_edges import _Side
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, curve_of


def test_normals_of_an_arc_of_unequal_facets_are_those_of_its_circle() -> None:
    angle = np.pi + np.array([0.2, 0.35, 0.4, 0.6, 0.7, 0.95])
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n = np.arange(len(rim) - 1)
    fan = np.stack([n, n + 1, np.full(len(n), len(rim))], axis=1)
    mesh = RawMesh(np.vstack([rim, np.zeros(2)]), fan, {"rim": fan[:, :2]})
    arc = curve_of(mesh, "rim", "here")
    # inward normals of the unit circle about the origin; at the ends too
    np.testing.assert_allclose(arc.inward(rim), -rim, atol=2e-3)


@pytest.mark.parametrize(("far", "sign"), [(0.0, -1.0), (2.0, 1.0)])
def test_positions_around_a_disk_or_a_bore_run_from_its_lowest_vertex(
    far: float, sign: float
) -> None:
    angle = np.cumsum(np.random.default_rng(1).uniform(0.1, 0.4, 25))
    angle *= 2.0 * np.pi / angle[-1]
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n, low = np.arange(25), int(np.argmin(rim[:, 1]))
    fan = np.stack([n, (n + 1) % 25, 25 + n], axis=1)
    arc = curve_of(RawMesh(np.vstack([rim, far * rim]), fan, {"rim": fan[:, :2]}), "rim", "here")
    np.testing.assert_allclose(arc.inward(rim), sign * rim, atol=2e-3)
    way = np.cumsum(np.roll(np.linalg.norm(rim - np.roll(rim, 1, 0), axis=1), -low - 1))
    way[way > 0.5 * way[-1]] -= arc.length
    np.testing.assert_allclose(np.roll(arc.along(rim), -low - 1), -sign * way, atol=1e-12)


@pytest.mark.parametrize("depth", [0.0, 0.2])
def test_a_facet_across_a_notch_does_not_touch_the_other_side(depth: float) -> None:
    side = np.array([[0.0, 0.0], [1.0, 0.0], [1.5, -depth], [2.0, 0.0], [3.0, 0.0]])
    meshes = []
    for points in (side, side[[0, 1, 3, 4]]):
        n = np.arange(len(points) - 1)
        fan = np.stack([n, n + 1, np.full(len(n), len(points))], axis=1)
        meshes.append(RawMesh(np.vstack([points, [1.5, -1.0]]), fan, {"edge": fan[:, :2]}))
    a, b = (_Side(each, "edge", curve_of(meshes[1], "edge", "here")) for each in meshes)
    assert b.on(a, 1e-9).tolist() == [True, not depth, True]
    assert a.on(b, 1e-9).tolist() == [True, not depth, not depth, True]
