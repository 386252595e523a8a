"""Platens and prescribed displacements: dense algebra with multipliers, gross slip."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import ELEMENTS, block, make_mesh, system_of
from small import named_loads

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.body import Bulk
from receding_fenicsx.bulk.stack import build

comm = MPI.COMM_WORLD

PRESS = rf.Load("P", "top", platen=True, force=(0.0, -1.0))
SHEAR = rf.Load("Q", "top", platen=True, force=(1.0, 0.0))
WEIGHT = rf.Load("p", "top", (-1.0, 1.0), pressure="1 + x")
SIDE = rf.Load("s", "left", (-0.25, 0.25), traction=(1.0, 0.5))
PULL = rf.Load("d", "right", (0.0, 0.5), displacement=(1.0, "y - 2"))
SINK = rf.Load("w", "top", displacement=("free", -1.0))
MOVE = rf.Load("u", "top", platen=True, displacement=(0.5, "free"))


def dense(bulk: Bulk) -> tuple[Array, Array, list[Array]]:
    """Stiffness, places of the nodes and nodal forces of the loads, whole on every rank."""
    start, end = bulk.stiffness.getOwnershipRange()
    rows, columns = (np.arange(*ends, dtype=np.int32) for ends in ((start, end), (0, bulk.dofs)))
    own = bulk.stiffness.getValues(rows, columns)
    places = bulk.space.tabulate_dof_coordinates()[: (end - start) // 2, :2]
    loads = list(np.concatenate(comm.allgather(bulk.loads)).T)
    return np.vstack(comm.allgather(own)), np.vstack(comm.allgather(places)), loads


def expected(scene: rf.Scene) -> tuple[Array, Array, Array, Array]:
    """K, r*, compliance and sign by Lagrange's multipliers on a free body without ties, densely."""
    forces = [load for load in scene.loads if load.displacement is None and not load.platen]
    free = replace(scene, loads=tuple(forces), supports=())
    bulk = build(free, make_mesh(comm, scene, False))
    A, places, vectors = dense(bulk)
    A *= bulk.young
    x, y = places.T
    n, count = len(A), len(scene.loads)
    on = {"top": y - 1.0, "right": x - 2.0, "left": x + 2.0}
    edges = {name: np.flatnonzero(np.isclose(off, 0.0)) for name, off in on.items()}
    taken, F = iter(vectors), np.zeros((n, count))
    held: list[tuple[dict[int, float], dict[int, float]]] = []  # factors of freedoms, of loads
    for k, load in enumerate(scene.loads):
        nodes = edges.get(load.edge or "", np.empty(0, dtype=int))
        if load.platen:
            F[2 * nodes[0] : 2 * nodes[0] + 2, k] = load.force or 0.0
            for node in nodes[1:] if load.edge not in [one.edge for one in scene.loads[:k]] else ():
                held += [({2 * node + a: 1.0, 2 * nodes[0] + a: -1.0}, {}) for a in (0, 1)]
        elif load.displacement is None:
            F[:, k] = next(taken)
        for node in nodes[y[nodes] > 0.49] if load.displacement else ():
            values = {"d": (1.0, y[node] - 2.0), "w": (None, -1.0), "u": (0.5, None)}[load.name]
            held += [({2 * node + a: 1.0}, {k: v}) for a, v in enumerate(values) if v is not None]
    for support in scene.supports:
        at = np.isclose(places, support.point or np.nan).all(axis=1)
        nodes = edges["top"] if support.edge else np.flatnonzero(at)
        held += [({2 * i + "xy".index(fix): 1.0}, {}) for i in nodes for fix in support.fix]
    held += [({dof: 1.0}, {}) for dof in bulk.contact.dofs]
    m = len(bulk.contact.dofs)
    bulk.destroy()
    C, d = np.zeros((len(held), n)), np.zeros((len(held), count))
    for i, (freedoms, factors) in enumerate(held):
        C[i, list(freedoms)], d[i, list(factors)] = list(freedoms.values()), list(factors.values())
    system = np.block([[A, C.T], [C, np.zeros((len(C), len(C)))]])
    right_hand = np.zeros((len(system), count + m))
    right_hand[:n, :-m], right_hand[n:, :-m] = F, d
    right_hand[n + len(C) - m :, -m:] = np.eye(m)
    # several constraints of a platen's node may be one
    solution = np.linalg.lstsq(system, right_hand, rcond=1e-13)[0]
    # the multipliers are the forces of the body on what holds it
    u, force = solution[:n], -solution[n:]
    sign = np.array([1.0 if load.displacement else -1.0 for load in scene.loads])
    compliance = np.where(sign[:, None] < 0.0, F.T @ u[:, :-m], d.T @ force[:, :-m])
    return force[-m:, -m:], force[-m:, :-m].T, compliance, sign


