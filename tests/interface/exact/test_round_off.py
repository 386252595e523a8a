"""Round-off along the exact path: rates are refined and errors cleared where they have grown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from law import random_system, worst_violation
from small import small_system, table

from receding_fenicsx.errors import NoEquilibrium
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.exact.tableau import Tableau
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.residual import reachable
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import history_from_scene
from receding_fenicsx.scene.model import OutputOptions, SolverOptions
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.studies import run as study

TRIALS = Path(__file__).parents[2] / "trials"
ALL = OutputOptions(samples_per_leg=8, cycles="all")
STATIC = SolverOptions(on_jump="static")


def condensed(name: str, *overrides: str) -> tuple[ContactSystem, Record]:
    """Condense and play a scene of the trials."""
    scene = read_scene(TRIALS / name, overrides)
    system = study.condense(scene, MPI.COMM_SELF)
    assert system is not None
    return system, evolve(system, history_from_scene(scene))


# -- nodes that supports hold ---------------------------------------------------------------------


def with_clamped_node(system: ContactSystem, seed: int) -> ContactSystem:
    """Return a system with one node more, held in both directions, coupled to all others."""
    rng, n, loads = np.random.default_rng(seed), system.n, len(system.load_names)
    K = np.zeros((2 * n + 2, 2 * n + 2))
    others = np.concatenate([np.arange(n), n + 1 + np.arange(n)])
    K[np.ix_(others, others)] = system.K
    for dof in (n, 2 * n + 1):
        K[dof, others] = K[others, dof] = rng.standard_normal(2 * n)
        K[dof, dof] = 5.0
    r_star = np.zeros((loads, 2 * n + 2))
    r_star[:, others] = system.r_star
    r_star[:, [n, 2 * n + 1]] = 3.0 * rng.standard_normal((loads, 2))
    held = np.zeros(2 * n + 2, dtype=bool)
    held[[n, 2 * n + 1]] = True
    return replace(
        system,
        x=np.arange(n + 1.0),
        points=np.stack([np.arange(n + 1.0), np.zeros(n + 1)], axis=1),
        weight=np.ones(n + 1),
        K=K,
        r_star=r_star,
        f=np.append(system.f, 0.0),
        g0=np.zeros(n + 1),
        held=held,
        rigid=np.zeros((2 * n + 2, 0)),
    )


def test_a_clamped_contact_node_changes_nothing_for_the_others() -> None:
    path = [[0.0, 0.0], [1.0, 0.0], [0.3, -0.8], [1.2, 0.7], [0.1, 0.1], [1.0, 0.0]]
    jumps = 0
    for seed in range(30):
        alone = random_system(seed, 4, 12.0)
        clamped = with_clamped_node(alone, seed)
        one, other = (
            evolve(system, table(system, path), STATIC, ALL) for system in (alone, clamped)
        )
        a, b = one.turning_points, other.turning_points
        assert np.array_equal(a.state, b.state[:, :4])
        for name in ("P", "Q", "v", "w"):
            difference = getattr(a, name) - getattr(b, name)[:, :4]
            assert np.abs(difference).max() <= 1e-9 * np.abs(getattr(a, name)).max()
        assert np.all(b.v[:, 4] == 0.0) and np.all(b.w[:, 4] == 0.0)
        assert other.jumps == one.jumps
        assert other.released == pytest.approx(one.released, rel=1e-6, abs=1e-12)
        jumps += one.jumps
    assert jumps >= 5


# -- rates that round-off has spoilt ---------------------------------------------------------------


# -- what the care costs --------------------------------------------------------------------------


def count_products(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Count what costs as much as a product with the whole stiffness, from now on."""
    counts = {"refined": 0, "build": 0, "removed": 0}

    def counting(owner: type, method: str, key: str) -> None:
        plain = getattr(owner, method)

        def counted(self: object, *args: object) -> object:
            counts[key] += 1
            return plain(self, *args)

        monkeypatch.setattr(owner, method, counted)

    counting(Tableau, "refined", "refined")
    counting(Tableau, "build", "build")
    counting(Walk, "_balanced", "removed")
    return counts


