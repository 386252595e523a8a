"""Matrix of the probes against back-substitution and the stresses of whole fields."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, block, built, cylinder
from dolfinx import fem
from numpy.typing import NDArray

import receding_fenicsx as rf
from receding_fenicsx.bulk import _dolfinx, stack
from receding_fenicsx.bulk.elasticity import point_values, reference
from receding_fenicsx.bulk.fields import BodyFields, gather_fields, probe_matrix, solve_fields
from receding_fenicsx.bulk.mesh.meshing import make_meshes
from receding_fenicsx.bulk.stack import Stack, build_all

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]

STRESSES = ("sxx", "syy", "szz", "sxy")
PRESS = rf.Load("P", "top", platen=True, force=(0.0, -1.0))
SIDE = rf.Load("s", "left", (-0.25, 0.25), traction=(1.0, 0.5))
PULL = rf.Load("d", "right", (0.0, 0.5), displacement=(1.0, "y - 2"))
DRIVE = rf.Load("d", "upper.left", displacement=(1.0, "y - 2"))
PAIR = rf.Scene(
    body=rf.Body("upper", width=4.0, position=(0.0, 2.0)),
    others=(rf.Body("lower", width=8.0, height=2.0),),
    material=rf.Material(2.0, 0.3),
    materials=(rf.Material(3.0, 0.2, name="lower"),),
    mesh=rf.MeshOptions(contact_elements=12, degree=2),
    contacts=(rf.Contact("upper.bottom", against="lower.top"),),
    loads=(
        rf.Load("p0", "upper.top", (-1.0, 1.0), pressure=1.0),
        rf.Load("q", "lower.right", traction=(1.0, 0.0)),
    ),
    supports=(rf.Support("xy", edge="lower.bottom"),),
)
CASES = {
    "triangles of order 1": (block(degree=1), False),
    "quadrilaterals of order 2, half": (block("quadrilateral", 2), True),
    "plane stress, order 2": (
        block(degree=2, material=rf.Material(2.0, 0.3, "plane stress")),
        True,
    ),
    "prescribed displacement": (block("quadrilateral", 1, loads=(SIDE, PULL)), False),
    "platen": (block(degree=2, loads=(PRESS, SIDE), supports=()), False),
    "revolution, order 1": (cylinder("quadrilateral", 1), True),
    "revolution, order 2": (cylinder(degree=2), True),
    "two bodies": (PAIR, False),
    "a face driven at the contact": (replace(PAIR, loads=(*PAIR.loads, DRIVE)), False),
    "halves of two bodies": (replace(PAIR, loads=PAIR.loads[:1]), True),
}


def places(bulk: Stack) -> list[Array]:
    """Vertices and midpoints of some cells of each body, alike on every rank."""
    found = []
    for part in bulk.parts:
        fields = gather_fields([BodyFields(part, *part.fields(*at_rest(part)))])
        chosen = None
        if fields is not None:
            corners = fields.points[fields.cells]
            # one of them at the right end, where displacements are prescribed
            last = np.argmax(corners.mean(axis=1) @ [1.0, 0.1])
            corners = np.vstack([corners[:: max(1, len(corners) // 9)], corners[last, None]])
            chosen = np.vstack([corners[:, 0], corners.mean(axis=1)])
            if part.scene.axisymmetric:
                chosen[:, 0] = np.abs(chosen[:, 0])  # the picture shows both sides
        found.append(comm.bcast(chosen))
    return found


def at_rest(bulk: stack.Body) -> tuple[Array, Array]:
    return np.zeros(len(bulk.load_names)), np.zeros(2 * len(bulk.contact.node))


def with_probes(scene: rf.Scene, points: list[Array]) -> rf.Scene:
    names = [body.name for body in scene.bodies]
    probes = [
        rf.Probe(f"in {k}", points=tuple(map(tuple, at)), body=names[k] if scene.others else None)
        for k, at in enumerate(points)
    ]
    return replace(scene, probes=tuple(probes))


def by_cells(bulk: Stack, load: Array, u: Array, points: list[Array]) -> Array | None:
    """[u_x, u_y, s_xx, s_yy, s_zz, s_xy] from whole fields: at vertices, then at midpoints."""
    rows = []
    for fields, at in zip(solve_fields(bulk, load, u), points, strict=True):
        gathered = gather_fields([fields])
        middle = _middles(fields.bulk, fields.stresses.cell)
        if gathered is None:
            continue
        for k, point in enumerate(at):
            if k < len(at) // 2:
                i = int(np.argmin(np.hypot(*(gathered.points - point).T)))
                stress = [gathered.stress[name][i] for name in STRESSES]
                if fields.bulk.body.half and gathered.points[i, 0] == 0.0:
                    stress[3] = np.nan  # zero in the picture, of both sides
                rows.append([*gathered.displacement[i], *stress])
            else:
                mirrored = fields.bulk.body.half and point[0] < 0.0
                flip = np.array([-1.0 if mirrored else 1.0, 1.0])
                i = int(np.argmin(np.hypot(*(middle[:, :2] - flip * point).T)))
                stress = middle[i, 2:] * [1.0, 1.0, 1.0, flip[0]]
                rows.append([np.nan, np.nan, *stress])
    return np.array(rows) if rows else None


def _middles(bulk: stack.Body, stress: dict[str, fem.Function]) -> Array:
    """Midpoint and stresses of every cell, on every rank."""
    space = stress["sxx"].function_space
    n = bulk.body.mesh.topology.index_map(2).size_local
    at = space.tabulate_dof_coordinates()[:n, :2]
    values = np.column_stack([stress[name].x.array[:n] for name in STRESSES])
    return np.vstack(comm.allgather(np.hstack([at, values])))


@pytest.mark.parametrize("case", CASES)
def test_probes_are_what_back_substitution_of_the_whole_field_gives(case: str) -> None:
    scene, half = CASES[case]
    made = build_all(scene, make_meshes(comm, scene, half))
    points = places(made)
    matrix = probe_matrix(made, with_probes(scene, points))
    random = np.random.default_rng(5)
    load = random.standard_normal(len(made.load_names))
    u = random.standard_normal(2 * len(made.contact.x))
    u[np.asarray(made.contact.held)] = 0.0
    whole = by_cells(made, load, u, points)
    made.destroy()
    if matrix is None or whole is None:
        return
    found = matrix.rows @ np.concatenate([u, load])
    # the field of one side only would not be odd on the axis of symmetry
    if half and not scene.axisymmetric:
        axis = np.abs(matrix.points[:, 0]) < 1e-12
        assert np.all(found[axis][:, [0, 5]] == 0.0)
        whole[axis, 5] = 0.0
    scale = np.nanmax(np.abs(whole), axis=0)
    assert np.all(scale > 0.0) or scene.material.kinematics == "plane stress"
    error = np.abs(found - whole) / np.maximum(scale, 1e-300)
    assert np.nanmax(error) < 1e-12


# -- places --------------------------------------------------------------------------------------


@pytest.mark.one_rank
@pytest.mark.parametrize("kind", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_shape_functions_carry_linear_fields_in_cells_of_any_shape(kind: str, degree: int) -> None:
    random = np.random.default_rng(3)
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[: 3 if kind[0] == "t" else 4]
    for _ in range(20):
        cell = unit + random.uniform(-0.2, 0.2, unit.shape)
        # middles of the sides in the order of basix, and of a quadrilateral the midpoint
        sides = [(1, 2), (0, 2), (0, 1)] if len(cell) == 3 else [(0, 1), (0, 2), (1, 3), (2, 3)]
        middles = [cell[list(side)].mean(axis=0) for side in sides]
        middles += [cell.mean(axis=0)] if len(cell) == 4 else []
        nodes = cell if degree == 1 else np.vstack([cell, middles])
        inner = random.dirichlet(np.ones(len(cell))) @ cell
        at = reference(kind, cell, inner)
        assert at is not None
        shape, slopes = (part[..., 0, :] for part in _dolfinx.tabulated(kind, degree, at[None]))
        gradient = slopes.T @ np.linalg.inv(_dolfinx.mapped(kind, cell, at[None])[1][0])
        slope = random.standard_normal(2)
        assert shape @ (1.0 + nodes @ slope) == pytest.approx(1.0 + inner @ slope, abs=1e-12)
        assert gradient.T @ (1.0 + nodes @ slope) == pytest.approx(slope, abs=1e-11)


def test_point_outside_a_meshed_body_is_refused_on_all_ranks() -> None:
    made = built(block())
    with pytest.raises(
        rf.InputError, match=r"probe 'p': \(0, 1.1\) lies outside the mesh .*; move"
    ):
        point_values(made, np.array([[0.0, 0.5], [0.0, 1.1]]), ["probe 'p'"] * 2)
    made.destroy()
