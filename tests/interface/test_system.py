from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from models import block_system
from small import cyclic, small_system, table

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.residual import reachable, round_off
from receding_fenicsx.interface.system import ContactSystem, eliminate_tangential, reactions


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


def test_a_frictionless_body_is_free_to_give_way_along_the_plane() -> None:
    K = np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]]) + np.diag([0.0, 0.0, 1.0, 1.0])
    rigid = [[1.0, 1.0, 0.0, 0.0]]
    squeezed = small_system(K, {"down": [0.2, -0.2, 1, 1]}, 0.0, rigid=rigid)
    record = evolve(eliminate_tangential(squeezed), table(squeezed, [[0.0], [1.0]]))
    # v1 - v2 = d with Q1 = 0.2 + d = 0, the mean of v staying at zero
    assert record.turning_points.v[0] == pytest.approx([-0.1, 0.1])
    # the motion along the plane may have a normal part of round-off
    off = replace(squeezed, rigid=np.array([[1.0], [1.0], [1e-16], [2e-16]]))
    assert eliminate_tangential(off).r_star == pytest.approx(np.ones((1, 2)), rel=1e-12)


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
