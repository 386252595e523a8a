"""The layer's integral equation by itself, and against values computed elsewhere."""

import pytest

from receding_fenicsx.reference.closed_forms import LAYER_ON_HALF_PLANE, LAYERS
from receding_fenicsx.reference.layer import contact_half_width, double_half_widths


@pytest.mark.parametrize("known", LAYERS)
def test_half_widths_on_a_rigid_plane_are_the_tabulated_ones(known) -> None:  # type: ignore[no-untyped-def]
    assert contact_half_width(known.load) == pytest.approx(known.half_width, rel=1e-7)


@pytest.mark.parametrize(("case", "c"), LAYER_ON_HALF_PLANE.items())
def test_half_widths_on_a_half_plane_are_the_tabulated_ones(
    case: tuple[float, str], c: float
) -> None:
    alpha, load = case
    ratio = (1.0 - alpha) / (1.0 + alpha)
    assert contact_half_width(0.0 if load == "line load" else 0.5, ratio) == pytest.approx(
        c, rel=1e-7
    )


def test_two_layers_have_the_limits_of_one() -> None:
    # a stiff second layer is a rigid plane, a thick one a half-plane, which a line load presses
    assert double_half_widths(0.5, 1e-9)[0] == pytest.approx(contact_half_width(0.5), rel=1e-8)
    first, second = double_half_widths(0.5, 1.0, 40.0)
    assert first == pytest.approx(contact_half_width(0.5, 1.0), rel=1e-3)
    assert second / 40.0 == pytest.approx(contact_half_width(0.0), rel=1e-3)
