"""Estimated against true space errors, over scenes of all kinds.

**Problem.** ``run --error`` and ``run --tolerance`` estimate the discretisation errors of headline
numbers from meshes of one family. How good are the estimates?

**Equations.** With numbers a_i on meshes coarser by r_i, the estimate is e = max |a_i - a_j| /
(r_j^p - r_i^p) over all pairs, p the median of the orders that three meshes show, limited to
[1/2, 8/5] (7/4 on graded meshes), and to 1 where a zone is not resolved.

**What to look for.** The share of numbers whose true error is within twice the estimate, and the
median of estimate over true error (``error_report.py`` makes the tables): for meshes of
``--error`` (2, 2.5 and 4 times coarser), of a search (2.5 and 6.25 times coarser) and of a graded
search. The hardest numbers are small dissipations whose zones the mesh hardly resolves.

Each mesh is solved once; ``levels/SCENE.json`` in --out keeps its numbers, from which an
interrupted run goes on. True values are those of meshes about twice as fine, graded where corners
are sharp, or computed otherwise. The difference between two such meshes counts as uncertainty:
errors within it are no failures, and those below twice of it have no ratio.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import csv
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

import error_report
import numpy as np

import receding_fenicsx as rf

DEMOS = Path(__file__).parents[1]


@dataclass(frozen=True)
class Kind:
    """A kind of mesh: cell, order, growth at 120 elements, graded towards ends of the contact."""

    cell: str = "triangle"
    degree: int = 2
    growth: float = 1.25
    graded: bool = False

    def __str__(self) -> str:
        """Name in the tables."""
        return f"{self.cell} {self.degree}{' graded' if self.graded else ''}"


TRIANGLES, GRADED = Kind(), Kind(graded=True)
QUADRILATERALS, LINEAR = Kind("quadrilateral", growth=1.3), Kind(degree=1, growth=1.3)
BOTH = (TRIANGLES, QUADRILATERALS)
BASE, FIRST = 120, 24
"""Contact elements at which a kind of mesh has its growth, and of the first mesh of a search."""


@dataclass(frozen=True)
class Case:
    """A scene, the meshes whose numbers are judged, and those that give the true values.

    Attributes:
        source: scene file, or a function that returns a scene.
        overrides: changes of the scene file.
        kinds: kinds of meshes.
        judged: contact elements of the meshes that are judged.
        limits: kinds and elements of the two meshes that give the true values.
        graded: contact elements of the judged graded meshes.
        edge: length of the contact edge of graded meshes.
        doubled: elements of a mesh file, which is refined uniformly.
        like: another scene that has the same true values.
        left_out: beginnings of numbers without limit.
    """

    source: str | Callable[[], rf.Scene] = "block.toml"
    overrides: tuple[str, ...] = ()
    kinds: tuple[Kind, ...] = (*BOTH, LINEAR)
    judged: tuple[int, ...] = (60, 120, 150, 240)
    limits: tuple[tuple[Kind, int], ...] = ((TRIANGLES, 480), (QUADRILATERALS, 480))
    graded: tuple[int, ...] = ()
    edge: float = 2.0
    doubled: int = 0
    like: str = ""
    left_out: tuple[str, ...] = ()

    def scene(self, kind: Kind, elements: int) -> rf.Scene:
        """Return the scene on a mesh; its cycles end in their limit."""
        of = self.source
        scene = rf.read_scene(DEMOS / of, self.overrides) if isinstance(of, str) else of()
        is_long = scene.history.until == "steady" and scene.history.cycles > 50
        history = replace(scene.history, until="limit" if is_long else None)
        scene = replace(scene, history=history, output=rf.OutputOptions(1, ()))
        if not self.doubled:
            mesh = replace(scene.mesh, cell=kind.cell, degree=kind.degree, growth=kind.growth)
            scene = replace(scene, mesh=replace(mesh, contact_elements=BASE))
        if kind.graded:
            scene = rf.scaled_mesh(scene, FIRST)
            scene = rf.graded_at_ends(scene, [self.edge / FIRST] * len(scene.contacts))
        return rf.scaled_mesh(scene, elements)


PAIR = """
[[body]]
name = "a"
position = [0.0, 2.0]
[[body]]
name = "b"
width = 8.0
height = 2.0
[material.a]
[material.b]
young = 2.0
[contact]
edge = "a.bottom"
against = "b.top"
friction = 0.35
[[load]]
name = "p0"
edge = "a.top"
span = [-1.0, 1.0]
pressure = 1.0
[[support]]
edge = "b.bottom"
fix = "xy"
[history]
cycles = 2
"""
"""The paper's block on a wider elastic one."""
OWN_MESH = """
Point(1) = {-2, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0};
Point(4) = {1, 1, 0}; Point(5) = {-1, 1, 0}; Point(6) = {-2, 1, 0};
For i In {1 : 6}
  Line(i) = {i, i % 6 + 1};
EndFor
Curve Loop(1) = {1 : 6};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1};
Physical Curve("loaded") = {4};
Physical Surface("body") = {1};
Field[1] = MathEval;
Field[1].F = "0.125 + 0.25 * y";
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
"""
"""The paper's block for gmsh: sizes grow by a quarter of the distance from the contact."""


