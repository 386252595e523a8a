"""Searches for the mesh that meets a tolerance: meshes, costs and true errors.

**Problem.** ``run --tolerance 3e-4`` with default numbers on scenes of all kinds: the block with
and without friction, two blocks under a concentrated force, flat punches, a layer, a dovetail, a
mesh file of one's own, which is refined uniformly.

**Equations.** Twice the estimated error of each number is to be below the tolerance; then the true
error should be too: the difference to a mesh about twice as fine, of the mesh file to the same
block on a mesh of the program's own.

**What to look for.** Met or not, the last mesh, processor seconds of the whole search, and over
those of a run on its last mesh alone (with the processes that make the meshes; without pictures),
the true error of each number. ``--scenes`` chooses scenes; ``searches.md`` in --out has all that
are there. The two blocks take most of the time.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

import receding_fenicsx as rf

DEMOS = Path(__file__).parents[1]
TOLERANCE = 3e-4
"""Tolerance of the searches."""
SCENES = {
    "block": 2.0,
    "frictionless_block": 2.0,
    "punch": 2.0,
    "punch_axisymmetric": 2.0,
    "layer": 2.0,
    "dovetail": 1.5,
    "two_blocks": 1.5,
    "own_mesh": 2.0,
}
"""Scenes, and how many times finer the mesh is that gives the true errors."""
OWN_LIMIT = 960
"""Contact elements of the block that gives the true errors of the mesh file."""
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
Field[1].F = "SIZE + 0.25 * y";
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
"""
"""The paper's block for gmsh: sizes grow by a quarter of the distance from the contact."""


@cache
def own_mesh(size: float) -> rf.Scene:
    """Return the paper's block on a mesh file of gmsh, with elements of a size at the contact."""
    folder = Path(tempfile.mkdtemp())
    (folder / "block.geo").write_text(OWN_MESH.replace("SIZE", str(size)))
    program = (
        "import gmsh; gmsh.initialize(); gmsh.open('block.geo'); "
        "gmsh.model.mesh.generate(2); gmsh.write('block.msh')"
    )
    command = [sys.executable, "-c", program]
    environment = rf.child_environment()
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    scene = rf.read_scene(DEMOS / "block.toml", [f"mesh.contact_elements={round(4.0 / size)}"])
    load = replace(scene.loads[0], edge="loaded", span=None)
    body = rf.Body(mesh=str(folder / "block.msh"))
    return replace(scene, body=body, loads=(load,), mesh=replace(scene.mesh, refinements=0))


def processor_seconds() -> float:
    """Return the processor time of this process and its children, running ones too."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = time.process_time() + ended.ru_utime + ended.ru_stime
    for children in Path("/proc/self/task").glob("*/children"):
        for child in children.read_text().split():
            words = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
            seconds += (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    return seconds


def searched(scene: rf.Scene, folder: Path) -> dict[str, Any]:
    """Search; return the record, the search, and seconds of it and of the last mesh's run alone."""
    options = rf.RunOptions(overwrite=True, pictures=False, tolerance=TOLERANCE)
    begin = processor_seconds()
    try:
        rf.run(scene, folder, options, MPI.COMM_SELF)
    except rf.ToleranceNotMet as error:
        print(error, flush=True)
    seconds = processor_seconds() - begin
    record = rf.read_record(folder / "record.h5")
    scene = rf.given(record.scene)
    scene = replace(scene, accuracy=replace(scene.accuracy, tolerance=None))
    begin = processor_seconds()
    with tempfile.TemporaryDirectory() as alone:
        rf.run(scene, Path(alone), replace(options, tolerance=None), MPI.COMM_SELF)
    return {
        "record": record,
        "way": rf.read_summary(folder / "summary.json")["accuracy"],
        "seconds": seconds,
        "last": processor_seconds() - begin,
    }


def limit_of(name: str, record: rf.Record) -> dict[str, rf.Number]:
    """Return the numbers of the mesh that gives the true errors."""
    scene = replace(rf.given(record.scene), output=rf.OutputOptions(1, ()))
    if name == "own_mesh":
        body = rf.read_scene(DEMOS / "block.toml")
        scene = replace(scene, body=body.body, loads=body.loads, mesh=body.mesh)
        finer = OWN_LIMIT
    else:
        finer = 2 * round(0.5 * SCENES[name] * scene.mesh.contact_elements)
    scene = rf.scaled_mesh(scene, finer)
    return rf.headline(rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene))


def row_of(name: str, folder: Path) -> dict[str, Any]:
    """Search one scene; return its row."""
    scene = own_mesh(0.04) if name == "own_mesh" else rf.read_scene(DEMOS / f"{name}.toml")
    rf.run(scene, comm=MPI.COMM_SELF)  # loads what the first run needs, both times leave that out
    found = searched(scene, folder / name)
    way = found["way"]["way"][-1]
    limit = limit_of(name, found["record"])
    true = {
        number: abs(own["value"] - limit[number].value) / own["size"]
        for number, own in way["numbers"].items()
    }
    return {
        "met": found["way"]["met"],
        "graded": found["way"]["graded"],
        "elements": way["elements"],
        "nodes": way["nodes"],
        "seconds": found["seconds"],
        "ratio": found["seconds"] / found["last"],
        "estimates": {number: own["relative"] for number, own in way["numbers"].items()},
        "true": true,
    }


def report(folder: Path) -> bool:
    """Write and print the table of all scenes that are known; return whether all are met, truly."""
    rows = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}
    lines = [
        f"| scene | {TOLERANCE:g} | last mesh | seconds | over its last mesh's run |",
        "| --- " * 5 + "|",
    ]
    lines += [
        f"| {name} | {'met' if row['met'] else 'not met'} | {row['elements']}"
        f"{' graded' if row['graded'] else ''} elements, {row['nodes']} nodes | "
        f"{row['seconds']:.1f} | {row['ratio']:.2f} |"
        for name, row in rows.items()
    ]
    lines += ["", "| scene | number | estimate | true error |", "| --- " * 4 + "|"]
    lines += [
        f"| {name} | {number} | {row['estimates'][number]:.1e} | {true:.1e} |"
        for name, row in rows.items()
        for number, true in row["true"].items()
    ]
    (folder / "searches.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines), flush=True)
    return all(row["met"] and max(row["true"].values()) <= TOLERANCE for row in rows.values())


def study(folder: Path, scenes: list[str]) -> bool:
    """Search the scenes, and report."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in scenes:
        (folder / f"{name}.json").write_text(json.dumps(row_of(name, folder), indent=1))
        print(name, "is done", flush=True)
    return report(folder)


def main() -> None:
    """Search the scenes."""
    parser = argparse.ArgumentParser(description="Searches for a tolerance.")
    parser.add_argument("--out", type=Path, default=Path("results/searches"))
    parser.add_argument("--scenes", nargs="*", choices=[*SCENES], default=[*SCENES])
    given = parser.parse_args()
    if rf.on_root(MPI.COMM_WORLD, lambda: study(given.out, given.scenes)) is False:
        raise SystemExit("a search is not met, or its true error is above the tolerance")


if __name__ == "__main__":
    main()
