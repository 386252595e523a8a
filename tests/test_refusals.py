"""Every message of a refusal, whole, as the command line prints it: the rows of refusals.txt.

A row is the name of a scene and changes of it, then the message, then perhaps its nearest neighbour
that is accepted. A message that begins with "warning: " is one of a scene that is accepted. Changes
are parted by " & ": values as of --set, tables whose lines are parted by "; ", ">" and a file with
its lines, a text "->" its replacement, or "$" and the command, which is check if none is named.
"""

import re
import shlex
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import pytest
from bodies import ONCE, block

import receding_fenicsx as rf
from receding_fenicsx import cli

comm = MPI.COMM_WORLD
DEMOS = Path(__file__).parents[1] / "demos"
BLOCK = (DEMOS / "block.toml").read_text()
TWO = (
    BLOCK.replace("[body]", '[[body]]\nname = "a"\nposition = [0.0, 1.0]')
    .replace('edge = "bottom"', 'edge = "a.bottom"\nagainst = "b.top"')
    .replace('edge = "top"', 'edge = "a.top"')
    + '[[body]]\nname = "b"\n[[support]]\nedge = "b.bottom"\nfix = "xy"\n'
)
"""The block on a second one."""
FAR = rf.Scene(
    body=rf.Body(shape="half-plane", width=3.0),
    contacts=(rf.Contact(initial_gap="x**2 / 100"),),
    loads=(rf.Load("p0", "far", platen=True, force=(0.0, -1.0)),),
    history=rf.HistoryOptions(cycles=1),
)
BARE = BLOCK[: BLOCK.index("[history]")]
SHEARED = BARE + '[[load]]\nname = "Q 1"\nedge = "top"\ntraction = [1.0, 0.0]\n'
PLANES = (DEMOS / "half_planes.toml").read_text()
REFUSED = Path(__file__).with_name("refused")
HARMONIC, OWN, IMPORT = (
    REFUSED.joinpath(f"{name}.toml").read_text() for name in ("harmonic", "own", "import")
)
"""A history, a body of a mesh file, and what is imported."""
LAYERS = replace(
    block(loads=(rf.Load("p", "b.top", pressure="1 + 0.2*x"),), history=ONCE),
    body=rf.Body("a", height=0.5),
    others=(rf.Body("b", height=0.5, position=(0.0, 0.5)),),
    contacts=(rf.Contact("a.bottom", friction=0.4),),
)
SPRUNG = replace(
    LAYERS,
    contacts=(rf.Contact("b.bottom", (-0.5, 0.5), 0.3, initial_gap=0.2, against="a.top"),),
    supports=(rf.Support("xy", edge="a.bottom"),),
    springs=(rf.Spring("b.bottom", (1.0, 1.5), 1.0, 1.0, against="a.top"),),
)
PAIR = replace(
    LAYERS,
    body=rf.Body("upper", width=4.0, position=(0.0, 2.0)),
    others=(rf.Body("lower", width=8.0, height=2.0),),
    contacts=(rf.Contact("upper.bottom", against="lower.top"),),
    loads=(rf.Load("p0", "upper.top", (-1.0, 1.0), pressure=1.0),),
)
PLATEN = rf.Load("P", "top", platen=True, force=(0.0, -1.0))
SINK = rf.Load("w", "top", displacement=("free", -1.0))
HELD = (rf.Support("xy", edge="lower.bottom"),)
WHEEL = (
    rf.Load("weight", body_force=(0.0, -0.05)),
    rf.Load("wheel", "top", (-0.5, 0.5), pressure=1.0, travel=(-1.0, 1.0), steps=4),
)
FILES = {path.name: path.read_text() for path in REFUSED.joinpath("files").iterdir()}
"""What the scenes may name."""
SCENES: dict[str, str | rf.Scene] = {
    "none": "",
    "block": BLOCK,
    "two": TWO,
    "far": FAR,
    "round": BLOCK.replace("[-1.0, 1.0]", "[0.0, 1.0]").replace("plane strain", "axisymmetric"),
    "bare": BARE,
    "sheared": SHEARED,
    "harmonic": SHEARED + HARMONIC,
    "bolt": TWO + '[[bolt]]\nname = "b"\nhead = "a.left"\nnut = "b.left"\npreload = 1.0\n',
    "small": block(),
    "platen": block(load=PLATEN),
    "feet": block(
        load=replace(PLATEN, edge="right"),
        contacts=(rf.Contact(), rf.Contact("top", (1.0, 2.0))),
    ),
    "driven": block(load=rf.Load("d", "right", displacement=(1.0, "free"))),
    "sink": block(load=SINK),
    "sides": block(
        loads=tuple(rf.Load("L", edge, (-0.25, 0.25), pressure=1.0) for edge in ("left", "right"))
    ),
    "gap": block(
        load=rf.Load("P", "bottom", gap=0.01),
        supports=(rf.Support("y", "top"),),
        history=ONCE,
    ),
    "wheel": block(
        contacts=(rf.Contact(friction=0.2),),
        loads=WHEEL,
        history=rf.HistoryOptions(kind="travel", cycles=2, constant={"weight": 1.0}),
    ),
    "layers": LAYERS,
    "tied": replace(LAYERS, ties=(rf.Tie("b.bottom", against="a.top"),)),
    "sprung": SPRUNG,
    "pair": PAIR,
    "held pair": replace(PAIR, supports=HELD),
    "fit": replace(
        PAIR,
        contacts=(replace(PAIR.contacts[0], interference=0.1),),
        supports=HELD,
        loads=(),
    ),
    "pushed": replace(
        PAIR,
        contacts=(replace(PAIR.contacts[0], friction=0.0),),
        supports=HELD,
        loads=(rf.Load("q", "upper.left", pressure=1.0),),
    ),
    "own": OWN,
    "coated": OWN.replace("own.geo", "two.geo") + "[material.coat]\nyoung = 10.0\n",
    "planes": PLANES,
    "shaken": rf.to_toml(
        block(
            loads=(
                rf.Load("press", "top", pressure=1.0),
                rf.Load("shear", "top", traction=(1.0, 0.0)),
            ),
            contacts=(rf.Contact(friction=0.5),),
            history=rf.HistoryOptions(load="shear", constant={"press": 1.0}, minimum=-1.0),
        )
    )
    + "[shakedown]\nrange = [{shear = 1.0}, {shear = -1.0}]\n",
    "fatigue": PLANES
    + '[[probe]]\nname = "edge"\nedge = "lower.top"\n[fatigue]\nyield_stress = 1.0\n',
    "import": IMPORT,
    "signal": SHEARED + '[history]\nkind = "table"\nrows = {file = "signal.csv"}\n',
    "gap file": BLOCK.replace("gap = 0.0", 'gap = {file = "gap.csv"}'),
}


