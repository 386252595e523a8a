from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system, table

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.residual import (
    law_residual,
    reachable,
    round_off,
)
from receding_fenicsx.interface.system import (
    ContactSystem,
    eliminate_tangential,
    frictional_form,
    reactions,
)

F = 0.3


def four_nodes() -> tuple[ContactSystem, np.ndarray, np.ndarray, np.ndarray]:
    """Return a system and valid r, u and slip: stick, separation, forward and backward slip."""
    system = small_system(np.eye(8) * 3.0, {"load": np.zeros(8)}, F, [0.0, 0.1, 0.2, 0.4])
    P = np.array([2.0, 0.0, 0.7, 1.3])
    Q = np.array([-0.5, 0.0, -F * 0.7, F * 1.3])
    w = np.array([0.0, 0.05, -0.2, -0.4])
    slip = np.array([0.0, 0.8, 0.3, -0.6])
    return system, np.concatenate([Q, P]), np.concatenate([slip, w]), slip


@pytest.mark.parametrize(
    ("what", "entry", "value", "residual", "at"),
    [
        ("stick beyond the cone", "r", -0.9, 0.9 - F * 2.0, 0),  # |Q| - f P
        ("slip of a stuck node", "slip", 0.01, 0.03, 0),  # k dv, inside the cone
        ("open node under shear", "r", 0.2, 0.2, 1),  # |Q|, no pressure
        ("closed gap under pressure below zero", "r", -0.4, 0.4, 4),
        ("pressure across a gap", "r", 0.1, 0.1, 5),  # min(P, k gap) = min(0.1, 0.45)
        ("penetration", "u", -0.25, 0.45, 5),  # k |gap| = 3 * 0.15
        ("slip along the friction", "slip", -0.05, 0.15, 2),  # k |dv|
        ("slip under too little friction", "r", 0.1, 0.1 + F * 0.7, 2),
        ("backward slip that goes forward", "slip", 0.02, 0.06, 3),
    ],
)
def test_residual_measures_each_violation(
    what: str, entry: str, value: float, residual: float, at: int
) -> None:
    system, r, u, slip = four_nodes()
    where = {"r": r, "u": u, "slip": slip}[entry]
    where[at] = value
    now = law_residual(system, r, u, slip, system.local_stiffness)
    assert now[at] == pytest.approx(residual, rel=1e-13), what
    assert now.argmax() % 4 == at % 4


def test_held_freedoms_have_no_residual() -> None:
    system, r, u, slip = four_nodes()
    held = np.zeros(8, dtype=bool)
    held[[0, 6]] = True
    r[0], r[6] = 99.0, -99.0
    now = law_residual(replace(system, held=held), r, u, slip, system.local_stiffness)
    assert now[0] == 0.0 and now[6] == 0.0


def test_reactions_by_hand() -> None:
    K = [[4.0, 1.0], [1.0, 3.0]]
    system = small_system(K, {"a": [1.0, 2.0], "b": [-1.0, 0.5]}, 0.2)
    r = reactions(system, np.array([2.0, 3.0]), np.array([0.1, -0.2]))
    # Q = 2 - 3 + 0.4 - 0.2, P = 4 + 1.5 + 0.1 - 0.6
    assert r == pytest.approx([-0.8, 5.0])


def test_round_off_bounds_the_error_of_the_product() -> None:
    rng = np.random.default_rng(2)
    K = rng.standard_normal((8, 8)) * 10.0 ** rng.uniform(-3, 3, 8)
    system = small_system(K + K.T, {"a": np.zeros(8)}, 0.2)
    u = rng.standard_normal(8)
    exact = (system.K.astype(np.longdouble) * u.astype(np.longdouble)).sum(axis=1)
    error = np.abs(reactions(system, np.zeros(1), u) - exact).max()
    assert 0.0 < error <= 8 * round_off(system, u, 1.0)
    assert round_off(system, u, 0.0) == 0.0


def test_a_body_far_away_excuses_no_residual() -> None:
    whole = block_system(24, 6, half=False)
    moved = whole.rigid @ np.array([1.0, 3.0, 1.0])
    assert reachable(whole, moved, 1.0) < 1e-12
    # round-off of K u alone is then as large as any force
    assert round_off(whole, 1e16 * moved, 1.0) > 1.0
    assert reachable(whole, 1e16 * moved, 1.0) <= 1e-6


