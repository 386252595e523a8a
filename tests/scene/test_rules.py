"""Rules of scenes: what breaks one is refused by its key, its nearest neighbour is accepted."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()
TWO = (
    BLOCK.replace("[body]", '[[body]]\nname = "a"\nposition = [0.0, 1.0]')
    .replace('edge = "bottom"', 'edge = "a.bottom"\nagainst = "b.top"')
    .replace('edge = "top"', 'edge = "a.top"')
    + '[[body]]\nname = "b"\n[[support]]\nedge = "b.bottom"\nfix = "xy"\n'
)
"""The block on a second one."""
FAR = """
[body]
shape = "half-plane"
width = 3.0
[contact]
edge = "bottom"
initial_gap = "x**2 / 100"
[[load]]
name = "p0"
edge = "far"
force = [0.0, -1.0]
[history]
cycles = 1
"""
ROUND = BLOCK.replace("[-1.0, 1.0]", "[0.0, 1.0]").replace("plane strain", "axisymmetric")
PLATEN = '[[load]]\nname = "q"\nedge = "right"\nplaten = true\nforce = '
SPRING = '[[spring]]\nedge = "left"\n'
SEVERAL = (
    BLOCK.replace("[contact]", "[contact]\nspan = [-2.0, -1.0]")
    .replace("[[load]]", '[[contact]]\nedge = "bottom"\nspan = [1.0, 2.0]\n[[load]]', 1)
    .replace("[contact]", "[[contact]]", 1)
)
BOLT = '[[bolt]]\nname = "b"\nhead = "a.left"\nnut = "b.left"\npreload = 1.0\n'
TABLE = "contact.friction={"
REFINE = "mesh.refine=[{at="
LOAD = '[[load]]\nname = "p0"\nedge = "right"\n'
WEIGHT = '[[load]]\nname = "p0"\nbody_force = [0.0, -1.0]\n'
BARE = BLOCK[: BLOCK.index("[history]")]
SHEARED = BARE + '[[load]]\nname = "Q 1"\nedge = "top"\ntraction = [1.0, 0.0]\n'
HARMONIC = (
    SHEARED
    + """
