"""Several contact edges in one system, oblique ones among them."""

from dataclasses import replace

import numpy as np
import pytest
from bodies import block, played

import receding_fenicsx as rf
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, curve_of

WALLS = (rf.Contact(span=(-1.5, 1.5)), rf.Contact("left"), rf.Contact("right", friction=0.1))
"""The block between two walls, on a plane that ends before them."""
DIRECTIONS = {"bottom": (0.0, 1.0), "left": (1.0, 0.0), "right": (-1.0, 0.0)}
"""n of each edge."""


@pytest.mark.one_rank
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_forces_of_three_edges_balance_the_load(friction: float) -> None:
    contacts = tuple(replace(contact, friction=friction) for contact in WALLS)
    side = rf.Load("side", "top", traction=(0.2, -0.5))
    table = rf.HistoryOptions("table", columns=("side",), rows=((1.0,), (0.3,)))
    record = played(block("triangle", 1, 24, load=side, contacts=contacts, history=table))
    total = np.zeros((2, 2))
    for name, part in record.by_edge().items():
        n = np.array(DIRECTIONS[name])
        t = np.array([n[1], -n[0]])
        states = part.turning_points
        assert states.P.shape[1] == len(part.x) == len(part.weight)
        assert np.all(np.diff(part.x) > 0.0)
        total += states.Q.sum(axis=1)[:, None] * t + states.P.sum(axis=1)[:, None] * n
    assert total == pytest.approx(np.outer([1.0, 0.3], [-0.8, 2.0]), abs=1e-10)
    assert record.energy_error_max < 1e-10 and record.residual_max < 1e-11


def test_normals_of_an_arc_of_unequal_facets_are_those_of_its_circle() -> None:
    angle = np.pi + np.array([0.2, 0.35, 0.4, 0.6, 0.7, 0.95])
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n = np.arange(len(rim) - 1)
    fan = np.stack([n, n + 1, np.full(len(n), len(rim))], axis=1)
    mesh = RawMesh(np.vstack([rim, np.zeros(2)]), fan, {"rim": fan[:, :2]})
    arc = curve_of(mesh, "rim", "here")
    # inward normals of the unit circle about the origin; at the ends too
    np.testing.assert_allclose(arc.inward(rim), -rim, atol=2e-3)
