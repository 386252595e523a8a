"""Contact nodes that supports hold: no friction where held normally, no slip where held along."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import block

import receding_fenicsx as rf


@pytest.mark.parametrize(
    ("support", "held"),
    [
        (rf.Support("x", point=(2.0, 0.0)), [32]),
        (rf.Support("y", point=(2.0, 0.0)), [65]),
        (rf.Support("y", point=(0.25, 0.0)), [51]),
        (rf.Support("xy", point=(0.5, 0.0)), [20, 53]),
        (rf.Support("xy", edge="right"), [32, 65]),
    ],
)
def test_a_support_holds_its_contact_nodes(support: rf.Support, held: list[int]) -> None:
    contacts, supports = (rf.Contact(friction=0.35),), (support,)
    scene = block("quadrilateral", 2, growth=1.0, contacts=contacts, supports=supports)
    system = rf.condense(scene)
    if system is None:
        return
    assert np.flatnonzero(system.held).tolist() == held
    history = rf.History(("p0",), np.array([[0.0], [1.0], [0.2]]), np.zeros((0, 1)))
    ends = rf.evolve(system, history).turning_points
    for dof in held:
        node = dof % 33
        assert not np.any((ends.v if dof < 33 else ends.w)[:, node])
        if dof >= 33 and node not in held:
            assert np.abs(ends.Q[:, node]).max() < 1e-13 and abs(ends.v[-1, node]) > 1e-4
