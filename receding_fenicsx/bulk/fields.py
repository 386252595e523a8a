"""Fields of the bodies, and their values at probes, from contact displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.elasticity import Stresses
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.stack import Body, Stack
from receding_fenicsx.interface.system import ProbeMatrix
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import Probe, Scene
from receding_fenicsx.scene.one_body import sides_of_body


@dataclass(frozen=True)
class BodyFields:
    """Fields of one modelled body, distributed over the ranks."""

    bulk: Body  # the body
    displacement: fem.Function  # displacement in the space of degree 1, that of the mesh
    stresses: Stresses  # stresses in the cells and at the vertices


@dataclass(frozen=True)
class Fields:
    """Displacement and stresses at the vertices of the whole body, on rank 0."""

    points: Array  # (n, 2) vertices
    cells: NDArray[np.int64]  # (m, 3 or 4) vertices around each cell
    displacement: Array  # (n, 2) displacement
    # by name ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear"), (n,) averages over the cells
    # around each vertex
    stress: dict[str, Array]
    cell_stress: dict[str, Array]  # by name, (m,) at the midpoints of the cells
    # (n,) number of the body that each vertex belongs to; None for one body
    body: NDArray[np.int64] | None = None


def fields_at(bodies: Stack, load: Array, u: Array) -> Fields | None:
    """Return the fields of the whole bodies on rank 0, for its load factors and u; collective."""
    return gather_fields(solve_fields(bodies, load, u))


def solve_fields(bodies: Stack, load: Array, u: Array) -> list[BodyFields]:
    """Solve for the fields of each modelled body; collective. Arguments as :func:`fields_at`."""
    bodies.condense()
    return [
        BodyFields(part, *part.fields(own_load, own_u))
        for part, own_load, own_u in bodies.as_joined(load, u)
    ]


def probe_matrix(bodies: Stack, scene: Scene) -> ProbeMatrix | None:
    """Return the values at all probes of a scene (at least one), on rank 0; collective."""
    bodies.condense()
    places = [_places(bodies, probe) for probe in scene.probes]
    counted = list(zip(scene.probes, places, strict=True))
    names = tuple(probe.name for probe, found in counted for _ in found)
    owners = [
        probe.body if probe.edge is None else scene.find_edge(probe.edge)[0].name
        for probe, found in counted
        for _ in found
    ]
    points = np.concatenate(places)
    found: list[tuple[list[int], Array | None]] = []
    for part in bodies.parts:
        here = [k for k, owner in enumerate(owners) if owner in (None, part.scene.body.name)]
        labels = [f"probe '{names[k]}'" for k in here]
        found.append((here, part.value_rows(points[here], labels) if here else None))

    def matrix() -> ProbeMatrix:
        joined = given(bodies.joined)
        rows = np.zeros((len(points), 6, joined.K.shape[0] + len(joined.r_star)))
        for k, (here, own) in enumerate(found):
            if own is not None:
                n = 2 * len(bodies.parts[k].contact.node)
                rows[here] = joined.rows(k, own[..., :n], own[..., n:])
        return ProbeMatrix(names, points, rows)

    return on_root(bodies.comm, matrix)


def _places(bodies: Stack, probe: Probe) -> Array:
    """Return the points (m, 2) of a probe; of an edge its nodes, of the whole contact."""
    if probe.edge is None:
        return np.array(probe.coordinates, dtype=float)
    scene = bodies.scene
    owner = scene.find_edge(probe.edge)[0]
    part = next(part for part in bodies.parts if part.scene.body.name == owner.name)
    found = []
    for (number, sign), side in zip(sides_of_body(scene, owner), part.contact.sides, strict=True):
        joint = scene.joints[number]
        if probe.edge == (joint.edge if sign > 0 else joint.against):
            found.append(side.points)
    points = np.concatenate(found)
    if bodies.parts[0].half and not scene.axisymmetric:
        image = points[points[:, 0] > POSITION_TOLERANCE * np.ptp(points[:, 0])]
        points = np.concatenate([image[::-1] * [-1.0, 1.0], points])
    return points


def gather_fields(parts: Sequence[BodyFields]) -> Fields | None:
    """Gather fields on rank 0 and complete half bodies by their mirror image; collective."""
    found = [_gather(part, k) for k, part in enumerate(parts)]
    pieces = [piece for piece in found if piece is not None]
    if not pieces:
        return None
    if len({piece.cells.shape[1] for piece in pieces}) > 1:
        # two triangles stand for each quadrilateral where another body has triangles
        for k, piece in enumerate(pieces):
            if piece.cells.shape[1] == 4:
                cells = np.vstack([piece.cells[:, :3], piece.cells[:, [0, 2, 3]]])
                twice = {name: np.tile(value, 2) for name, value in piece.cell_stress.items()}
                pieces[k] = replace(piece, cells=cells, cell_stress=twice)
    starts = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    stress, cell_stress = (
        {name: np.concatenate([each[name] for each in every]) for name in every[0]}
        for every in ([p.stress for p in pieces], [p.cell_stress for p in pieces])
    )
    return Fields(
        np.vstack([piece.points for piece in pieces]),
        np.vstack([piece.cells + start for piece, start in zip(pieces, starts, strict=False)]),
        np.vstack([piece.displacement for piece in pieces]),
        stress,
        cell_stress,
        np.concatenate([given(piece.body) for piece in pieces]) if len(parts) > 1 else None,
    )


def _gather(part: BodyFields, number: int) -> Fields | None:
    """Gather the fields of one body on rank 0, with the image of half of it."""
    space, stresses = part.displacement.function_space, part.stresses
    dofmap, comm = space.dofmap, part.bulk.comm
    constant = next(iter(stresses.cell.values())).function_space
    owned = constant.dofmap.index_map.size_local
    # around a quadrilateral, not in the order of a tensor product
    local = _dolfinx.cell_dofs(space)[:owned, _dolfinx.TENSOR_ORDER[part.bulk.body.cell]]
    cells = _dolfinx.global_nodes(space, local)
    n, dofs = dofmap.index_map.size_local, _dolfinx.cell_dofs(constant)[:owned, 0]
    own = (
        space.tabulate_dof_coordinates()[:n, :2],
        cells,
        part.displacement.x.array[: 2 * n].reshape(n, 2),
        np.array([function.x.array[:n] for function in stresses.nodal.values()]).T,
        np.array([function.x.array[dofs] for function in stresses.cell.values()]).T,
    )
    every = comm.gather(own, root=0)
    if every is None:
        return None
    points, cells, moved, *values = (np.vstack(each) for each in zip(*every, strict=True))
    at_vertices, in_cells = (
        dict(zip(stresses.cell, each.T.copy(), strict=True)) for each in values
    )
    if part.bulk.body.half:
        # u_x and s_xy change their sign in the image, which shares the vertices on the axis
        flip, axis = np.array([-1.0, 1.0]), np.abs(points[:, 0]) <= 1e-9 * np.abs(points).max()
        points[axis, 0] = at_vertices["sxy"][axis] = 0.0
        image = np.where(axis, np.arange(len(points)), len(points) - 1 + np.cumsum(~axis))
        cells = np.vstack([cells, image[cells[:, ::-1]]])
        points, moved = (np.vstack([a, a[~axis] * flip]) for a in (points, moved))
        at_vertices, in_cells = (
            {k: np.concatenate([v, -v[own] if k == "sxy" else v[own]]) for k, v in stress.items()}
            for stress, own in ((at_vertices, ~axis), (in_cells, slice(None)))
        )
    return Fields(points, cells, moved, at_vertices, in_cells, np.full(len(points), number))
