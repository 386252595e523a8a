"""Several contact edges in one system, oblique ones among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, block, built, condense
from msh import turned, write_msh

import receding_fenicsx as rf
from receding_fenicsx.bulk.mesh.curves import curve_of
from receding_fenicsx.bulk.mesh.raw_mesh import RawMesh
from receding_fenicsx.evolution.problem import with_profiles
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.store import hdf5
from receding_fenicsx.studies.run import condense as condense_scene

comm = MPI.COMM_WORLD


def system_of(scene: rf.Scene, half: bool = False) -> rf.ContactSystem | None:
    bulk = built(scene, half)
    system = condense(bulk)
    bulk.destroy()
    return system


def record_of(scene: rf.Scene) -> rf.Record | None:
    system = condense_scene(scene, comm)
    if system is None:
        return rf.on_root(comm, lambda: None)
    return rf.on_root(comm, lambda: rf.evolve(system, scene))


WALLS = (rf.Contact(span=(-1.5, 1.5)), rf.Contact("left"), rf.Contact("right", friction=0.1))
"""The block between two walls, on a plane that ends before them."""
DIRECTIONS = {"bottom": (0.0, 1.0), "left": (1.0, 0.0), "right": (-1.0, 0.0)}
"""n of each edge."""


def box(load: rf.Load | None = None, solver: rf.SolverOptions | None = None) -> rf.Scene:
    history = rf.HistoryOptions(cycles=3, minimum=0.2)
    scene = block("triangle", 1, 24, load=load, contacts=WALLS, history=history)
    return replace(scene, solver=solver or rf.SolverOptions())


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_letting_go_of_two_edges_leaves_the_system_of_the_third(cell: str, degree: int) -> None:
    three = system_of(block(cell, degree, contacts=WALLS))
    one = system_of(block(cell, degree, contacts=WALLS[:1]))
    if three is None or one is None:
        return
    assert three.edge_names == ("bottom", "left", "right")
    assert np.array_equal(np.unique(three.edges), [0, 1, 2])
    assert np.all(np.diff(three.edges) >= 0)
    both = np.concatenate([three.edges, three.edges])
    keep, gone = np.flatnonzero(both == 0), np.flatnonzero(both > 0)
    K, r = three.K, three.r_star
    eliminated = np.linalg.solve(
        K[np.ix_(gone, gone)], np.column_stack([K[gone][:, keep], r.T[gone]])
    )
    schur = K[np.ix_(keep, keep)] - K[np.ix_(keep, gone)] @ eliminated[:, :-1]
    assert np.abs(schur - one.K).max() < 1e-11 * np.abs(one.K).max()
    reduced = r.T[keep, 0] - K[np.ix_(keep, gone)] @ eliminated[:, -1]
    assert np.abs(reduced - one.r_star[0]).max() < 1e-11 * np.abs(one.r_star).max()


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_forces_of_three_edges_balance_the_load(friction: float) -> None:
    contacts = tuple(replace(contact, friction=friction) for contact in WALLS)
    side = rf.Load("side", "top", traction=(0.2, -0.5))
    table = rf.HistoryOptions("table", columns=("side",), rows=((1.0,), (0.3,)))
    record = record_of(replace(box(load=side), contacts=contacts, history=table))
    if record is None:
        return
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
def test_record_files_and_figures_know_the_edges(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = record_of(box())
    if record is None:
        return
    path = shared_tmp_path / "record.h5"
    hdf5.write_record(path, record)
    read = hdf5.read_record(path)
    assert read.edge_names == ("bottom", "left", "right")
    assert np.array_equal(read.edge, record.edge)
    parts = read.by_edge()
    assert list(parts) == ["bottom", "left", "right"]
    assert sum(len(part.events.node) for part in parts.values()) == len(read.events.node)
    for k, part in enumerate(parts.values()):
        nodes = np.flatnonzero(record.edge == k)
        assert np.array_equal(part.points, record.points[nodes])
        assert np.array_equal(
            nodes[part.events.node], record.events.node[np.isin(record.events.node, nodes)]
        )
    summary = rf.summarise(read)
    rows = summary["turning_points"]
    assert [row["edge"] for row in rows[:3]] == ["bottom", "left", "right"]
    assert len(rows) == 3 * len(read.turning_points.s)
    assert rows[1]["zones"][0][1] == pytest.approx(-0.5) and rows[1]["zones"][-1][2] == 0.5
    assert "left" in rf.run_table(summary)
    with pytest.raises(rf.InputError, match="several contact edges; ask one of them"):
        read.at(cycle=1)
    assert read.by_edge()["left"].at(cycle=1).x[0] == pytest.approx(-0.5)
    # what the figures show is tested elsewhere
    monkeypatch.setattr(rf.figures, "save", lambda figure, path: path.touch())
    made = rf.figures.plot_all(read, shared_tmp_path / "figures", formats=("png",))
    whole, *each = sorted({file.parent.name for file in made}, key=lambda name: name != "figures")
    assert (whole, sorted(each)) == ("figures", ["bottom", "left", "right"])
    assert len(made) == len(set(made))


def test_two_feet_on_one_edge_are_told_apart_and_mirror_each_other() -> None:
    feet = (rf.Contact(span=(-2.0, -1.0)), rf.Contact(span=(1.0, 2.0)))
    record = record_of(block("triangle", 2, 16, contacts=feet, history=rf.HistoryOptions(cycles=1)))
    if record is None:
        return
    left, right = record.by_edge().values()
    assert record.edge_names == ("bottom 1", "bottom 2") and not record.half
    scale = np.abs(record.turning_points.P).max()
    for name, sign in (("P", 1.0), ("Q", -1.0)):
        a, b = getattr(left.turning_points, name), getattr(right.turning_points, name)
        assert np.abs(a - sign * b[:, ::-1]).max() < 1e-10 * scale
    assert left.turning_points.P.sum(axis=1) == pytest.approx([1.0, 1.0 / 3.0, 1.0])


def test_half_of_two_symmetric_edges_gives_the_whole() -> None:
    contacts = (rf.Contact(), rf.Contact("top", (-0.5, 0.5), initial_gap=0.01))
    load = rf.Load("p0", "top", (1.0, 1.5), pressure=1.0)
    other = rf.Load("p1", "top", (-1.5, -1.0), pressure=1.0)
    scene = block("triangle", 1, 16, contacts=contacts, loads=(load, other))
    whole = system_of(replace(scene, loads=()))
    half = system_of(replace(scene, loads=()), half=True)
    if whole is None or half is None:
        return
    mirror = mirror_of(half)
    assert np.array_equal(whole.x, np.where(mirror.left, -1.0, 1.0) * half.x[mirror.index])
    assert np.array_equal(whole.edges, half.edges[mirror.index])
    laid = [with_profiles(scene, system) for system in (whole, half)]
    assert np.array_equal(laid[0].g0, mirror.even(laid[1].g0))
    # symmetric motions meet the same forces
    w = np.cos(half.x) + 0.3 * half.edges
    v = np.sin(half.x) * (1.0 + half.edges)
    on_half = half.K @ np.concatenate([v, w])
    on_whole = whole.K @ np.concatenate([mirror.odd(v), mirror.even(w)])
    n, m = half.n, whole.n
    assert np.abs(on_whole[m:] - mirror.total(on_half[n:])).max() < 1e-11 * np.abs(on_whole).max()


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
        record_of(groove(shared_tmp_path / f"{angle}.msh", angle, friction))
        for angle in (0.0, 30.0)
    ]
    upright, oblique = records
    if upright is None or oblique is None:
        return
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
