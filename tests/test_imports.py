"""Imports of the package: downwards through its rooms only, and without a circle."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

pytestmark = pytest.mark.one_rank

PACKAGE = "receding_fenicsx"
ROOT = Path(__file__).parents[1] / PACKAGE

ROOMS = {
    "": "errors < arrays < atomic environment mpi timing < workers < scene interface half_plane"
    " < bulk evolution < modal store < reference < measures < output < pictures"
    " < studies exchange < __init__ < terminal < cli < __main__",
    "interface.": "tolerances < law < system"
    " < system_checks residual mirror equilibrium lcp measures < gauss_seidel < exact"
    " < uniqueness load_steps shakedown < branches shear_branches",
    "output.": "plots < snapshots report",
    "studies.": "runner < accuracy starts < run < wear < sweep shakedown < joint",
}
"""Rooms of the package and of its folders from the ground up; imports lead to lower ones only."""

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


@pytest.mark.parametrize("inside", ROOMS)
def test_imports_lead_downwards(inside: str) -> None:
    floors = [part.split() for part in ROOMS[inside].split("<")]
    floor = {room: k for k, rooms in enumerate(floors) for room in rooms}

    def room_of(name: str) -> str:
        """Return the room of a module, of its folder where it is the folder's own."""
        parts = [*(name or "__init__").split("."), ""]
        return parts[inside.count(".")] or parts[0]

    wrong = []
    for name, other in ARROWS:
        above, below = room_of(name), room_of(other)
        within = name.startswith(inside) and other.startswith(inside)
        if within and above != below and floor[below] >= floor[above]:
            wrong.append(f"{name} imports {other}")
    assert wrong == []


def test_no_imports_in_a_circle() -> None:
    graph = {name: modules_of(name) - {name} for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_rooms_of_arrays_and_scenes_do_without_finite_elements() -> None:
    rooms = ("interface.", "evolution.", "scene.", "half_plane.")
    found = [
        f"{name} imports {other}"
        for name in MODULES
        if f"{name}.".startswith(rooms)
        for other in IMPORTS[name]
        if other.split(".")[0] in FEM
    ]
    assert found == []


def test_output_neither_condenses_nor_computes_mechanics() -> None:
    wrong = [
        f"{name} imports {other}"
        for name, other in ARROWS
        if name.startswith("output.")
        and f"{other}.".startswith(tuple(f"{module}." for module in NOT_OF_OUTPUT))
    ]
    assert wrong == []