[history]
kind = "harmonic"
[history.harmonic.p0]
mean = 1.0
amplitude = 0.5
[history.harmonic."Q 1"]
amplitude = 0.25
phase = 110
"""
)
BASES = {"block": BLOCK, "two": TWO, "far": FAR, "round": ROUND, "several": SEVERAL}
BASES |= {"bare": BARE, "sheared": SHEARED, "harmonic": HARMONIC}
HISTORY = "[history]\n"
POLYGON = '[history]\nkind = "table"\ncolumns = ["p0"]\nrows = '
PROBE = '[[probe]]\nname = "one"\n'
BOTH = '[history]\nload = "p0"\nconstant = {"Q 1" = 1.0}'
TENSION = '[[load]]\nname = "p0"\nedge = "far"\ntension = '
HELD = '[[support]]\nedge = "right"\nfix = "x"\n'
SHAKE = "shakedown.mean={p0=1.0} & "

RULES: list[tuple[str, str, str, str]] = [
    # base, what is added to it (refused), the words, the nearest that is accepted
    ("block", "body.width=0", "[body] width: must be positive", "body.width=2.1"),
    ("far", "body.datum=2.9", "2.9 is less than the width of the contact, 3", "body.datum=3.0"),
    ("far", "contact.interference=0.1", "[contact] interference: a half-plane moves", ""),
    ("far", "load.p0.span=[-1, 1]", "load 'p0' span: the far field of a half-plane has", ""),
    ("far", "load.p0.edge=bottom", "load 'p0' edge", "load.p0.edge=far"),
    ("far", "load.p0.force=[0.0, 0.0]", "load 'p0' force: is zero", "load.p0.force=[0.0, 1e-9]"),
    (
        "far",
        '[[support]]\npoint = [0.0, 5.0]\nfix = "x"',
        '[[support]] point: hold the edge "far" of a half-plane',
        '[[support]]\nedge = "far"\nfix = "x"',
    ),
    (
        "far",
        '[[load]]\nname = "b"\nbody_force = [0.0, -1.0]',
        "load 'b' body_force: a half-plane has no mesh",
        "",
    ),
    ("far", '[[load]]\nname = "t"\nedge = "far"\ntraction = [1.0, 0.0]', "far field of a", ""),
    ("block", '[[load]]\nname = "t"\nedge = "left"\ntension = 1.0', "load 't' tension", ""),
    ("round", PLATEN.replace("right", "top") + "[1.0, -1.0]", "along its axis only", ""),
    (
        "round",
        '[[load]]\nname = "w"\nedge = "left"\npressure = 1.0',
        'edge: "left" is the axis r = 0',
        '[[load]]\nname = "p0"\nedge = "right"\npressure = 1.0',
    ),
    ("block", SPRING, "[[spring]]: has no stiffness", SPRING + "normal = 1e-9"),
    ("block", SPRING + "normal = -1.0", "normal: must be 0 or more", SPRING + "tangential = 1.0"),
    (
        "block",
        "[[spring]]\npoint = [0.0, 1.1]\nx = 1.0",
        "point: (0, 1.1) lies outside the body",
        "[[spring]]\npoint = [0.0, 1.0]\nx = 1.0",
    ),
    (
        "two",
        '[[spring]]\nedge = "a.left"\nagainst = "a.right"\nnormal = 1.0',
        "against: must be an edge of another body",
        '[[spring]]\nedge = "a.left"\nagainst = "b.left"\nnormal = 1.0',
    ),
    (
        "two",
        '[[support]]\npoint = [0.0, 0.5]\nfix = "x"',
        "body: must name the body of the point; give one of a, b",
        '[[support]]\npoint = [0.0, 0.5]\nfix = "x"\nbody = "b"',
    ),
    (
        "two",
        "material.a={young=2.0} & material.b={density=1.0} & material.poisson=0.2",
        "[material] poisson: each body has a [material.NAME] of its own; remove poisson",
        "material.a={young=2.0} & material.poisson=0.2",
    ),
    ("two", "body.b.mesh=b.msh & body.b.datum=3.0", "datum: belongs to shape", ""),
    ("block", "history.kind=monotonic & history.minimum=0.2", 'is for kind = "cyclic" only', ""),
    ("block", HELD + 'body = "a"', "[[support]] body: is not for an edge; remove body", HELD),
    ("two", BOLT + "shortening = 1.0", "bolt 'b': has", BOLT),
    ("two", BOLT + "axis = [0.0, 0.0]", "bolt 'b' axis: has no", BOLT + "axis = [0.0, -1e-9]"),
    ("two", BOLT.replace("a.left", "a.lft"), "bolt 'b' head", BOLT),
    ("two", BOLT + "head_span = [0.0, 0.6]", "bolt 'b' head_span", BOLT + "head_span = [0.0, 0.5]"),
    ("two", BOLT.replace("b.left", "a.bottom"), "bolt 'b' nut: overlaps the contact", BOLT),
    ("two", BOLT.replace('"b"\nh', '"p0"\nh'), "bolt 'p0': a load or another bolt has", BOLT),
    (
        "two",
        '[[load]]\nname = "w"\nbody = "b"\nbody_force = [0.0, 0.0]',
        "load 'w' body_force: is zero everywhere",
        '[[load]]\nname = "p0"\nbody = "b"\nbody_force = [0.0, -1e-9]',
    ),
    (
        "two",
        2 * '[[load]]\nname = "w"\nbody = "b"\nbody_force = [0.0, -1.0]\n',
        "load 'w': has two of body_force on one body",
        '[[load]]\nname = "p0"\nbody = "b"\nbody_force = [0.0, -1.0]\n'
        '[[load]]\nname = "p0"\nbody = "a"\nbody_force = [0.0, -1.0]',
    ),
    (
        "block",
        '[[load]]\nname = "p0"\nedge = "top"\nspan = [0.9, 2.0]\npressure = 1.0',
        "load 'p0': two of its parts are a pressure on the same part",
        '[[load]]\nname = "p0"\nedge = "top"\nspan = [1.0, 2.0]\npressure = 1.0',
    ),
    (
        "block",
        '[[support]]\nedge = "top"\nfix = "y"',
        "load 'p0' edge: a support holds \"top\" in the direction",
        '[[support]]\nedge = "top"\nfix = "x"',
    ),
    ("block", '[[load]]\nname = "m"\nmode = 0', "load 'm' mode: must be at least 1", ""),
    ("block", '[[load]]\nname = "m"\nmode = 1', "[material] density: vibration modes need", ""),
    ("block", "material.poisson=0.5", "[material] poisson", "material.poisson=0.499"),
    ("block", TABLE + "x=[0], value=[0.3]}", "at least 2", TABLE + "x=[0, 1], value=[0.3, 0.3]}"),
    (
        "block",
        TABLE + "x=[1, 1], value=[0.3, 0.2]}",
        "increase",
        TABLE + "forward=0.3, backward=0.2}",
    ),
    ("block", WEIGHT + 'edge = "top"', "acts on a whole body; remove edge", ""),
    ("block", WEIGHT + "thermal_strain = 1.0", "load 'p0'", WEIGHT),
    (
        "block",
        "solver.branch=2 & solver.method=gauss-seidel",
        "load steps find one",
        "solver.branch=2",
    ),
    ("block", "solver.overshoot=0.1", "[solver] overshoot: was removed", ""),
    ("block", 'accuracy.numbers=["pressure"]', "unknown number 'pressure'; ", ""),
    ("block", "body.position=[0.0, 1e9]", "[body] position", "body.position=[0.0, 1.0]"),
    ("far", "body.height=2.0", "[body] height: a half-plane has none", ""),
    ("far", "material.kinematics=axisymmetric", "a half-plane is not axisymmetric", ""),
    ("far", '[[load]]\nname = "m"\nmode = 1', "half-planes have no vibration modes", ""),
    ("two", BOLT + '[[load]]\nname = "m"\nmode = 1', "modes need elastic bolts", ""),
    ("round", "body.position=[1.9, 0.0]", "make a ring from r = -0.1", "body.position=[0.0, 0.1]"),
    ("block", REFINE + "[1, -1], size=0.1}]", "at: is empty", REFINE + "[-1, 1], size=0.1}]"),
    ("block", REFINE + "1, size=0.1}] & mesh.cell=quadrilateral", "is for triangles", ""),
    ("block", "body.height=1e-4", "[body] height: 0.0001 is less than", "body.height=0.1"),
    ("block", "mesh.contact_elements=20000 & mesh.growth=1", "makes about", "mesh.growth=1"),
    ("two", "contact.against=a.top", "must name an edge of another body", "contact.against=b.top"),
    ("block", '[[load]]\nname = "p0"\npressure = 1.0', "the key 'edge' is missing", ""),
    (
        "block",
        LOAD + 'body = "a"\npressure = 1.0',
        "body: is for body_force",
        LOAD + "pressure = 1.0",
    ),
    ("block", LOAD + "pressure = 1e60", "load 'p0' pressure", LOAD + "pressure = 1e40"),
    ("block", WEIGHT.replace("0.0", "{x=[0, 1], value=[0, 1]}"), "a table runs along an edge", ""),
    ("block", SPRING + "point = [0.0, 0.5]\nnormal = 1.0", "has edge and point of", ""),
    ("block", "[[spring]]\nnormal = 1.0", "has none of edge, point; give exactly one", ""),
    ("block", '[[support]]\npoint = "A"\nfix = "x"', "a rectangle has no named points", ""),
    ("block", "history.until=limit & history.cycles=2", "needs at least", "history.until=limit"),
    ("block", "history.minimum=1.0", "[history]", "history.minimum=0.999"),
    ("block", "load.p0.pressure=0", "load 'p0' pressure: is zero", "load.p0.pressure=-1e-9"),
    ("block", "material.young=0", "[material] young", "material.young=1e-9"),
    ("block", "mesh.contact_elements=9", "9 is odd", "mesh.contact_elements=10"),
    ("block", "solver.steps_per_leg=0", "steps_per_leg", "solver.steps_per_leg=1"),
    ("block", "mesh.refinements=1", "refinements: is for bodies from", "mesh.refinements=0"),
    ("block", 'mesh.refine=[{at = "corners", size = 0.01}]', "no re-entrant corners", ""),
    ("block", "output.cycles=[401]", "cycle 401 does not occur", "output.cycles=[0, 400]"),
    ("block", "history.cycles=0", "[history] cycles", "history.cycles=1"),
    # numbers and names beyond use
    ("block", "load.p0.pressure=1e-300", "load 'p0' pressure: is zero everywhere", ""),
    ("block", 'body.mesh="a\\u0000b.msh"', "[body] mesh: holds a NUL character", ""),
    ("block", 'load.p0.name="a\\nb"', "[[load]] name: 'a\\nb' holds a character", ""),
    ("block", "output.samples_per_leg=2000000000", "must be at most 1000000, not 2000", ""),
    (
        "bare",
        "[history]\ncycles = 1000000000",
        "[history] cycles: requires a record of",
        '[history]\ncycles = 1000000000\nuntil = "steady"',
    ),
    # bodies of revolution, half-planes
    ("round", '[[support]]\nedge = "left"\nfix = "y"', '"left" is the axis', HELD),
    ("round", '[[support]]\npoint = [-1.0, 1.0]\nfix = "y"', "0 <= x <= 2", ""),
    ("round", "contact.edge=left", '"left" is the axis', ""),
    ("far", "load.p0.tension=1.0", "has force and tension", ""),
    # supports
    (
        "block",
        HELD + LOAD + "traction = [1.0, 0.0]",
        'a support holds "right" in the direction',
        HELD + LOAD + "traction = [1.0, -1.0]",
    ),
    # loads on bodies, bolts, springs, interference
    ("block", WEIGHT + 'body = "a"', "load 'p0' body: the scene has one body only", ""),
    ("two", BOLT.replace("preload", "shortening").replace("1.0", "0.0"), "shortening: must be", ""),
    ("two", BOLT + "tightening = [0.1]", "bolt 'b' tightening: is found from the preload", ""),
    ("two", BOLT.replace('"b"\nh', '" "\nh'), "[[bolt]] name: is missing or empty", ""),
    ("two", BOLT.replace('"b"\nh', '"interference"\nh'), "the name is reserved", ""),
    ("block", SPRING.replace("left", "lft") + "normal = 1.0", "[[spring]] edge: ", ""),
    ("block", SPRING + "span = [0.0, 3.0]\nnormal = 1.0", "reaches beyond edge", ""),
    ("block", "[[spring]]\npoint = [0.0, 1.0]\nnormal = 1.0", "normal: is not for a point", ""),
    ("block", "contact.interference=-0.1", "interference: is -0.1", ""),
    # refinements
    ("block", REFINE + "1, size=0.1, growth=1.0}]", "growth: must be at least 1.01", ""),
    # histories
    ("bare", HISTORY + 'load = "p1"', "no load is named 'p1'", ""),
    ("bare", HISTORY + "rows = [[1.0]]", 'kind = "table"', ""),
    ("bare", HISTORY + 'kind = "table"', "[history] columns: is missing", ""),
    ("bare", HISTORY + 'kind = "table"\ncolumns = ["p0"]', "[history] rows: is missing", ""),
    ("bare", POLYGON + '[[1.0]]\nload = "p0"', "[history] load", POLYGON + "[[1.0]]"),
    ("bare", POLYGON.replace('"p0"', '"p0", "p0"') + "[[1, 1]]", "twice", ""),
    ("bare", POLYGON + "[[1.0, 2.0]]", "rows row 1", ""),
    ("bare", POLYGON + "[[1.0], [1.0]]", "p0 = 1 occurs twice in a row", ""),
    (
        "bare",
        POLYGON + "[[1.0]]\ncycle_rows = [[0.5], [0.9]]",
        "ends at p0 = 0.9",
        POLYGON + "[[1.0]]\ncycle_rows = [[0.5], [1.0]]",
    ),
    ("bare", POLYGON + "[[1]]\ncycle_rows = [[0.5], [1]]\ncycles = 0", "at least 1", ""),
    ("sheared", HISTORY + 'load = "p0"', "load 'Q 1': is not driven", BOTH),
    ("sheared", HISTORY + 'kind = "cyclic"', "several loads", BOTH),
    (
        "harmonic",
        "history.harmonic.p0.amplitude=0 & history.harmonic.Q 1.amplitude=0",
        "no load has an amplitude",
        "history.harmonic.p0.amplitude=0",
    ),
    ("harmonic", "history.harmonic={}", "harmonic: is missing", ""),
    ("harmonic", "history.harmonic={p0={amplitude=1}}", "load 'Q 1': is not driven", ""),
    ("harmonic", "history.constant.p0=1", "'p0' varies", ""),
    ("harmonic", "history.constant={p0=1, 'Q 1'=1}", "names every load", ""),
    ("harmonic", "history.corners=3", "need 4", "history.corners=4"),
    ("harmonic", "history.maximum=2", '"cyclic" or "monotonic" only', ""),
    # probes
    ("block", "[[probe]]\npoint = [0.0, 0.0]", "[[probe]] number 1: the key 'name' is missing", ""),
    ("block", PROBE, "has none of point, points, segment, edge; give exactly one", ""),
    ("block", PROBE + "point = [0, 0]\ncount = 3", "count: belongs to a segment; remove it", ""),
    (
        "block",
        PROBE + "segment = [[0, 0], [1, 1]]",
        "count: a segment needs its number of points",
        PROBE + "segment = [[0, 0], [1, 1]]\ncount = 2",
    ),
    ("block", PROBE + "segment = [[0, 0], [0, 0]]\ncount = 2", "needs two different ends", ""),
    ("block", PROBE + "point = [0, 1.1]", "(0, 1.1) lies outside the body, -2 <= x", ""),
    ("round", PROBE + "point = [-0.1, 0]", "outside the body, 0 <= x <= 2", ""),
    ("block", "material.name=steel", "[material]: unknown key 'name'; remove it", ""),
    ("block", PROBE + 'point = [0, 0]\nbody = "a"', "one' body: the scene has one body only", ""),
    ("two", PROBE + "point = [0, 0]", "body: must name the body of the point; give one", ""),
    ("two", PROBE + 'point = [0, 0]\nbody = "a"', "'one': (0, 0) lies outside the body, -2", ""),
    # accuracy, load ranges
    ("block", "accuracy.tolerance=0", "must be positive, not 0", "accuracy.tolerance=0.9"),
    ("block", 'accuracy.numbers=["load_displacement[q]"]', "unknown load 'q'", ""),
    ("block", "accuracy.budget_seconds=0", "budget_seconds: must be positive", ""),
    ("block", SHAKE + "shakedown.range=[{sheer=1.0}]", "range: unknown load 'sheer'", ""),
]
"""Refused by the key that is named; the last column is the neighbour, or nothing at all."""


def built(base: str, change: str) -> rf.Scene:
    """Return a scene with values changed, or with tables added."""
    if change.startswith("["):
        return rf.from_toml(f"{BASES[base]}\n{change}\n")
    return rf.from_toml(BASES[base], change.split(" & ") if change else [])


@pytest.mark.parametrize(("base", "change", "words", "_"), RULES)
def test_what_breaks_a_rule_is_refused_by_its_key(
    base: str, change: str, words: str, _: str
) -> None:
    with pytest.raises(rf.InputError, match=re.escape(words)) as caught:
        built(base, change)
    # one line that begins with the place, and has no gap where a name or value should be
    assert re.match(r"\[|scene|\w+ '|'|\w+: |--set", str(caught.value))
    assert not re.search(
        r"\n|''|None|  |\(\)|nan\b(?!.*NaN)", str(caught.value).replace("--set ", "")
    )


@pytest.mark.parametrize(("base", "change"), sorted({(base, last) for base, *_, last in RULES}))
def test_its_nearest_neighbour_is_accepted(base: str, change: str) -> None:
    scene = built(base, change)
    assert rf.from_toml(rf.to_toml(scene)) == scene


@pytest.mark.parametrize(
    ("legs", "cycles", "sampled", "accepted"),
    [(2, 5, "all", True), (400, 5, "all", False), (2, 900, "all", False), (2, 900, None, True)],
)
def test_samples_of_all_legs_are_counted_in_the_size_of_a_record(
    legs: int, cycles: int, sampled: Literal["all"] | None, accepted: bool
) -> None:
    """A million samples a leg of 5 cycles of 321 nodes: of two legs the record is not too large."""
    rows = ((0.5,), (1.0,)) * (legs // 2)
    options = rf.HistoryOptions(
        "table", columns=("p0",), rows=((1.0,),), cycle_rows=rows, cycles=cycles
    )
    scene = replace(rf.from_toml(BLOCK), history=options, output=rf.OutputOptions(10**6, sampled))
    if accepted:
        assert rf.from_toml(rf.to_toml(scene)) == scene
    else:
        with pytest.raises(rf.InputError, match="samples_per_leg: requires a record of"):
            rf.from_toml(rf.to_toml(scene))