def test_only_what_round_off_has_spoilt_is_refined(monkeypatch: pytest.MonkeyPatch) -> None:
    # a slip length of 48 heights: round-off of the displacements is a thousand times that of forces
    counts = count_products(monkeypatch)
    system, record = condensed("strip_on_wall.toml", "mesh.contact_elements=300")
    at = record.turning_points
    u, force = np.hstack([at.v, at.w]), max(np.abs(at.P).max(), np.abs(at.Q).max())
    assert record.n_events > 2000
    assert record.residual_max <= max(reachable(system, one, force) for one in u) <= 1e-10
    assert counts["refined"] <= 0.05 * record.n_events
    assert counts["removed"] <= 0.1 * record.n_events
    assert counts["build"] <= 6


# -- nearly singular bodies -----------------------------------------------------------------------


def near_singular_node(condition: float, angle: float, f: float) -> ContactSystem:
    """Return one node whose stiffness has one soft direction."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    K = R @ np.diag([1.0, 1.0 / condition]) @ R.T
    return small_system(K, {"a": [0.3, 1.0], "b": [1.0, -0.2]}, f)


@pytest.mark.parametrize("condition", [2.9e3, 1e5, 1e7, 1e8])
@pytest.mark.parametrize("angle", [0.3, 1.4, 2.2])
@pytest.mark.parametrize("f", [0.1, 0.6])
def test_a_node_with_a_soft_direction_is_unloaded_and_loaded_again(
    condition: float, angle: float, f: float
) -> None:
    system = near_singular_node(condition, angle, f)
    path = [[0.0, 0.0], [1.0, 0.0]]
    loop = [[1.0, 0.0], [0.0, 0.0], [1.0, 0.1], [1.0, 0.0]]
    record = evolve(system, table(system, path, loop, 4), output=ALL)
    # an open contact is measured by a hundredth of its held reactions
    allowed = 1e4 * float(np.finfo(float).eps) * condition
    assert record.residual_max <= max(1e-11, allowed)
    assert worst_violation(system, record) <= max(1e-11, allowed)
    assert record.energy_error_max <= max(1e-10, allowed)


@pytest.mark.parametrize("g0", [0.0, 0.3])
@pytest.mark.parametrize("k", [1e-4, 1e-8, 1e-9])
def test_soft_springs_carry_a_body_that_is_lifted_off_and_put_back(k: float, g0: float) -> None:
    """They lift by the load over k, with round-off of K times that; it is small beside the load."""
    lift, turn = np.array([[0.0, 0, 1, 1], [0, 0, 1, -1]]) / np.sqrt(2.0)
    K = np.diag([1.0, 1.0, 0.0, 0.0]) + k * np.outer(lift, lift) + 0.7 * np.outer(turn, turn)
    pull = np.array([0.0, 0.0, -1.3, -0.4])
    system = small_system(K, {"pull": pull}, 0.3, g0)
    record = evolve(system, table(system, [[0.0], [1.0], [-1.0], [1.0]]))
    ends = record.turning_points
    w = -(lift @ pull / k * lift + turn @ pull / 0.7 * turn)[2:]
    assert ends.w[[0, 2]] == pytest.approx(np.array([w, w]), rel=1e-15 / k)
    assert np.abs(ends.P[[0, 2]]).max() <= 1e-14 / k
    # put back, it is pressed on through its gaps
    assert ends.P[1] == pytest.approx(-pull[2:] - k * g0, rel=1e-12)
    assert ends.w[1].tolist() == [-g0, -g0]


def test_a_stiffness_that_is_round_off_carries_no_load() -> None:
    # a body that is free to lift and to turn about its two nodes: it tips where P of node 0 is gone
    K = np.diag([10.0, 6.0, 8.6e-31, 5.2e-31])
    K[0, 1] = K[1, 0] = -4.0
    loads = {"a": [0.0, 0.0, 3.0, 2.0], "b": [0.0, 0.0, -1.0, -2.0], "c": [2.0, 2.0, -2.0, 0.0]}
    rigid = [[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, -1.0, 1.0]]
    system = small_system(K, loads, 0.0, [0.0, 0.0625], rigid)
    system.held[1] = True
    path = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75, 1.0]]
    # P_0 = 3 - 4.25 s
    with pytest.raises(NoEquilibrium, match=r"overturning at a = 0\.647058"):
        evolve(system, table(system, path))
