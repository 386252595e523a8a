"""Dissipation of sheared cylinders by the memory of the contact, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from receding_fenicsx.reference.closed_forms import CattaneoMindlin, Hertz
from receding_fenicsx.reference.fretting import cycle_dissipation

HERTZ = Hertz(force=2.0, radius=30.0, modulus=70.0)
F = 0.4
ANGLE = 2.0 * np.pi * np.arange(801) / 800


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.999])
def test_constant_normal_force_gives_the_loop_of_cattaneo_and_mindlin(part: float) -> None:
    largest = part * F * HERTZ.force
    known = CattaneoMindlin(HERTZ, F, largest).dissipation()
    P = np.full_like(ANGLE, HERTZ.force)
    found = cycle_dissipation(HERTZ, F, P, largest * np.cos(ANGLE))
    assert found == pytest.approx(known, rel=1e-4 / part)
    # to lowest order the loop grows with the third power of the force
    if part == 0.1:
        half = CattaneoMindlin(HERTZ, F, 0.5 * largest).dissipation()
        assert known / half == pytest.approx(8.0, rel=0.05)


def test_dissipation_scales_with_force_and_modulus() -> None:
    P, Q = 2.0 + np.cos(ANGLE), 0.3 * np.sin(ANGLE)
    once = cycle_dissipation(HERTZ, F, P, Q)
    assert cycle_dissipation(HERTZ, F, 3.0 * P, 3.0 * Q) == pytest.approx(9.0 * once, rel=1e-9)
    assert cycle_dissipation(replace(HERTZ, modulus=35.0), F, P, Q) == pytest.approx(2.0 * once)


def test_opposite_phases_dissipate_the_same() -> None:
    P = 2.0 + np.cos(ANGLE)
    turned = [cycle_dissipation(HERTZ, F, P, 0.3 * np.cos(ANGLE - a)) for a in (0.7, 0.7 + np.pi)]
    assert turned[0] == pytest.approx(turned[1], rel=1e-12)