@ELEMENTS
@pytest.mark.parametrize(
    ("loads", "supports"),
    [
        ((PRESS, SHEAR, WEIGHT, SIDE), ()),
        # with the last node of the contact
        ((replace(SHEAR, edge="right"), WEIGHT, SIDE), ()),
        ((SIDE, PULL, WEIGHT), ()),
        ((SINK, SIDE, WEIGHT), ()),
        # the fretting rig: normal force and tangential displacement given, on one platen
        ((PRESS, MOVE, SIDE), ()),
        # two platens, two moved edges
        ((replace(PRESS, edge="left"), replace(SHEAR, edge="right")), ()),
        ((PULL, rf.Load("u", "left", (0.0, 0.5), displacement=(0.5, "free"))), ()),
        # what holds one point of a platen holds all of it
        ((PRESS, SHEAR), (rf.Support("x", edge="top"),)),
        ((PRESS, SHEAR), (rf.Support("y", point=(2.0, 1.0)),)),
        ((PRESS, SHEAR), (rf.Support("y", point=(-2.0, 0.5)),)),
        ((PRESS, SHEAR, SIDE), (rf.Support("xy", point=(0.0, 1.0)),)),
    ],
)
def test_condensed_system_is_that_of_multipliers(
    cell: str, degree: int, loads: tuple[rf.Load, ...], supports: tuple[rf.Support, ...]
) -> None:
    """Loads of one name are parts of a load, their sum."""
    scene = block(cell, degree, elements=8, loads=loads, supports=supports)
    K, r_star, compliance, sign = expected(scene)
    system, whole = system_of(scene), None
    if np.ptp(sign) == 0.0 and not supports:
        whole = system_of(replace(scene, loads=tuple(replace(load, name="L") for load in loads)))
    if whole is not None:
        assert np.abs(whole.r_star - r_star.sum(axis=0)).max() < 1e-11 * np.abs(r_star).max()
        assert whole.load_compliance == pytest.approx(compliance.sum(), abs=1e-11)
    if system is not None:
        assert np.abs(system.K - K).max() < 1e-11 * np.abs(K).max()
        assert np.abs(system.r_star - r_star).max() < 1e-11 * np.abs(r_star).max()
        assert np.abs(system.load_compliance - compliance).max() < 1e-11
        assert np.array_equal(system.load_sign, sign)
        resisted = np.linalg.matrix_rank(K, 1e-9 * np.abs(K).max(), hermitian=True)
        assert system.rigid.shape[1] == 2 * system.n - resisted
        assert np.abs(K @ system.rigid).max(initial=0.0) < 1e-11 * np.abs(K).max()


def bars(*loads: rf.Load, f: float = 0.35) -> rf.Scene:
    """A bar pressed by 1 on one that is held, its end face over the last contact node."""
    return block(
        body=rf.Body("a", width=4.0, position=(0.0, 1.0)),
        others=(rf.Body("b", width=4.0),),
        contacts=(rf.Contact("a.bottom", friction=f, against="b.top"),),
        loads=(rf.Load("N", "a.top", pressure=1.0), *loads),
        supports=(rf.Support("xy", "b.bottom"),),
        history=rf.HistoryOptions("monotonic", load="push", constant={"N": 1.0}),
    )


PUSHES = {
    "displacement": rf.Load("push", "a.left", displacement=(10.0, "free")),
    "moved platen": rf.Load("push", "a.left", platen=True, displacement=(10.0, "free")),
    "platen": rf.Load("push", "a.left", platen=True, force=(1.6, 0.0)),
}


@pytest.mark.parametrize("kind", PUSHES)
def test_a_face_that_touches_the_contact_pushes_up_to_gross_slip(kind: str) -> None:
    """Then the whole contact carries f N, 1.4 of 4 x 1, and so does what drives the face."""
    system = rf.condense(bars(PUSHES[kind]), comm)
    if system is None:
        return
    if kind == "platen":
        with pytest.raises(rf.NoEquilibrium, match=r"gross sliding") as caught:
            rf.evolve(system, bars(PUSHES[kind]))
        (factor,) = named_loads(caught.value, "push")
        assert factor * 1.6 == pytest.approx(1.4, rel=1e-4)
        return
    found = rf.evolve(system, bars(PUSHES[kind])).turning_points
    assert np.all(found.state[-1] == rf.State.FORWARD_SLIP)
    assert found.load_displacement[-1, 1] == pytest.approx(10.0 * 1.4, rel=1e-12)
    # in gross slip the bar moves on without straining: so does the node at the face
    assert found.v[-1, 0] > 5.0 and np.all(np.diff(found.v[-1]) < 0.0)
