"""Several contact edges in one system, oblique ones among them."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, played
from msh import turned, write_msh

import receding_fenicsx as rf
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh, curve_of

comm = MPI.COMM_WORLD


WALLS = (rf.Contact(span=(-1.5, 1.5)), rf.Contact("left"), rf.Contact("right", friction=0.1))
"""The block between two walls, on a plane that ends before them."""
DIRECTIONS = {"bottom": (0.0, 1.0), "left": (1.0, 0.0), "right": (-1.0, 0.0)}
"""n of each edge."""


def box(load: rf.Load | None = None) -> rf.Scene:
    history = rf.HistoryOptions(cycles=3, minimum=0.2)
    return block("triangle", 1, 24, load=load, contacts=WALLS, history=history)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_forces_of_three_edges_balance_the_load(friction: float) -> None:
    contacts = tuple(replace(contact, friction=friction) for contact in WALLS)
    side = rf.Load("side", "top", traction=(0.2, -0.5))
    table = rf.HistoryOptions("table", columns=("side",), rows=((1.0,), (0.3,)))
    record = played(replace(box(load=side), contacts=contacts, history=table))
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


@pytest.mark.one_rank
def test_summaries_and_figures_know_the_edges(tmp_path: Path) -> None:
    record = played(box())
    summary = rf.summarise(record)
    rows = summary["turning_points"]
    assert [row["edge"] for row in rows[:3]] == ["bottom", "left", "right"]
    assert len(rows) == 3 * len(record.turning_points.s)
    assert rows[1]["zones"][0][1] == pytest.approx(-0.5) and rows[1]["zones"][-1][2] == 0.5
    assert "left" in rf.run_table(summary)
    with pytest.raises(rf.InputError, match="several contact edges; ask one of them"):
        record.at(cycle=1)
    made = rf.figures.plot_all(record, tmp_path / "figures", formats=("pdf",))
    folders = {file.parent.name for file in made}
    assert folders == {"figures", "bottom", "left", "right"} and len(made) == len(set(made))


def test_two_feet_on_one_edge_are_told_apart_and_mirror_each_other() -> None:
    feet = (rf.Contact(span=(-2.0, -1.0)), rf.Contact(span=(1.0, 2.0)))
    record = played(block("triangle", 2, 16, contacts=feet, history=rf.HistoryOptions(cycles=1)))
    left, right = record.by_edge().values()
    assert record.edge_names == ("bottom 1", "bottom 2") and not record.half
    scale = np.abs(record.turning_points.P).max()
    for name, sign in (("P", 1.0), ("Q", -1.0)):
        a, b = getattr(left.turning_points, name), getattr(right.turning_points, name)
        assert np.abs(a - sign * b[:, ::-1]).max() < 1e-10 * scale
    assert left.turning_points.P.sum(axis=1) == pytest.approx([1.0, 1.0 / 3.0, 1.0])


def groove(path: Path, degrees: float, friction: float) -> rf.Scene:
    """A square that stands on its corner in a right-angled groove, the corner itself being free."""

    def write() -> None:
        m = 8
        i, j = np.meshgrid(np.arange(m + 1), np.arange(m + 1))
        points = np.stack([i.ravel() / m, j.ravel() / m], 1)
        node = np.arange((m + 1) ** 2).reshape(m + 1, m + 1)
        cells = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], -1)
        edges = {
            "right": np.stack([node[0, 1:-1], node[0, 2:]], 1),
            "left": np.stack([node[1:-1, 0], node[2:, 0]], 1),
            "roof": np.stack([node[-1, :-1], node[-1, 1:]], 1),
            "wall": np.stack([node[:-1, -1], node[1:, -1]], 1),
        }
        places = turned(points, 45.0 + degrees)
        write_msh(path, places, [cells.reshape(-1, 4)], edges)

    rf.on_root(comm, write)
    comm.barrier()
    # a force straight down into the groove, spread over the two upper sides
    down = np.radians(degrees - 90.0)
    traction = (0.5 * np.cos(down), 0.5 * np.sin(down))
    return rf.Scene(
        body=rf.Body(mesh=str(path)),
        contacts=(rf.Contact("left", friction=friction), rf.Contact("right", friction=friction)),
        loads=(rf.Load("a", "roof", traction=traction), rf.Load("b", "wall", traction=traction)),
        history=rf.HistoryOptions(
            "table", columns=("a", "b"), rows=((1.0, 1.0), (1.8, 0.2), (0.8, 0.9))
        ),
    )


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_groove_carries_the_load_and_may_be_turned(friction: float, shared_tmp_path: Path) -> None:
    records = [
        played(groove(shared_tmp_path / f"{angle}.msh", angle, friction)) for angle in (0.0, 30.0)
    ]
    upright, oblique = records
    left, right = upright.by_edge().values()
    P = np.array([edge.turning_points.P[0].sum() for edge in (left, right)])
    Q = np.array([edge.turning_points.Q[0].sum() for edge in (left, right)])
    # of the force 1 each flank of 45 degrees carries half: P and |Q| have the resultant 1/2
    assert P[0] == pytest.approx(P[1], rel=1e-10)
    assert (P[0] + abs(Q[0])) / np.sqrt(2.0) == pytest.approx(0.5, rel=1e-10)
    if friction == 0.0:
        assert P[0] == pytest.approx(np.sqrt(0.5), rel=1e-10)
    a, b = upright.turning_points, oblique.turning_points
    for name in ("P", "Q", "v", "w"):
        expected = getattr(a, name)
        scale = np.abs(a.P if name in "PQ" else a.v).max()
        assert np.abs(getattr(b, name) - expected).max() < 1e-9 * scale
    assert np.array_equal(a.state, b.state) or friction == 0.0
    assert friction == 0.0 or rf.State.FORWARD_SLIP in a.state


def test_normals_of_an_arc_of_unequal_facets_are_those_of_its_circle() -> None:
    angle = np.pi + np.array([0.2, 0.35, 0.4, 0.6, 0.7, 0.95])
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    n = np.arange(len(rim) - 1)
    fan = np.stack([n, n + 1, np.full(len(n), len(rim))], axis=1)
    mesh = RawMesh(np.vstack([rim, np.zeros(2)]), fan, {"rim": fan[:, :2]})
    arc = curve_of(mesh, "rim", "here")
    # inward normals of the unit circle about the origin; at the ends too
    np.testing.assert_allclose(arc.inward(rim), -rim, atol=2e-3)
