"""Certificate of uniqueness: closed forms, and every set of states of another code."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from equations import Body
from small import small_system, table
from ways import rates

from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.lcp.contact import choices
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.interface.uniqueness.certificate import Certificate, certify
from receding_fenicsx.interface.uniqueness.instants import Sides, bits_of

RATES = 4
"""Load rates for which the solutions of an instant are counted."""


def test_margin_is_that_of_the_stiffness_with_separated_nodes_condensed_out() -> None:
    rng = np.random.default_rng(1)
    G = rng.standard_normal((6, 9))
    system = small_system(G @ G.T, {"a": np.ones(6)}, [0.4, 0.7, 0.9])
    state = np.array([FORWARD, SEPARATION, BACKWARD], dtype=np.int8)
    found, nodes = Certificate(system).margin(state)
    # compliance: the stiffness of what is left is the inverse of its part of K^-1
    kept = [0, 2, 3, 5]
    S = np.linalg.inv(np.linalg.inv(system.K)[np.ix_(kept, kept)])
    M = S[:2, :2] + found * np.diag([0.4, -0.9]) @ S[2:, :2]
    assert abs(np.linalg.eigvalsh(0.5 * (M + M.T))[0]) < 1e-12 * np.abs(S).max()
    for below in (0.2, 0.9, 0.999):
        M = S[:2, :2] + below * found * np.diag([0.4, -0.9]) @ S[2:, :2]
        assert np.linalg.eigvalsh(0.5 * (M + M.T))[0] > 0.0
    assert set(nodes) <= {0, 2}
    judge, stuck = Certificate(system), np.full(3, STICK, dtype=np.int8)
    assert judge.margin(stuck)[0] == np.inf
    assert certify(judge, [Sides.of(state)], 0.9999 * found) is not None
    assert certify(judge, [Sides.of(state)], 1.0001 * found) is None


def random_instant(seed: int) -> tuple[ContactSystem, Certificate, Sides]:
    """Return a contact of up to four nodes, frictionless and held ones among them, in any state."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    G = rng.standard_normal((2 * n, 3 * n))
    couple = np.diag(rng.uniform(-1.0, 1.0, n))
    K = rng.uniform(0.02, 0.3) * G @ G.T / n + 1.02 * np.eye(2 * n)
    K += np.kron([[0, 1], [1, 0]], couple)
    smooth = rng.random(n) < 0.15
    f, back = (np.where(smooth, 0.0, rng.uniform(0.1, 2.5, n)) for _ in range(2))
    system = small_system(K, {"a": np.zeros(2 * n)}, f)
    held = np.concatenate([rng.random(n) < 0.1, np.zeros(n, dtype=bool)])
    system = replace(system, held=held, f_backward=back if seed % 3 else None)
    judge = Certificate(system)
    kinds = np.array([STICK, SEPARATION, FORWARD, BACKWARD])
    state = rng.choice(kinds, n, p=[0.1, 0.2, 0.35, 0.35]).astype(np.int8)
    state[~judge.frictional & (state > SEPARATION)] = STICK
    touching = bits_of(rng.random(n) < 0.4)
    return system, judge, Sides.of(state).put(touching, 0)


def counts(system: ContactSystem, judge: Certificate, instant: Sides, seed: int) -> set[int]:
    """Return the numbers of solutions for several load rates, all sets of states being tried."""
    rng = np.random.default_rng(seed)
    may = choices(judge.undecided(instant))
    state = instant.states(system.n)
    every = [may.get(i, (int(state[i]),)) for i in range(system.n)]
    found = set()
    for _ in range(RATES):
        loaded = replace(system, r_star=rng.standard_normal((1, 2 * system.n)))
        found.add(len(rates(Body(loaded), np.ones(1), every)))
    return found


def test_a_certified_instant_has_one_solution_for_every_load_rate() -> None:
    tally = {"certified": 0, "one": 0, "others": 0}
    for seed in range(120):
        system, judge, instant = random_instant(seed)
        sets = list(instant.explicit(judge.rubbing))
        found = counts(system, judge, instant, seed)
        if all(judge.margin(one.states(system.n))[0] > 1.0 + 1e-9 for one in sets):
            assert found == {1}, seed
            tally["certified"] += 1
        else:
            tally["one" if found == {1} else "others"] += 1
    # the certificate fails for some, and some of these have several solutions or none
    assert min(tally.values()) > 0, tally


def test_every_set_in_a_pattern_has_the_margin_that_one_factorisation_shows() -> None:
    tally = {"held": 0, "turned": 0, "open and slipping": 0, "refused": 0, "touching": 0}
    # in the last ones a node that closes, or two that turn round, lower it below what is certified
    for seed in (*range(100), 481, 637, 2516, 2793, 3712):
        rng = np.random.default_rng(seed)
        n = 3
        G = rng.standard_normal((2 * n, 3 * n))
        K = rng.uniform(0.02, 0.2) * G @ G.T / n + np.eye(2 * n)
        system = small_system(K, {"a": np.zeros(2 * n)}, rng.uniform(0.1, 1.5, n))
        back = rng.uniform(0.1, 1.5, n) if seed % 2 else None
        judge = Certificate(replace(system, f_backward=back))
        sides = np.array(list(product((STICK, SEPARATION, FORWARD, BACKWARD), repeat=n)), np.int8)
        every = [Sides.of(state) for state in sides]
        group = [every[k] for k in rng.integers(len(every), size=int(rng.integers(1, 6)))]
        # some nodes touch, and may do anything
        touching = int(rng.integers(2**n)) if seed % 3 == 0 else 0
        group[0] = group[0].put(touching, 0)
        alone = [
            min(judge.margin(each.states(n))[0] for each in one.explicit(judge.rubbing))
            for one in group
        ]
        margin = rng.uniform(0.2, 1.1) * min([*alone, 100.0])
        pattern = certify(judge, group, margin)
        if pattern is None:
            tally["refused"] += 1
            assert touching or len(group) > 1 or alone[0] <= margin
            continue
        assert touching or pattern.holds(group[0])
        for one in every:
            several = one.put(int(rng.integers(2**n)), 0)
            if several.touching.bit_count() > 1 and pattern.holds(several):
                tally["touching"] += 1
                for each in several.explicit(judge.rubbing):
                    assert judge.margin(each.states(n))[0] > margin, (seed, several)
        for one, state in zip(every, sides, strict=True):
            if pattern.holds(one):
                assert judge.margin(state)[0] > margin, (seed, state)
                tally["held"] += 1
                turned = one.forward & pattern.backward | one.backward & pattern.forward
                tally["turned"] += turned != 0
                tally["open and slipping"] += pattern.may_open != pattern.opened and one.open != 0
    assert min(tally.values()) > 10, tally


@pytest.mark.parametrize("loads", ["ab", "ba", "aba"])
def test_the_number_found_at_a_first_loading_is_the_largest_of_all_from_rest(loads: str) -> None:
    """Under a the node sticks, slips backward or opens; under b it sticks alone."""
    node = small_system([[1.0, 0.9], [0.9, 1.0]], {"a": [1.3, 1.0], "b": [0.0, 1.0]}, 1.5)
    path = [[0.0, 0.0]]
    for load in loads:
        path += [[float(load == "a"), float(load == "b")], [0.0, 0.0]]
    unique = evolve(node, table(node, path)).uniqueness
    assert unique is not None and not unique.certified
    assert unique.first_loading == unique.solutions == 3
    assert unique.leg == 2 * loads.index("a")
