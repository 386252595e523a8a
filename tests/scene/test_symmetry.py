import dataclasses
from pathlib import Path
from typing import Any

import pytest

from receding_fenicsx.scene.model import Load, Material, Scene, Spring, Support
from receding_fenicsx.scene.symmetry import is_mirror_symmetric
from receding_fenicsx.scene.toml_file import from_toml
from receding_fenicsx.scene.validate import validate

pytestmark = pytest.mark.one_rank

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()


def block(*overrides: str) -> Scene:
    return from_toml(BLOCK, overrides)


@pytest.mark.parametrize(
    "overrides",
    [
        ["contact.friction=0.3 + 1e-6*x"],
        ["contact.friction={x=[-1, 0, 2], value=[0.1, 0.4, 0.1]}"],
        ["contact.initial_gap=0.01*(x + 2)"],
        ["contact.span=[-1.5, 1.25]"],
        ["load.p0.span=[-1.0, 1.25]"],
        ["load.p0.pressure=1 + 0.1*x"],
        ["load.p0.edge=left", "load.p0.span=[-0.5, 0.5]"],
        ["contact.edge=right"],
        ["history.initial_slip=1e-3*x**2"],
        ["history.initial_slip=1e-3"],
    ],
)
def test_scenes_with_a_left_and_a_right_are_not_symmetric(overrides: list[str]) -> None:
    assert not is_mirror_symmetric(block(*overrides))


@pytest.mark.parametrize(
    ("part", "symmetric"),
    [
        ({"platen": True, "force": (0.0, -1.0)}, True),
        ({"platen": True, "force": (0.3, -1.0)}, False),
        ({"platen": True, "force": (0.3, 0.0)}, False),
        ({"displacement": ("0.1*x", -0.2)}, True),
        ({"displacement": (0.1, -0.2)}, False),
        ({"displacement": ("free", "0.1*x")}, False),
        ({"pressure": "1 + x"}, False),
        ({"traction": ("x", "-1 - x**2")}, True),
        ({"traction": ("x**2", -1.0)}, False),
        ({"traction": ("x", "x")}, False),
    ],
)
def test_load_is_symmetric_when_nothing_of_it_goes_to_a_side(part: dict, symmetric: bool) -> None:
    scene = dataclasses.replace(block(), loads=(Load("p0", "top", **part),))
    validate(scene)
    assert is_mirror_symmetric(scene) == symmetric


@pytest.mark.parametrize(
    ("held", "symmetric"),
    [
        ((Support("x", edge="left"), Support("x", edge="right")), True),
        ((Support("xy", edge="left"), Support("yx", edge="right")), True),
        ((Support("x", edge="left"), Support("y", edge="right")), False),
        ((Support("x", edge="left"),), False),
        ((Support("xy", edge="top"),), True),
        ((Support("x", point=(0.0, 1.0)),), True),
        ((Support("x", point=(-1.0, 1.0)), Support("x", point=(1.0, 1.0))), True),
        ((Support("x", point=(-1.0, 1.0)), Support("x", point=(1.0, 0.5))), False),
        ((Spring("top", (-2.0, -1.0), 1.0), Spring("top", (1.0, 2.0), 1.0)), True),
        ((Spring("top", (1.0, 2.0), 1.0),), False),
        ((Spring("left", (0.0, 0.5), 1.0), Spring("right", (0.0, 0.5), 1.0)), True),
    ],
)
def test_supports_and_springs_need_their_images(
    held: tuple[Support | Spring, ...], symmetric: bool
) -> None:
    parts: dict[str, Any] = {"springs" if isinstance(held[0], Spring) else "supports": held}
    scene = dataclasses.replace(block("load.p0.span=[-0.5, 0.5]"), **parts)
    assert is_mirror_symmetric(scene) == symmetric


@pytest.mark.parametrize(("angle", "symmetric"), [(30.0, False), (90.0, True)])
def test_fibres_of_any_body_lie_along_or_across(angle: float, symmetric: bool) -> None:
    fibres = Material(8.0, 0.25, "plane stress", name="b", young_2=2.0, shear=0.7, angle=angle)
    scene = block("load.p0.span=[-0.5, 0.5]")
    for parts in ({"material": fibres}, {"materials": (fibres,)}):
        assert is_mirror_symmetric(dataclasses.replace(scene, **parts)) == symmetric