def text_of(base: str) -> str:
    scene = SCENES[base]
    return scene if isinstance(scene, str) else rf.to_toml(scene)


def changed(base: str, changes: str) -> tuple[dict[str, str], list[str], list[str]]:
    """Return the files of a scene, the values to be set, and the words of the command."""
    text, values, command, files = text_of(base), list[str](), ["check"], dict(FILES)
    for change in changes.split(" & "):
        if change.startswith("$ "):
            command = ["none"] * (base == "none") + shlex.split(change[2:])
        elif " -> " in change:
            old, new = change.split(" -> ")
            assert old in text
            text = text.replace(old, new.replace("; ", "\n"), 1)
        elif change.startswith("["):
            text += "\n" + change.replace("; ", "\n") + "\n"
        elif change.startswith("> "):
            _, name, part = change.split(" ", 2)
            files[name] = part.replace("; ", "\n") + "\n"
        elif change:
            values.append(change)
    return files | {"scene.toml": text}, values, command


def rows() -> list[tuple[str, str, str, str]]:
    """Return scene, changes, message and neighbour of all rows."""
    lines = Path(__file__).with_name("refusals.txt").read_text(encoding="utf-8").splitlines()
    found: list[tuple[str, str, str, str]] = []
    for line in lines:
        if line.startswith("    ok: "):
            found[-1] = (*found[-1][:3], line[8:])
        elif line.startswith("    "):
            found[-1] = (*found[-1][:2], line[4:], "")
        elif line and not line.startswith("#"):
            base, _, changes = line.partition(": ")
            found.append((base, changes, "", ""))
    return found


ALL = rows()
WARNED = [row for row in ALL if row[2].startswith("warning: ")]
ROWS = [row for row in ALL if row not in WARNED]


def marks(base: str, message: str) -> list[pytest.MarkDecorator]:
    """Each rank reads a scene by itself; only what Gmsh says of a file depends on versions."""
    alone = [pytest.mark.one_rank] * message.startswith("scene.toml")
    return alone + [pytest.mark.once] * (base not in ("own", "coated"))


@pytest.mark.parametrize(
    ("base", "changes", "message"),
    [pytest.param(*row[:3], marks=marks(row[0], row[2])) for row in ROWS],
)
def test_what_breaks_a_rule_is_refused_by_its_whole_message(
    base: str,
    changes: str,
    message: str,
    shared_tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    files, values, (command, *options) = changed(base, changes)
    monkeypatch.chdir(shared_tmp_path)
    rf.on_root(comm, lambda: [Path(name).write_text(part) for name, part in files.items()])
    commands = [command]
    if command == "check" and not message.startswith("scene.toml"):
        commands.append("run")  # what is wrong with a body is said by both
    for each in commands:
        out = [] if each == "check" or "--out" in options else ["--out", "out"]
        sets = [f"--set={value}" for value in values]
        words = options if base == "none" else [each, "scene.toml", *sets, *options, *out]
        assert cli.main(words) == 2
        captured = capsys.readouterr()
        told = captured.err.replace(f"{shared_tmp_path}/", "")
        assert captured.out == ""
        told = re.sub(r"^\d\d:\d\d:\d\d .*\n", "", told, flags=re.M)  # that code is compiled
        assert told == (f"receding-fenicsx: error: {message}\n" if comm.rank == 0 else "")
        # rank 0 writes, and another rank may come to look when it has gone on
        assert comm.rank > 0 or {path.name for path in shared_tmp_path.iterdir()} == {*files}


@pytest.mark.once
@pytest.mark.one_rank
@pytest.mark.parametrize(("base", "changes"), [(row[0], row[3]) for row in ALL if row[3]])
def test_its_nearest_neighbour_is_accepted_without_a_warning(base: str, changes: str) -> None:
    files, values, _ = changed(base, changes)
    scene = rf.from_toml(files["scene.toml"], values)
    assert rf.from_toml(rf.to_toml(scene)) == scene and rf.scene_warnings(scene) == []


@pytest.mark.once
@pytest.mark.one_rank
@pytest.mark.parametrize(("base", "changes", "message"), [row[:3] for row in WARNED])
def test_what_is_inaccurate_is_warned_of(base: str, changes: str, message: str) -> None:
    files, values, _ = changed(base, changes)
    (line,) = rf.scene_warnings(rf.from_toml(files["scene.toml"], values))
    assert f"warning: {line}" == message
