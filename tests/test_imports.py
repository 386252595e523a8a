"""Imports of the package: downwards through its rooms only, and without a circle."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

pytestmark = pytest.mark.one_rank

PACKAGE = "receding_fenicsx"
ROOT = Path(__file__).parents[1] / PACKAGE

FLOORS = (
    ("errors",),
    ("arrays",),
    ("atomic", "environment", "mpi", "timing"),
    ("workers",),
    ("scene", "interface", "half_plane"),
    ("bulk", "evolution"),
    ("modal", "store"),
    ("reference",),
    ("measures",),
    ("output",),
    ("pictures",),
    ("studies", "exchange"),
    ("__init__",),
    ("terminal",),
    ("cli",),
    ("__main__",),
)
"""Rooms of the package from the ground up. A room imports from floors below its own only."""

INTERFACE = (
    ("tolerances",),
    ("law", "rigid_motions", "changes"),
    ("system",),
    (
        "solver",
        "system_checks",
        "residual",
        "mirror",
        "equilibrium",
        "lcp",
        "measures",
    ),
    ("gauss_seidel",),
    ("exact",),
    ("uniqueness", "load_steps", "shakedown"),
    ("branches", "shear_branches"),
)
"""Rooms of the interface: modules of its own folder, then its folders."""

OUTPUT = (("plots",), ("snapshots", "report"))
"""Rooms of the output."""

STUDIES = (
    ("runner",),
    ("accuracy", "starts"),
    ("run",),
    ("wear",),
    ("sweep", "shakedown"),
    ("joint",),
)
"""Rooms of the studies."""

FEM = ("dolfinx", "petsc4py", "mpi4py", "gmsh", "ufl", "basix")
"""Libraries that the interface and the evolution do without."""

NOT_OF_OUTPUT = (
    *("bulk.body", "bulk.elasticity", "bulk.schur", "bulk.from_scene"),
    *("evolution.evolve", "evolution.limit", "evolution.problem"),
    *("interface.equilibrium", "interface.exact", "interface.lcp"),
    *("interface.measures.zone_ends", "reference.corners"),
)
"""What assembles and condenses, and computes histories, exponents and ends of zones."""


def name_of(path: Path) -> str:
    """Return a module's name within the package; "" is the package itself."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in sorted(ROOT.rglob("*.py"))}


def imports(text: str) -> set[str]:
    """Return all names that a program imports, those inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


IMPORTS = {name: imports(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}


def modules_of(name: str) -> set[str]:
    """Return the modules of the package that one of them imports."""
    found = set()
    for other in IMPORTS[name]:
        inside = other.removeprefix(f"{PACKAGE}.")
        if inside != other:
            found.add(inside if inside in MODULES else inside.rpartition(".")[0])
    return found


ARROWS = [(name, other) for name in MODULES for other in modules_of(name)]


def floor_of(name: str, floors: tuple[tuple[str, ...], ...], depth: int) -> int:
    """Return the number of the floor that a module stands on."""
    parts = name.split(".") if name else ["__init__"]
    room = parts[min(depth, len(parts) - 1)]
    return next(k for k, rooms in enumerate(floors) if room in rooms)


@pytest.mark.parametrize(
    ("inside", "floors"),
    [("", FLOORS), ("interface.", INTERFACE), ("output.", OUTPUT), ("studies.", STUDIES)],
)
def test_imports_lead_downwards(inside: str, floors: tuple[tuple[str, ...], ...]) -> None:
    depth = inside.count(".")
    wrong = []
    for name, other in ARROWS:
        if not (name.startswith(inside) and other.startswith(inside)):
            continue
        rooms = [[*part.split("."), ""][depth] for part in (name or "__init__", other)]
        above, below = (floor_of(part, floors, depth) for part in (name, other))
        if rooms[0] != rooms[1] and below >= above:
            wrong.append(f"{name} imports {other}")
    assert wrong == []


def test_no_imports_in_a_circle() -> None:
    graph = {name: modules_of(name) - {name} for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("room", ["interface", "evolution", "scene", "half_plane"])
def test_rooms_do_without_finite_elements(room: str) -> None:
    found = {
        (name, other.split(".")[0])
        for name in MODULES
        if name.split(".")[0] == room
        for other in IMPORTS[name]
        if other.split(".")[0] in FEM
    }
    assert found == set()


def test_output_neither_condenses_nor_computes_mechanics() -> None:
    wrong = [
        f"{name} imports {other}"
        for name, other in ARROWS
        if name.startswith("output.")
        and f"{other}.".startswith(tuple(f"{module}." for module in NOT_OF_OUTPUT))
    ]
    assert wrong == []