@cache
def own_mesh() -> rf.Scene:
    """Return the paper's block on a mesh file of gmsh."""
    folder = Path(tempfile.mkdtemp())
    (folder / "block.geo").write_text(OWN_MESH)
    program = (
        "import gmsh; gmsh.initialize(); gmsh.open('block.geo'); "
        "gmsh.model.mesh.generate(2); gmsh.write('block.msh')"
    )
    command = [sys.executable, "-c", program]
    environment = rf.child_environment()
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    scene = rf.read_scene(DEMOS / "block.toml", ["mesh.contact_elements=32"])
    load = replace(scene.loads[0], edge="loaded", span=None)
    body = rf.Body(mesh=str(folder / "block.msh"))
    return replace(scene, body=body, loads=(load,), mesh=replace(scene.mesh, refinements=0))


def platen() -> rf.Scene:
    """Return the block as a body of revolution under a platen."""
    scene = rf.read_scene(DEMOS / "block.toml", [*ROUND, "contact.friction=0.3"])
    return replace(scene, loads=(rf.Load("p0", "top", platen=True, force=(0.0, -6.0)),))


def polygon(*overrides: str) -> Case:
    """Return the block sheared by a polygon of loads, whose numbers move in stairs."""
    overrides = ("history.cycles=2", *overrides)
    judged = (64, 80, 96, 112, 128, 144, 240)
    return Case("sheared_polygon.toml", overrides, BOTH, judged, CORNERS)


def sharp(file: str, *overrides: str) -> Case:
    """Return a scene with sharp corners in contact, on equal and on graded meshes."""
    return Case(file, overrides, BOTH[:1], (60, 100, 150), CORNERS, (100, 150, 200))


