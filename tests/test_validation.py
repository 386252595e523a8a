"""The cores of the validation demos, against what is known."""

import runpy
from pathlib import Path
from typing import Any

import pytest

from receding_fenicsx import reference

DEMOS = Path(__file__).parent.parent / "demos"


def demo(name: str) -> dict[str, Any]:
    """Functions and numbers of a demo."""
    return runpy.run_path(str(DEMOS / f"{name}.py"))


@pytest.mark.parametrize(
    ("known", "width"), [(reference.BLOCK, 4.0), *((layer, 8.0) for layer in reference.LAYERS)]
)
def test_frictionless_pressure_is_right_to_1e_4_and_half_width_to_1e_3(
    known: reference.Pressed, width: float
) -> None:
    block = demo("frictionless_block")
    record = block["solve"](known, width, 160, 1.1)
    if record is not None:
        # 40 quadratic elements on h: 321 nodes under the block
        centre, profile, half_width = block["errors"](known, record)
        assert centre < 1e-4
        assert profile < 3e-4
        assert half_width < 1e-3
