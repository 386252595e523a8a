import copy
import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import receding_fenicsx as rf
from receding_fenicsx.scene.model import TABLE_OF
from receding_fenicsx.scene.toml_file import apply_override
from receding_fenicsx.scene.toml_reader import scene_of

pytestmark = pytest.mark.one_rank

DEMOS = Path(__file__).parents[2] / "demos"
BLOCK = (DEMOS / "block.toml").read_text()


def block(*overrides: str, extra: str = "") -> rf.Scene:
    return rf.from_toml(BLOCK + extra, overrides)


def test_written_scene_reads_back_equal() -> None:
    title = 'title="a \\"quoted\\" \\u00e9\\n\\u007f title"'
    scene = block(title, "output.cycles=[]", "material.young=210e9")
    text = rf.to_toml(scene)
    assert rf.from_toml(text) == scene and rf.to_toml(rf.from_toml(text)) == text
    assert rf.from_toml(text).output.cycles == () != block().output.cycles


def test_all_errors_of_a_scene_are_told_one_a_line() -> None:
    """Of types at once; of rules those that do not follow from another one."""
    types = ["mesh.degree=0", "contact.frictoin=1", "load.p0.span=[1]", "history.until=end"]
    mean = "[shakedown] mean: unknown load 'q'"
    for changes, beginnings in (
        (types, ["[mesh] degree:", "[contact]:", "load 'p0' span:", "[history] until:"]),
        (
            ["load.p0.pressure=0", "mesh.contact_elements=7"],
            ["[mesh] contact_elements: 7 is odd", mean, "load 'p0' pressure"],
        ),
        (["history.minimum=2"], [mean, "[history] minimum"]),
    ):
        with pytest.raises(rf.InputError) as caught:
            block(*changes, extra="[shakedown]\nmean = {q = 1}")
        for line, begins in zip(str(caught.value).splitlines(), beginnings, strict=True):
            assert line.startswith(begins)


@pytest.mark.parametrize("kind", sorted({*TABLE_OF.values()} - {"material"}))
@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_number_of_a_table_is_its_place_in_errors_and_changes(kind: str, number: int) -> None:
    for named in (False, True):
        tables: list[dict[str, Any]] = [{"name": f"n{k}"} if named else {} for k in range(1, 4)]
        tables[number - 1]["wrong"] = 1
        with pytest.raises(rf.InputError) as caught:
            scene_of({kind: tables})
        (line,) = (line for line in str(caught.value).splitlines() if "'wrong'" in line)
        place = f"{kind} 'n{number}'" if named else f"[[{kind}]] number {number}"
        assert line.startswith(f"{place}: unknown key 'wrong'")
    raw: dict[str, Any] = {kind: [{"name": "twin", "key": k} for k in range(3)]}
    for key in (f"{kind}.{number}.key", f"{kind}.twin.{number}.key"):
        changed = copy.deepcopy(raw)
        apply_override(changed, f"{key}=9")
        assert [each["key"] for each in changed[kind]] == [
            9 if k == number - 1 else k for k in range(3)
        ]
    for beyond in (0, 4):
        with pytest.raises(rf.InputError, match=f"--set {kind}"):
            apply_override(raw, f"{kind}.{beyond}.key=9")


def test_many_errors_of_one_kind_are_counted() -> None:
    rows = ", ".join(30 * ["['x']"])
    with pytest.raises(rf.InputError) as caught:
        block(f"history.rows=[{rows}]", "solver.method=2020-01-01")
    *first, last = str(caught.value).splitlines()
    assert len(first) == 20 and last == "scene: 11 more errors"
    assert first[0] == '[history] rows entry 1 entry 1: must be a number, not "x"'


def test_values_of_scenes_made_in_python_are_checked_like_those_of_files() -> None:
    scene = block()
    for changes, words in (
        ({"mesh": rf.MeshOptions(cell="hexagon")}, r'\[mesh\] cell: "hexagon" is unknown'),
        ({"contacts": (rf.Contact(span=(1.0,)),)}, r"\[contact\] span: must be a pair"),  # type: ignore[arg-type]
        ({"loads": (rf.Load("p", None, pressure=1.0),)}, "load 'p' edge: must be a string"),  # type: ignore[arg-type]
    ):
        with pytest.raises(rf.InputError, match=words):
            rf.validate(dataclasses.replace(scene, **changes))
    numpy = rf.MeshOptions(contact_elements=np.int64(8), growth=np.float32(1.5))  # type: ignore[arg-type]
    rf.validate(dataclasses.replace(scene, mesh=numpy))


@pytest.mark.parametrize("name", ["/dev/zero", "pipe", ".", "bytes"])
@pytest.mark.parametrize("key", ["scene", "rows", "friction", "stiffness", "nodes", "system"])
def test_what_is_no_regular_file_of_text_is_not_read(key: str, name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    path = tmp_path / name
    text = BLOCK
    if key == "rows":
        text = BLOCK[: BLOCK.index("[history]")] + "[history]\nkind = 'table'\n"
        text += f"rows = {{file = '{path}'}}\n"
    elif key == "friction":
        text = BLOCK.replace("friction = 0.35", f"friction = {{file = '{path}'}}")
    elif key in ("stiffness", "nodes"):
        (tmp_path / "nodes.csv").write_text("node,x,y\n1,0,0\n")
        files = {"stiffness": "K.mtx", "nodes": "nodes.csv", key: str(path)}
        text = "".join(f"{name} = '{file}'\n" for name, file in files.items()) + "free = 3\n"
        text += "[[contact]]\nnodes = [1]\nnormal = [0.0, 1.0]\n"
        text += "[[load]]\nname = 'P'\nforces = 'P.txt'\n"
    scene = tmp_path / "scene.toml"
    scene.write_text(text)
    words = "it is a |is a folder|no such file|is not a text file|is damaged"
    with pytest.raises(rf.InputError, match=words) as caught:
        if key == "system":
            rf.read_system(path)
        elif key in ("stiffness", "nodes"):
            rf.import_system(scene)
        else:
            rf.read_scene(path if key == "scene" else scene)
    assert str(path) in str(caught.value)


def test_points_of_a_segment_are_evenly_spaced_and_include_its_middle_exactly() -> None:
    line = rf.Probe("line", segment=((-0.7, 0.0), (0.7, 1.0)), count=3)
    assert line.coordinates == ((-0.7, 0.0), (0.0, 0.5), (0.7, 1.0))
    fine = rf.Probe("fine", segment=((0.1, 0.0), (0.3, 0.9)), count=1000)
    steps = np.diff(np.array(fine.coordinates), axis=0)
    assert np.abs(steps - [0.2 / 999, 0.9 / 999]).max() < 1e-15
    assert fine.coordinates[-1] == (0.3, 0.9)