SHEARED = ("history.cycles=2", "contact.friction=0.8", "load.Q.force=[1.6, 0.0]")
LESS = ("history.cycles=2", "contact.friction=0.5", "load.Q.force=[1.0, 0.0]")
PUNCH = ("history.rows=[[1.0]]", "history.cycle_rows=[[0.4], [1.0]]", "history.cycles=2")
BLOCK, EXACT = "frictionless, narrow load", rf.reference.closed_forms.BLOCK
COMPUTED = {"centre_pressure": EXACT.p[0], "contact_half_width": EXACT.half_width}
"""Scene, and its limits that are known without finite elements."""
CORNERS = ((GRADED, 400), (GRADED, 320))
LARGEST = ("largest_pressure",)
"""Infinite at corners of two elastic bodies, which the program does not know to be singular."""
ROUND = ('material.kinematics="axisymmetric"', "load.p0.span=[0.0, 1.0]")
BLOCKS = {
    "the paper's block": (),
    "friction 0.2": ("contact.friction=0.2",),
    "friction 0.6": ("contact.friction=0.6",),
    "friction 0.2 + 0.1 x^2": ('contact.friction="0.2+0.1*x**2"',),
    "no friction": ("contact.friction=0.0",),
    "Poisson's ratio 0": ("material.poisson=0.0",),
    "Poisson's ratio 0.45": ("material.poisson=0.45",),
    "plane stress": ('material.kinematics="plane stress"',),
    "narrow load": ("load.p0.span=[-0.25, 0.25]",),
    "wide load": ("load.p0.span=[-1.5, 1.5]",),
    "twice as high": ("body.height=2.0",),
    "twice as long": ("body.width=8.0",),
    "round": ROUND,
    "round, friction 0.2": (*ROUND, "contact.friction=0.2"),
    "round, no friction, narrow load": (ROUND[0], "contact.friction=0", "load.p0.span=[0.0, 0.5]"),
    "round, friction 0.6": (*ROUND, "contact.friction=0.6"),
    "round, Poisson's ratio 0.45": (*ROUND, "material.poisson=0.45"),
    "round, twice as high": (*ROUND, "body.height=2.0"),
}
SCENES = {name: Case(overrides=overrides) for name, overrides in BLOCKS.items()} | {
    BLOCK: Case("frictionless_block.toml"),
    "round, under a platen": Case(platen),
    "polygon": polygon(),
    "polygon, Poisson's ratio 0.05": polygon("material.poisson=0.05"),
    "polygon, Poisson's ratio 0.3": polygon("material.poisson=0.3"),
    "polygon, friction 0.55": polygon("contact.friction=0.55", "load.Q.force=[1.1, 0.0]"),
    "polygon, weaker shear": polygon("load.Q.force=[1.15, 0.0]"),
    "sheared block, friction 0.5": sharp("sheared_block.toml", *LESS),
    "sheared block, friction 0.8": sharp("sheared_block.toml", *SHEARED),
    "punch, friction 0.1": sharp("punch.toml", "contact.friction=0.1", *PUNCH),
    "punch, friction 0.2": sharp("punch.toml", *PUNCH),
    "round punch, friction 0.2": sharp("punch_axisymmetric.toml", *PUNCH),
    "round punch, friction 0.4": sharp("punch_axisymmetric.toml", "contact.friction=0.4", *PUNCH),
    "layer": Case("layer.toml", (), BOTH[:1], (60, 96, 150), ((TRIANGLES, 320), (TRIANGLES, 280))),
    "two blocks": Case(
        *(lambda: rf.from_toml(PAIR), (), BOTH, (64, 96, 160)),
        limits=((TRIANGLES, 320), (QUADRILATERALS, 320)),
    ),
    "lap joint": Case(
        *("lap_joint.toml", (), BOTH, (120, 180, 240), ((GRADED, 300), (GRADED, 240))),
        edge=60.0, left_out=LARGEST,
    ),
    "dovetail": Case(
        *("dovetail.toml", (), BOTH[:1], (40, 60, 80), ((GRADED, 120), (GRADED, 96))),
        edge=0.85, left_out=LARGEST,
    ),
    "a mesh file": Case(
        own_mesh, (), BOTH[:1], (64, 128, 256), doubled=32, like="the paper's block"
    ),
}  # fmt: skip


