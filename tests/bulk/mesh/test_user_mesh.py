"""Meshes of the user's own: read, turned, refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, block, make_mesh
from msh import Array, Ints, rectangle, turned, write_msh

from receding_fenicsx.bulk.mesh.user_mesh import words_of
from receding_fenicsx.errors import InputError
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.model import Body, Contact, HistoryOptions, Load, Scene
from receding_fenicsx.studies.run import condense

comm = MPI.COMM_WORLD
RECTANGLE = Path(__file__).with_name("rectangle.geo").read_text()


def file_of(scene: Scene, path: Path, change: Callable[[Array], Array]) -> Scene:
    """The scene with the mesh of its rectangle, changed, as the user's file."""

    def write() -> None:
        mesh = rectangle(scene)
        write_msh(path, change(mesh.points), [mesh.cells], mesh.edges)

    on_root(comm, write)
    comm.barrier()
    return replace(scene, body=Body(mesh=str(path)))


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 135.0])
def test_turned_body_has_the_same_condensed_system(
    cell: str, degree: int, degrees: float, shared_tmp_path: Path
) -> None:
    loads = (
        Load("p0", "top", (-1.0, 1.0), pressure=1.0),
        Load("side", "right", pressure={"x": [-0.5, 0.5], "value": [0.0, 1.0]}),
    )
    table = {"x": [-1.5, 0.0, 1.0], "value": [0.01, 0.0, 0.02]}
    foot = Contact(span=(-1.5, 1.0), friction="0.3 + 0.1*x", initial_gap=table)
    history = HistoryOptions(load="p0", constant={"side": 1.0})
    scene = block(cell, degree, loads=loads, contacts=(foot,), history=history)
    mesh = shared_tmp_path / "block.msh"
    user = file_of(scene, mesh, lambda points: turned(points, degrees, (0.3, -0.7)))
    expected, found = condense(scene), condense(user)
    if expected is None or found is None:
        return
    scale = np.abs(expected.K).max()
    for name in ("x", "f", "g0"):
        assert np.abs(getattr(found, name) - getattr(expected, name)).max() < 1e-12
    assert np.ptp(found.f) == pytest.approx(0.25) and found.g0.max() == pytest.approx(0.02)
    assert np.abs(found.K - expected.K).max() < 1e-12 * scale
    assert np.abs(found.r_star - expected.r_star).max() < 1e-12
    assert found.weight == pytest.approx(expected.weight, rel=1e-12)
    assert found.load_compliance == pytest.approx(expected.load_compliance, rel=1e-10)
    # a rigid motion of one is a combination of rigid motions of the other
    left = np.linalg.lstsq(expected.rigid, found.rigid, rcond=None)[1]
    assert found.rigid.shape == (2 * found.n, 3) and np.all(left < 1e-20)


@pytest.mark.parametrize("end", ["\n", "", " // whole", "\n// whole"])
def test_scaling_factor_of_a_geo_file_counts(end: str, shared_tmp_path: Path) -> None:
    """Of a last line without a line break, gmsh itself takes the first statement only."""
    path, last = shared_tmp_path / "my.geo", f"one = 1; Mesh.ScalingFactor = 0.5;{end}"
    groups = 'Physical Curve("foot") = {1}; Physical Curve("head") = {3};\n'
    text = f"width = 4; height = 1; contact_elements = 8;\n{RECTANGLE}{groups}{last}"
    on_root(comm, lambda: path.write_text(text))
    comm.barrier()
    scene = block(contacts=(Contact(edge="foot"),), load=Load("p", "head", pressure=1.0))
    system = condense(replace(scene, body=Body(mesh=str(path))))
    if system is not None:
        assert system.x[[0, -1]] == pytest.approx([-1.0, 1.0], rel=1e-14)


POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0]])
SQUARES = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
TRIANGLES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
EDGES = {"foot": np.array([[0, 1], [1, 2]]), "head": np.array([[3, 4], [4, 5]])}


def two_cells(
    path: Path,
    points: Array = POINTS,
    cells: list[Ints] | None = None,
    edges: dict[str, Ints] | None = None,
    **parts: object,
) -> Scene:
    on_root(comm, lambda: write_msh(path, points, cells or [SQUARES], edges or EDGES))
    comm.barrier()
    scene = block(contacts=(Contact(edge="foot"),), load=Load("p", "head", pressure=1.0))
    return replace(scene, **({"body": Body(mesh=str(path))} | parts))  # type: ignore[arg-type]


def test_mesh_that_cannot_serve_is_refused_by_name(shared_tmp_path: Path) -> None:
    """What Gmsh itself does not write; the rest are rows of refusals.txt."""
    path = shared_tmp_path / "my.msh"
    folded = POINTS[[1, 0, 2, 3, 4, 5]]
    nowhere = POINTS.copy()
    nowhere[4] = np.nan, 1.0
    cases: list[tuple[dict, str]] = [
        (
            {"points": folded},
            "1 of its cells are flat or folded, one at (0.5, 0.5); mesh the body better",
        ),
        # as where a surface is in two groups
        (
            {"cells": [TRIANGLES, TRIANGLES[:1]]},
            "more than two of its cells share the side at (1, 0.5); put each surface into one "
            "physical group, and mesh it once",
        ),
        ({"points": nowhere}, "node 5 is at [nan, 1.0, 0.0], not a finite position; mesh it again"),
        (
            {"cells": [np.array([[0, 2, 3, 1, 4, 5]])]},
            "has cells of higher order; save it with Mesh.ElementOrder = 1 (mesh.degree sets the "
            "degree of the displacement)",
        ),
    ]
    for change, words in cases:
        with pytest.raises(InputError) as caught:
            make_mesh(comm, two_cells(path, **change), False)
        assert set(comm.allgather(str(caught.value))) == {f'[body] mesh "my.msh": {words}'}


@pytest.mark.parametrize("cells", [SQUARES, TRIANGLES])
def test_cells_may_run_clockwise_and_facets_be_listed_twice(
    cells: Ints, shared_tmp_path: Path
) -> None:
    path, turned_cells = shared_tmp_path / "my.msh", cells.copy()
    turned_cells[1] = turned_cells[1, ::-1]
    twice = {name: np.vstack([facets, facets[:, ::-1]]) for name, facets in EDGES.items()}
    cases = (cells, EDGES), (turned_cells, EDGES), (cells, twice)
    found = [condense(two_cells(path, cells=[each], edges=edges)) for each, edges in cases]
    for other in found[1:]:
        if found[0] is not None and other is not None:
            assert np.array_equal(found[0].points, other.points) and found[0].n == 3
            assert other.K == pytest.approx(found[0].K, abs=1e-13)
            assert other.r_star == pytest.approx(found[0].r_star, abs=1e-13)


@pytest.mark.one_rank
def test_parameters_of_a_file_are_words_outside_of_comments_and_strings(tmp_path: Path) -> None:
    (tmp_path / "own.geo").write_text(
        'a = 1; // five" b\nDefineConstant[ c = {1, Name "A//d"}, e = {2, Name "/*f"} ];\n'
        '/* g "\n h */ i = 2;\n'
    )
    assert words_of(tmp_path / "own.geo") == {*"acei", "DefineConstant", "Name"}
