"""Profiles: tables, and files that become part of the scene."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.toml_file import from_toml, read_scene, to_toml

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()


@pytest.mark.parametrize(
    "text", ["-2, 0.0\n0, 0.1\n2, 0.0\n", "# x  value\n-2 0\n0 0.1 # here\n2 0\n"]
)
@pytest.mark.parametrize("key", ["contact.initial_gap", "contact.friction", "history.initial_slip"])
def test_a_profile_is_read_from_a_file_beside_the_scene(
    text: str, key: str, shared_tmp_path: Path
) -> None:
    folder = shared_tmp_path / str(MPI.COMM_WORLD.rank)
    folder.mkdir()
    (folder / "scene.toml").write_text(BLOCK)
    (folder / "profile.csv").write_text(text)
    scene = read_scene(folder / "scene.toml", [f'{key}={{file = "profile.csv"}}'])
    owner = scene.history if key.startswith("history") else scene.contacts[0]
    profile = getattr(owner, key.split(".")[1])
    assert np.allclose(evaluate(profile, np.array([-2.0, -1.0, 0.0, 2.0])), [0.0, 0.05, 0.1, 0.0])
    # the scene stands by itself from then on
    assert from_toml(to_toml(scene)) == scene


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, ["no such file"]),
        ("1 2 3\n4 5 6\n", ["3 column(s)", "x and value"]),
        ("one two\n", ["columns of numbers"]),
        ("", ["0 column(s)"]),
        ("1 0.1\n0 0.2\n", ["[contact] initial_gap"]),
    ],
)
def test_a_file_that_is_no_profile_is_refused_in_one_line(
    content: str | None, words: list[str], tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "gap.csv").write_text(content)
    with pytest.raises(InputError) as caught:
        from_toml(BLOCK, ['contact.initial_gap={file = "gap.csv"}'], tmp_path)
    text = str(caught.value)
    assert "\n" not in text and "contact" in text
    assert all(word in text for word in words), text


def test_table_is_linear_inside_and_constant_outside() -> None:
    table = {"x": [0.0, 1.0, 3.0], "value": [1.0, 2.0, 0.0]}
    np.testing.assert_allclose(
        evaluate(table, [-5.0, 0.5, 2.0, 9.0]), [1.0, 1.5, 1.0, 0.0], rtol=1e-15
    )
    np.testing.assert_array_equal(evaluate(0.25, np.zeros((2, 3))), np.full((2, 3), 0.25))
