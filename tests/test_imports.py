"""Imports of the package lead downwards through its rooms; demos need its public names only."""

import ast
import inspect
import pydoc
import re
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank

PACKAGE = "receding_fenicsx"
TOP = Path(__file__).parents[1]
ROOT = TOP / PACKAGE

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


# -- names of ``import receding_fenicsx as rf``: demos and documents need no others ----------------

CHECKERS = {"hard_cases": {"hard"}, "random_problems": {"problems", "stack_problems"}}
"""Modules of ``tests/`` that benchmarks use."""
NEEDED = {"matplotlib", "mpi4py", "numpy", "petsc4py", "scipy", "h5py"}
DEMOS = sorted((TOP / "demos").rglob("*.py"))
NOTEBOOKS = sorted((TOP / "docs" / "tutorials").glob("*.py"))
DOCUMENTS = [TOP / "README.md", TOP / "CONTRIBUTING.md", *sorted((TOP / "docs").glob("*.md"))]
DOCUMENTS += NOTEBOOKS


@pytest.mark.parametrize("name", rf.__all__)
def test_every_public_name_loads_and_has_a_docstring(name: str) -> None:
    value = getattr(rf, name)
    assert (inspect.getdoc(value) or "").splitlines()[0].strip()


def test_help_and_completion_know_every_public_name() -> None:
    assert set(rf.__all__) <= set(dir(rf))
    assert not set(rf.__all__) - set(re.findall(r"\w+", pydoc.plain(pydoc.render_doc(rf))))


def test_type_checkers_and_programs_see_the_same_names() -> None:
    stub = ast.parse(Path(rf.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    lines = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    names = [(alias.name, alias.asname) for node in lines for alias in node.names]
    # a type checker hides names without "as"; the loader takes the name before it
    assert names == [(name, name) for name, _ in names]
    assert sorted(name for name, _ in names) == sorted(rf.__all__)


@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demos_use_public_names_only(demo: Path) -> None:
    found = imports(demo.read_text(encoding="utf-8"))
    assert not [name for name in found if name.startswith(f"{PACKAGE}.")]
    others = {name.split(".")[0] for name in found} - NEEDED - {PACKAGE}
    beside = {path.stem for path in DEMOS} | CHECKERS.get(demo.stem, set())
    assert others - beside <= sys.stdlib_module_names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_programs_of_the_documents_use_public_names_only(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    programs = re.findall(r"```python\n(.*?)```", text, re.S)
    for program in [text] if document in NOTEBOOKS else programs:
        assert not [name for name in imports(program) if name.startswith(f"{PACKAGE}.")]
