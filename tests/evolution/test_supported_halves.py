"""Bodies on supports: halves against the whole, nodes that are held, a top that is lifted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.studies import run as study

F = 0.35


def body(name: str, half: bool, below: float) -> rf.Body:
    width, x = (2.0, 1.0) if half else (4.0, 0.0)
    return rf.Body(width=width, height=1.0, position=(x, below), name=name)


def scene(half: bool, bodies: int) -> rf.Scene:
    """The paper's block on a plane or on another block, in columns of quadrilaterals."""
    names = ("a", "b")[:bodies] if bodies > 1 else ("",)
    parts = [body(name, half, -float(k)) for k, name in enumerate(names)]
    edge = [f"{name}." if name else "" for name in names]
    against = edge[1] + "top" if bodies > 1 else None
    supports = [rf.Support("x", edge=e + "left") for e in edge if half]
    supports += [rf.Support("y", edge="b.bottom")] * (bodies - 1)
    return rf.Scene(
        body=parts[0],
        others=tuple(parts[1:]),
        material=rf.Material(young=1.0, poisson=0.3),
        mesh=rf.MeshOptions(contact_elements=16 if half else 32, cell="quadrilateral"),
        contacts=(rf.Contact(edge=edge[0] + "bottom", against=against, friction=F),),
        loads=(rf.Load("p0", edge[0] + "top", (-1.0, 0.0 if half else 1.0), pressure=1.0),),
        supports=tuple(supports),
        history=rf.HistoryOptions(kind="cyclic", cycles=1),
    )


@pytest.mark.parametrize("bodies", [1, 2])
def test_a_half_on_a_support_has_the_tractions_of_the_whole(bodies: int) -> None:
    half, whole = (study.run(scene(is_half, bodies)) for is_half in (True, False))
    if half is None or whole is None:
        return
    a, b = half.turning_points, whole.turning_points
    right = whole.x >= 0.0
    assert np.allclose(half.points, whole.points[right])
    for name in ("p", "q", "P", "Q", "v", "w"):
        ours, known = getattr(a, name), getattr(b, name)[:, right]
        if name in ("P", "Q"):  # the whole node in the middle has twice the force
            known[:, 0] *= 0.5
        assert np.abs(ours - known).max() < 1e-9 * np.abs(known).max(), name
    assert np.array_equal(a.state, b.state[:, right])
    assert np.all(a.Q[:, 0] == 0.0) and np.all(np.abs(a.q) <= F * a.p * (1.0 + 1e-9) + 1e-12)
    assert half.cycles.dissipation == pytest.approx(0.5 * whole.cycles.dissipation, rel=1e-9)
    for ours, known in zip(*(summarise(r)["turning_points"] for r in (half, whole)), strict=True):
        assert ours["p_max"] == pytest.approx(known["p_max"], rel=1e-9)
        # the middle of the whole is no corner, and its other end is open
        assert "corners" not in ours and "corners" not in known


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
    """A node held normally carries no friction, one held tangentially never slips."""
    system = study.condense(
        replace(
            scene(False, 1),
            mesh=rf.MeshOptions(16, "quadrilateral", 2, 1.0),
            supports=(support,),
        )
    )
    if system is None:
        return
    assert np.flatnonzero(system.held).tolist() == held
    history = rf.History(("p0",), np.array([[0.0], [1.0], [0.2]]), np.zeros((0, 1)))
    ends = rf.evolve(system, history).turning_points
    for dof in held:
        node = dof % 33
        assert not np.any((ends.v if dof < 33 else ends.w)[:, node])
        if dof >= 33 and node not in held:
            assert np.abs(ends.Q[:, node]).max() < 1e-13 and abs(ends.v[-1, node]) > 1e-3
