"""Where equilibrium ends on a leg, by statics alone, against paper and pencil."""

from dataclasses import replace

import numpy as np
import pytest
from models import block_system

from receding_fenicsx.interface.equilibrium import furthest
from receding_fenicsx.interface.system import ContactSystem

WHOLE = block_system(24, 6, half=False)
N, DOWN = WHOLE.n, WHOLE.r_star[0, WHOLE.n :].sum()
ONE = np.array([1.0])


def with_second(second: np.ndarray, scale: float = 1.0) -> ContactSystem:
    """Return the free block, 4 wide, with a second load; all loads times ``scale``."""
    return replace(
        WHOLE,
        r_star=scale * np.vstack([WHOLE.r_star, second]),
        load_names=("p0", "second"),
        load_compliance=np.zeros((0, 0)),
    )


PUSH = np.concatenate([-WHOLE.weight / WHOLE.weight.sum(), np.zeros(N)])
PULL = np.concatenate([np.zeros(N), -WHOLE.weight / WHOLE.weight.sum()])
COUPLE = np.zeros(2 * N)
COUPLE[[N, 2 * N - 1]] = -1.0, 1.0


@pytest.mark.parametrize("scale", [1.0, 1e9, 1e-12])
@pytest.mark.parametrize(
    ("second", "end", "kind"),
    [
        (PUSH, 0.35 * DOWN, "gross sliding"),
        (-PUSH, 0.2 * DOWN, "gross sliding"),
        # it would tip further on
        (PUSH + 1.3 * COUPLE, 0.35 * DOWN, "gross sliding"),
        (PULL, DOWN, "lift-off"),
        # the couple 4 m moves the centre of pressure to the end of the contact, 2 from the middle
        (COUPLE, DOWN * 2.0 / 4.0, "overturning"),
    ],
)
def test_a_free_block_ends_where_statics_says(
    second: np.ndarray, end: float, kind: str, scale: float
) -> None:
    system = replace(with_second(second, scale), f_backward=np.full(N, 0.2))
    a, b = np.array([1.0, 0.0]), np.array([1.0, 1.25 * end])
    found = furthest(system, a, b)
    assert found is not None
    assert (found.kind, found.s) == (kind, pytest.approx(0.8, rel=1e-9))
    assert furthest(system, a, np.array([1.0, 0.99 * end])) is None


def test_a_frictionless_body_slides_at_once() -> None:
    smooth = replace(with_second(PUSH), f=np.zeros(N))
    found = furthest(smooth, np.array([1.0, 0.0]), np.array([1.0, 1.0]))
    assert found is not None and found.kind == "gross sliding" and found.s == pytest.approx(0.0)


def test_a_half_body_lifts_off_where_its_load_vanishes() -> None:
    half = block_system(12, 6)
    assert furthest(half, ONE, 0.01 * ONE) is None
    found = furthest(half, ONE, -ONE)
    assert found is not None and found.kind == "lift-off"
    assert found.s == pytest.approx(0.5, rel=1e-12)
    # one that only turns about its first node cannot lift off
    turn = np.concatenate([np.zeros(half.n), half.x / half.x.max()])[:, None]
    found = furthest(replace(half, rigid=turn), ONE, -ONE)
    assert found is not None and (found.kind, found.s) == ("overturning", pytest.approx(0.5))
