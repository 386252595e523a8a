"""Mirror symmetry of scenes: the rows of symmetry.txt."""

from pathlib import Path

import pytest
from test_refusals import changed

import receding_fenicsx as rf
from receding_fenicsx.scene.symmetry import is_mirror_symmetric

ROWS = Path(__file__).with_name("symmetry.txt").read_text().splitlines()[1:]


@pytest.mark.one_rank
@pytest.mark.parametrize("row", ROWS)
def test_a_scene_is_symmetric_when_nothing_of_it_goes_to_a_side(row: str) -> None:
    answer, base, changes = row.replace(":", "", 1).split(" ", 2)
    files, values, _ = changed(base, changes)
    scene = rf.from_toml(files["scene.toml"], values)
    assert is_mirror_symmetric(scene) == (answer == "yes")
