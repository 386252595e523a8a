"""Critical friction: paper and pencil, all signs, and proofs that no mode exists below."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx.interface.branches.critical_friction import search_signs
from receding_fenicsx.interface.law import SEPARATION


def random_system(seed: int, n: int) -> rf.ContactSystem:
    rng = np.random.default_rng([seed, 5])
    G = rng.standard_normal((2 * n, 3 * n + 1))
    f = rng.uniform(0.2, 1.0, n)
    return small_system(G @ G.T / n, {"press": np.repeat([0.0, 1.0], n)}, f)


def smallest_factor(system: rf.ContactSystem) -> float:
    """Return 1 / the largest real eigenvalue of -K_tt^-1 S F K_nt, every sign by itself."""
    n, best = system.n, 0.0
    for s in product((-1.0, 1.0), repeat=n):
        B = -np.linalg.solve(system.K[:n, :n], (np.array(s) * system.f)[:, None] * system.K[n:, :n])
        values = np.linalg.eigvals(B)
        real = values.real[np.abs(values.imag) < 1e-10 * np.abs(values).max()]
        best = max(best, real.max(initial=0.0))
    return 1.0 / best


def test_one_node_wedges_at_its_stiffness_ratio() -> None:
    # K_tt v + s f K_nt v = 0: f = K_tt / |K_nt|
    found = rf.critical_friction(small_system([[2.0, -1.5], [-1.5, 2.0]], {"p0": [0, 1]}, 0.5))
    for value in (found.factor, found.lower_bound, found.unique_below):
        assert value == pytest.approx(2.0 / (0.5 * 1.5), rel=1e-6)
    # with K_nt < 0 the node that slips forward is pressed on
    assert found.exact and found.signs.tolist() == [1.0] and found.keeps_signs
    assert found.mode.tolist() == [1.0, 0.0]


def test_without_coupling_there_is_no_mode() -> None:
    found = rf.critical_friction(small_system(np.diag([2.0, 3.0, 1.0, 1.0]), {"p0": [0] * 4}, 0.5))
    assert found.factor == found.lower_bound == found.unique_below == np.inf
    assert not found.mode.any()


def test_factor_is_that_of_all_signs_and_the_search_finds_it() -> None:
    missed, kept = 0, set[bool]()
    for seed in range(18):
        n = 2 + seed % 9
        system = random_system(seed, n)
        found, K = rf.critical_friction(system), system.K
        if n <= 8:
            assert found.factor == pytest.approx(smallest_factor(system), rel=1e-9), seed
        A: np.ndarray = -(system.f[:, None] * K[n:, :n]) @ np.linalg.inv(K[:n, :n])
        mu, signs = search_signs(A, starts=24)
        values = np.linalg.eigvals(signs[:, None] * A)
        real = values.real[np.abs(values.imag) < 1e-10 * np.abs(values).max()]
        assert mu == pytest.approx(real.max(), rel=1e-9) and mu <= (1.0 + 1e-9) / found.factor
        missed += mu < (1.0 - 1e-9) / found.factor
        assert found.unique_below <= found.lower_bound * (1 + 1e-6)
        assert found.lower_bound <= found.factor * (1 + 1e-9)
        # the mode is in equilibrium at its factor of friction
        Q, P = found.reactions[:n], found.reactions[n:]
        off = Q + found.factor * found.signs * system.f * P
        assert np.abs(off).max() <= 1e-9 * np.abs(found.reactions).max()
        assert np.abs(found.mode).max() == pytest.approx(1.0, rel=1e-12)
        kept.add(found.keeps_signs)
        assert found.keeps_signs == np.all(found.signs * found.mode[:n] >= -1e-9)
    assert missed == 0 and kept == {True, False}


def test_open_nodes_follow_without_reactions_and_frictionless_ones_without_shear() -> None:
    system = random_system(3, 6)
    system = replace(system, f=np.where(np.arange(6) == 2, 0.0, system.f))
    states = [1, SEPARATION, 3, 4, 1, SEPARATION]
    found = rf.critical_friction(system, states)
    Q, P = found.reactions.reshape(2, 6)
    size = np.abs(found.reactions).max()
    assert np.abs(np.concatenate([Q[[1, 2, 5]], P[[1, 5]]])).max() <= 1e-9 * size
    assert np.abs(found.mode[6 + np.array([0, 2, 3, 4])]).max() == 0.0
    assert np.flatnonzero(found.signs).tolist() == [0, 3, 4]
    # of half a model those of the whole contact say the same
    half = replace(system, half=True, x=1.0 + np.arange(6.0))
    assert rf.critical_friction(half, [2, 3, 4, 3, 2, 1, *states]).factor == found.factor


def test_nodes_held_along_the_contact_are_left_out_and_those_held_across_it_slide() -> None:
    system = random_system(6, 6)
    held = replace(system, held=np.isin(np.arange(12), [0, 11]))
    rest = np.setdiff1d(np.arange(12), [0, 6])
    f = np.append(system.f[1:5], 0.0)
    other = small_system(system.K[np.ix_(rest, rest)], {"press": [0.0] * 10}, f)
    one, two = rf.critical_friction(held), rf.critical_friction(other)
    assert one.factor == pytest.approx(two.factor, rel=1e-12)
    assert one.signs.tolist() == [0.0, *two.signs] and one.mode[rest] == pytest.approx(two.mode)


def test_scales_of_stiffness_and_friction_cancel() -> None:
    system = random_system(4, 7)
    one = rf.critical_friction(system)
    two = rf.critical_friction(replace(system, K=system.K * 2.0**30, f=2.0 * system.f))
    for name in ("factor", "lower_bound", "unique_below"):
        assert getattr(one, name) == pytest.approx(2.0 * getattr(two, name), rel=1e-6)