def test_a_millionth_of_what_soft_springs_carry_may_be_round_off() -> None:
    lift, turn = np.array([[0.0, 0, 1, 1], [0, 0, 1, -1]]) / np.sqrt(2.0)
    system = small_system(1e-9 * np.outer(lift, lift) + np.outer(turn, turn), {"a": lift}, 0.2)
    force, u = 100.0, 100.0 / 1e-9 * lift
    noise = 32.0 * round_off(system, u, 1.0)
    assert 1e-6 < reachable(system, u, 1.0) <= 1e-6 * force < noise
    assert reachable(system, u, force) == 1e-6


def test_frictional_form_holds_the_eliminated_freedoms() -> None:
    normal = eliminate_tangential(block_system(20, 10, f=0.0))
    form = frictional_form(normal)
    assert form.K.shape == (42, 42) and form.r_star.shape == (1, 42)
    assert form.held[:21].all() and not form.held[21:].any()
    assert np.array_equal(form.K[21:, 21:], normal.K) and not form.K[:21].any()
    assert frictional_form(form) is form


def test_pushing_a_frictionless_body_along_the_plane_is_refused() -> None:
    K = np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]]) + np.diag([0.0, 0.0, 1.0, 1.0])
    rigid = [[1.0, 1.0, 0.0, 0.0]]
    pushed = small_system(K, {"down": [0, 0, 1, 1], "along": [-1, -1, 0, 0]}, 0.0, rigid=rigid)
    with pytest.raises(InputError, match=r"load 'along' pushes .* add a \[\[support\]\]"):
        eliminate_tangential(pushed)
    squeezed = small_system(K, {"down": [0.2, -0.2, 1, 1]}, 0.0, rigid=rigid)
    record = evolve(eliminate_tangential(squeezed), table(squeezed, [[0.0], [1.0]]))
    # v1 - v2 = d with Q1 = 0.2 + d = 0, the mean of v staying at zero
    assert record.turning_points.v[0] == pytest.approx([-0.1, 0.1])


@pytest.mark.parametrize("name", [field.name for field in fields(ContactSystem)])
def test_a_field_of_a_wrong_type_is_refused_by_its_name(name: str) -> None:
    may_be_none = ("slip_map", "edge", "f_backward", "probes", "cohesion", "shear_limit")
    wrong: list[Any] = ["x", None, 3, [1, 2], {"a": 1}]
    for bad in wrong:
        # evolve leaves the text of a scene out of account
        if name == "scene_toml" or (bad is None and name in may_be_none):
            continue
        system = replace(block_system(8, 2), **{name: bad})
        with pytest.raises(InputError, match=name) as error:
            evolve(system, cyclic(1))
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: {"weight": -s.weight}, "weight of the contact system is .* at node 0"),
        (lambda s: {"x": s.x[::-1].copy()}, "x of the contact system falls from node 0 to node 1"),
        (lambda s: {"edge": np.arange(s.n)[::-1].copy()}, "sort the nodes"),
        (lambda s: {"held": np.arange(2 * s.n) == s.n + 3}, "f of .* at node 3: has to be 0"),
        (lambda s: {"rigid": np.eye(2 * s.n)[:, :1]}, "a motion that its K resists"),
    ],
)
def test_weights_order_and_motions_without_meaning_are_refused(change: Any, words: str) -> None:
    system = block_system(8, 2)
    with pytest.raises(InputError, match=words):
        evolve(replace(system, **change(system)), cyclic(1))


@pytest.mark.parametrize(
    "change",
    [
        {"r_star": 1e300},
        {"r_star": 1e200, "load": 1e200},
        {"K": 1e308},
        {"K": 1e160, "r_star": 1e160},
        {"K": 1e-160, "r_star": 1e-160},
        {"g0": 1e308},
        {"f": 1e308},
        {"f": 1e-310},
        {"weight": 1e-310},
    ],
)
@pytest.mark.filterwarnings("error")
def test_numbers_that_would_overflow_are_refused_without_a_warning(
    change: dict[str, float],
) -> None:
    system = block_system(8, 2)
    arrays = {
        # ones where all is zero
        name: factor * (getattr(system, name) / (np.abs(getattr(system, name)).max() or 1.0))
        + factor * (name == "g0")
        for name, factor in change.items()
        if name != "load"
    }
    with pytest.raises(InputError, match=r"1e|beyond the range"):
        evolve(replace(system, **arrays), cyclic(1, maximum=change.get("load", 1.0)))


def test_motions_that_a_system_without_friction_resists_are_refused() -> None:
    system = eliminate_tangential(block_system(8, 2, f=0.0))
    evolve(system, cyclic(1))
    with pytest.raises(InputError, match="a motion that its K resists"):
        evolve(replace(system, rigid=np.eye(2 * system.n)[:, -1:]), cyclic(1))