class Solved:
    """The numbers of a scene on all its meshes, kept in a file."""

    def __init__(self, name: str, folder: Path) -> None:
        """Read the meshes that are known."""
        self.case, self.name = SCENES[name], name
        self.file = folder / "levels" / f"{name.replace(' ', '_')}.json"
        self.levels: dict[str, rf.Level | None] = {}
        known = json.loads(self.file.read_text()) if self.file.is_file() else {}
        for mesh, row in known.items():
            numbers = {key: rf.Number(**one) for key, one in row["numbers"].items()} if row else {}
            self.levels[mesh] = row and rf.Level(**{**row, "numbers": numbers})

    def on(self, kind: Kind, elements: int) -> rf.Level | None:
        """Return the numbers on a mesh; None where it has none."""
        mesh = f"{kind} {elements}"
        if mesh not in self.levels:
            begin = time.process_time()
            try:
                scene = self.case.scene(kind, elements)
                record = rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)
                found = rf.level_of(record, elements, time.process_time() - begin)
            except rf.RecedingError as error:
                print(f"{self.name}, {mesh}: {error}", flush=True)
                found = None
            self.levels[mesh] = found
            part = self.file.with_suffix(".part")
            part.write_text(
                json.dumps({key: one and asdict(one) for key, one in self.levels.items()})
            )
            part.replace(self.file)
        return self.levels[mesh]

    def near(self, kind: Kind, most: float) -> rf.Level | None:
        """Return the numbers on the finest mesh of so many elements at most that fits."""
        for elements in range(2 * int(most / 2), int(max(most / 1.6, 7)), -2):
            is_one = not self.case.doubled or elements / self.case.doubled in (1, 2, 4, 8)
            if is_one and (found := self.on(kind, elements)):
                return found
        return None

    def families(self) -> Iterator[tuple[str, str, list[rf.Level]]]:
        """Yield for each judged mesh the family of an estimate, the mesh and all meshes."""
        judged = [(kind, elements) for kind in self.case.kinds for elements in self.case.judged]
        judged += [(GRADED, elements) for elements in self.case.graded]
        for kind, elements in judged:
            # a search grades its meshes where corners are sharp
            equal = ("--error",) if self.case.graded else ("--error", "search")
            for family in ("graded search",) if kind.graded else equal:
                levels = [rf.given(self.near(kind, elements))]
                for factor in error_report.FACTORS[family]:
                    found = self.near(kind, min(elements / factor, levels[-1].elements - 1))
                    levels += [found] if found else []
                if family == "--error" or levels[-1].elements >= 2 / 3 * FIRST:
                    yield family, f"{kind} {elements}", levels


def pairs(name: str, folder: Path) -> Iterator[error_report.Row]:
    """Yield, for each mesh and number of a scene, estimate and true error."""
    solved = Solved(name, folder)
    other = Solved(solved.case.like, folder) if solved.case.like else solved
    one, two = (rf.given(other.on(*mesh)).numbers for mesh in other.case.limits)
    for family, mesh, levels in solved.families():
        for number, found in rf.estimates_of(levels).items():
            if number not in one or number not in two or number.startswith(solved.case.left_out):
                continue  # no such zone in the limit
            limit, unsure = one[number].value, abs(one[number].value - two[number].value)
            unsure += max(one[number].known_to, two[number].known_to)
            if name == BLOCK and number in COMPUTED:
                limit, unsure = COMPUTED[number], 0.0
            if not np.isfinite(found.error + limit):
                continue  # a singular number, or nothing known of coarser meshes
            true, floor = abs(found.value - limit), unsure + 1e-6 * found.size
            yield {
                "family": family, "scene": name, "mesh": mesh, "number": number,
                "limit": limit, "unsure": unsure, "size": found.size, "true": true,
                "value": found.value, "estimate": found.error, "order": found.order,
                "within": float(true <= 2.0 * found.error + floor),
                "told": float(true > 2.0 * floor),
            }  # fmt: skip


def compare(out: Path, scenes: list[str], workers: int) -> bool:
    """Solve all meshes of the scenes, on so many processes, and report."""
    (out / "levels").mkdir(parents=True, exist_ok=True)
    command = [sys.executable, __file__, "--out", str(out), "--workers", "0", "--scenes"]
    shares = [scenes[k::workers] for k in range(workers) if workers > 1]
    started = [subprocess.Popen([*command, *own], env=rf.child_environment()) for own in shares]
    if any([process.wait() for process in started]):
        raise SystemExit("a process has failed")
    rows = [row for name in scenes for row in pairs(name, out)]
    if workers:
        with (out / "error_estimates.csv").open("w") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return not workers or error_report.report(rows, out)


def main() -> None:
    """Compare estimated with true errors."""
    parser = argparse.ArgumentParser(description="Estimated against true space errors.")
    parser.add_argument("--out", type=Path, default=Path("results/error_estimates"))
    parser.add_argument("--scenes", nargs="+", choices=[*SCENES], default=[*SCENES])
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    given = parser.parse_args()
    compared = rf.on_root(MPI.COMM_WORLD, lambda: compare(given.out, given.scenes, given.workers))
    if compared is False:
        raise SystemExit("not as wanted everywhere: see the bold figures over all families")


if __name__ == "__main__":
    main()
