"""Fields of the condensed system, and uniform stress."""

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, block, built, condense, displacements, reactions
from kinds import EVEN, UNEVEN

import receding_fenicsx as rf
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.body import back_substitute, gather_contact, times
from receding_fenicsx.bulk.elasticity import stresses
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.timing import Timer

comm = MPI.COMM_WORLD
KINDS = EVEN | UNEVEN


@pytest.mark.parametrize("name", [name for name in KINDS if name != "half-planes"])
def test_fields_are_those_of_the_condensed_system(name: str) -> None:
    """In any displacements u: forces and displacements at the contacts, loads' work and energy.

    U A U of all bodies and F c F of what is between them are u r + lambda d, d the conjugates.
    """
    scene = KINDS[name]
    bodies = bulk_of(scene, comm, Timer(None))
    system = condense(bodies)
    load = u = None
    if system is not None:
        random = np.random.default_rng(3)
        load = random.normal(size=len(system.load_names))
        u = np.where(system.held, 0.0, random.normal(size=2 * system.n))
    moved = displacements(bodies, load, u)
    own = [factors for _, factors, _ in bodies.as_joined(load, u)]
    found = [reactions(part, at, field) for (part, field), at in zip(moved, own, strict=True)]
    fields = [_dolfinx.owned_values(field)[:, None] for _, field in moved]
    parts = [part for part, _ in moved]
    # the nodal forces of each load times the field, and those of the body
    work = sum(comm.allreduce((U.T @ p.loads)[0]) for U, p in zip(fields, parts, strict=True))
    energy = sum(
        comm.allreduce(p.young * float(np.sum(U * times(p.stiffness, U))))
        for U, p in zip(fields, parts, strict=True)
    )
    sides = [gather_contact(p, U) for U, p in zip(fields, parts, strict=True)]

    def check() -> None:
        assert system is not None and load is not None and u is not None
        r, n, n_loads = load @ system.r_star + system.K @ u, system.n, len(load)
        conjugate = system.load_compliance @ load + system.load_sign * (system.r_star @ u)
        pushes, scale = system.load_sign < 0.0, np.abs(r).max()
        moves, size = np.asarray(work), np.abs(conjugate).max()
        assert np.abs(moves[:n_loads] - conjugate)[pushes].max(initial=0.0) < 1e-10 * size
        # bolts and springs between bodies are as long as the places that they join are apart
        at, soft = bodies.links()
        F, shortening = own[0][at], np.append(load, np.zeros(len(moves)))[at]
        assert np.abs(soft @ F + moves[at] - shortening).max(initial=0.0) < 1e-10 * size
        total = u @ r + load @ conjugate
        assert energy + F @ soft @ F == pytest.approx(total, rel=1e-9, abs=1e-9 * scale)
        if not scene.ties:
            for part, G, force in zip(parts, bodies.relative.on, found, strict=True):
                lost = rf.given(force) - G.T @ r
                assert np.abs(lost[~part.contact.held]).max() < 1e-11 * scale
        apart = u.copy()
        for k, contact in enumerate(scene.contacts):
            on = system.edges == k
            gaps = [(one.name, one.gap, 1.0) for one in scene.loads]
            for of, gap, sign in [*gaps, ("interference", contact.interference, -1.0)]:
                if gap is not None:
                    factor = load[system.load_names.index(of)]
                    apart[n:][on] -= sign * factor * evaluate(gap, system.x[on])
        local = [p.contact.to_local(rf.given(U)[:, 0]) for U, p in zip(sides, parts, strict=True)]
        relative = sum(G @ one for G, one in zip(bodies.relative.on, local, strict=True))
        apart = np.where(system.held, 0.0, apart)
        known = np.append(apart, np.zeros(len(relative) - 2 * n))
        assert np.abs(relative - known).max() < 1e-11 * max(np.abs(one).max() for one in local)

    rf.on_root(comm, check)
    bodies.destroy()


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kinematics", ["plane strain", "plane stress", "axisymmetric"])
@pytest.mark.parametrize("symmetry", ["auto", "none"])
def test_uniform_pressure_on_a_free_sliding_block_gives_uniform_stress(
    cell: str, degree: int, kinematics: str, symmetry: str
) -> None:
    p, young, nu = 0.75, 2.0, 0.3
    scene = block(
        cell,
        degree,
        load=rf.Load("p", "top", pressure=1.0),
        material=rf.Material(young, nu, kinematics),
        contacts=(rf.Contact(friction=0.0),),
        history=rf.HistoryOptions(kind="monotonic", maximum=p),
        solver=rf.SolverOptions(symmetry=symmetry),
    )
    system = rf.condense(scene)
    u = None
    if system is not None:
        record = rf.evolve(system, scene)
        table = record.turning_points
        assert table.p[-1] == pytest.approx(p, rel=1e-11)
        assert np.abs(table.q[-1]).max() == 0.0
        stretch = nu * (1.0 + nu) if kinematics == "plane strain" else nu
        slid = table.v[-1] - stretch * p / young * record.x
        assert np.ptp(slid) < 1e-12
        assert record.residual_max < 1e-13
        modelled = ~mirror_of(system).left
        u = np.concatenate([table.v[-1][modelled], table.w[-1][modelled]])
    bulk = built(scene, is_half_meshed(scene))
    field = stresses(bulk, back_substitute(bulk, np.array([p]), u))
    szz = -nu * p if kinematics == "plane strain" else 0.0
    for name, value in (("sxx", 0.0), ("syy", -p), ("szz", szz), ("sxy", 0.0)):
        for function in (field.cell[name], field.nodal[name]):
            assert np.abs(function.x.array - value).max() < 2e-12, name
    bulk.destroy()
