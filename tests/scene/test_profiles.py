"""Profiles and rows of histories: expressions, tables, files that become part of the scene."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.scene.identity import difference
from receding_fenicsx.scene.profiles import evaluate

pytestmark = pytest.mark.one_rank

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()
GAP = '[[load]]\nname = "g"\nedge = "bottom"\ngap = 0.1\n[history.constant]\ng = 1.0\n'


@pytest.mark.parametrize(
    "text",
    [
        "-2, 0.0\n0, 0.1\n2, 0.0\n",
        "measured on Monday\n\nvalue ; s ; x\nmm;s;mm\n0;1;-2\n0.1;2;0\n0;3;2\n",
        "Gap,X\n0,-2\n0.1,0\n0,2\n",
        '"x","gap / mm"\r\n-2,0\r\n0,0.1\r\n2,0\r\n',
        "\ufeffposition in mm, from the left\tgap\n-2\t0\n0\t.1\n2\t0",
    ],
)
@pytest.mark.parametrize(
    ("key", "found"),
    [
        ("contact.initial_gap", lambda scene: scene.contacts[0].initial_gap),
        ("contact.friction", lambda scene: scene.contacts[0].friction),
        ("contact.friction.backward", lambda scene: scene.contacts[0].friction["backward"]),
        ("history.initial_slip", lambda scene: scene.history.initial_slip),
        ("load.g.gap", lambda scene: scene.loads[-1].gap),
    ],
)
def test_a_profile_is_read_from_a_file_beside_the_scene(
    text: str, key: str, found: Any, tmp_path: Path
) -> None:
    (tmp_path / "scene.toml").write_text(BLOCK + GAP)
    (tmp_path / "profile.csv").write_text(text)
    scene = rf.read_scene(tmp_path / "scene.toml", [f'{key}={{file = "profile.csv"}}'])
    profile = found(scene)
    assert np.allclose(evaluate(profile, np.array([-2.0, -1.0, 0.0, 2.0])), [0.0, 0.05, 0.1, 0.0])
    # the scene stands by itself from then on
    assert rf.from_toml(rf.to_toml(scene)) == scene


def test_table_is_linear_inside_and_constant_outside() -> None:
    table = {"x": [0.0, 1.0, 3.0], "value": [1.0, 2.0, 0.0]}
    np.testing.assert_allclose(
        evaluate(table, [-5.0, 0.5, 2.0, 9.0]), [1.0, 1.5, 1.0, 0.0], rtol=1e-15
    )
    np.testing.assert_array_equal(evaluate(0.25, np.zeros((2, 3))), np.full((2, 3), 0.25))


def test_a_curved_gap_of_fewer_points_than_nodes_is_warned_of() -> None:
    def found(points: int, gap: str = "x**2 / 10", *more: str) -> list[str]:
        x = np.linspace(-2.0, 2.0, points)
        table = f"{{x = {x.tolist()}, value = {evaluate(gap, x).tolist()}}}"
        changes = ["mesh.contact_elements=80", f"contact.initial_gap={table}", *more]
        return rf.scene_warnings(rf.from_toml(BLOCK, changes))

    # 161 nodes, 0.025 apart
    (line,) = found(51)
    assert "points 0.08 apart, nodes are 0.025 apart" in line and "\n" not in line
    assert found(106) and not found(109)  # 1.5 times as far
    assert not found(51, "x**2 / 10", "contact.span=[-0.2, 0.2]")  # few of its points
    # a wedge and a polygon of few corners are meant so
    assert not found(51, "0.1 * abs(x)") and not found(7) and found(8)


PYTHON = {name: getattr(math, name) for name in "pi sqrt sin cos exp log tanh".split()}
PYTHON |= {"where": lambda test, yes, no: yes if test else no, "min": min, "max": max, "abs": abs}


@pytest.mark.parametrize(
    "text",
    [
        *("2", "-x**2/3 + pi", "x*y - (x - 1)*+2", "min(x, 0.5, y) + max(x, -0.25)"),
        *("abs(x) + sqrt(abs(x))", "sin(x) + cos(y)*tanh(x)", "exp(-x) + log(2 + x)"),
        *("where(x > 0, 1, 2)", "(-0.5 <= x < 0.5) + (x == 1)", "2*(x != y)", "  1e-3 "),
        *("where(x, 1, 2)", "(x >= 0.25) + 2*(x > -0.5) + 4*(x <= 0.25)"),
    ],
)
def test_expression_has_pythons_value(text: str) -> None:
    x = np.array([-1.0, -0.5, 0.0, 0.25, 1.0])
    y = np.array([0.5, -0.5, 2.0, 0.25, -1.0])
    wanted = [eval(text.strip(), PYTHON, {"x": a, "y": b}) for a, b in zip(x, y, strict=True)]
    np.testing.assert_allclose(evaluate(text, x, y), wanted, rtol=1e-15, atol=1e-16)


def test_long_texts_are_refused_or_right_but_never_crash() -> None:
    text = "+".join(400 * ["x"])
    np.testing.assert_allclose(evaluate(text, np.array([0.5])), [200.0])
    for wrong, words in (
        (999 * "-" + "x", "nested too deeply|not an expression"),
        ("1" + 400 * "0", "not a finite number"),
        ("\0", "not an expression"),
    ):
        with pytest.raises(rf.InputError, match=words):
            evaluate(wrong, np.array([0.5]))


# -- rows of a table history from text files -------------------------------------------------------

SIGNALS = Path(__file__).with_name("signals.toml").read_text()
ROWS = ((1.0, 0.25), (1.5, -0.5), (1.0, 0.5))
FILE = 'rows = {file = "signal.csv"}\n'
LOOP = 'cycle_rows = {file = "signal.csv"}\n'


def read(folder: Path, text: str, history: str = FILE, body: str = SIGNALS) -> rf.Scene:
    """Read a scene whose history comes from a file of some text."""
    (folder / "signal.csv").write_text(text, encoding="utf-8")
    return rf.from_toml(f"{body}{history}", folder=folder)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n", ""),
        ("P Q\n 1   0.25\n\n1.5  -0.5\n1 0.5 # the end\n", ""),
        (
            "rig three, by hand\n% 3 Hz\ntime [s], P [kN], Q (kN)\ns, kN, kN\n"
            "0, 1, 0.25\n1, 1.5, -0.5\n1, 1, 0.5\n",
            "",
        ),
        ("# T P Q\n0.0 1 0.25\n0.1 1.5 -0.5\n0.2 1 0.5\n", ""),
        # columns name those of a file without header and choose from a header
        ("0 0.25 1\n1 -0.5 1.5\n2 0.5 1\n", 'columns = ["time", "Q", "P"]\n'),
        ("P,room,Q\n1,20,0.25\n1.5,20,-0.5\n1,21,0.5\n", 'columns = ["P", "Q"]\n'),
        # the comment next to the numbers names them; 2_1 is no number
        ("# Q P\n# P Q\n1 0.25\n1.5 -0.5\n1 0.5\n", ""),
        ("P,2_1,Q\n1,20,0.25\n1.5,20,-0.5\n1,21,0.5\n", 'columns = ["P", "Q"]\n'),
        # a dwell is one row
        ("time,P,Q\n0,0,0\n1,0,0\n2,1,0.25\n3,1,0.25\n4,1.5,-0.5\n5,1,0.5\n5,1,0.5\n", ""),
    ],
)
def test_every_format_gives_the_same_rows(text: str, columns: str, tmp_path: Path) -> None:
    history = rf.history_from_scene(read(tmp_path, text, columns + FILE))
    assert history.load_names == ("P", "Q")
    assert history.path.tolist() == [[0.0, 0.0], *map(list, ROWS)]


def test_load_of_the_name_t_is_no_time(tmp_path: Path) -> None:
    scene = read(tmp_path, "t,P\n1,0\n0.5,1\n", body=SIGNALS.replace('"Q"', '"t"'))
    assert scene.history.columns == ("t", "P")


def test_measured_block_is_closed_from_its_end_to_its_beginning(tmp_path: Path) -> None:
    text = "P,Q\n1,0.25\n1.5,-0.5\n1.25,0.5\n"
    history = rf.history_from_scene(read(tmp_path, text, LOOP))
    assert history.path.tolist() == [[0, 0], [1.25, 0.5]]
    assert history.loop.tolist() == [[1.25, 0.5], [1, 0.25], [1.5, -0.5], [1.25, 0.5]]
    (tmp_path / "loop.csv").write_text("Q,P\n0.25,1\n-0.5,1.5\n0.5,1.25\n")
    both = rf.history_from_scene(read(tmp_path, text, FILE + LOOP.replace("signal", "loop")))
    assert both.path.shape == (4, 2) and np.array_equal(both.loop, history.loop)


def test_scene_holds_the_rows_and_notices_another_file(tmp_path: Path) -> None:
    scene = read(tmp_path, "P,Q\n1,0.25\n1.5,-0.5\n1,0.5\n")
    assert rf.from_toml(rf.to_toml(scene), folder=tmp_path / "elsewhere") == scene
    other = read(tmp_path, "P,Q\n1,0.25\n1.5,-0.5000001\n1,0.5\n")
    assert difference(scene, other) == "[history] rows"
