"""Fields of the bodies, and their values at probes, from contact displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx
from receding_fenicsx.bulk.mesh.rectangle import POSITION_TOLERANCE
from receding_fenicsx.bulk.stack import Body, Stack
from receding_fenicsx.bulk.stress import Stresses
from receding_fenicsx.interface.system import ProbeMatrix
from receding_fenicsx.mpi import given, on_root
from receding_fenicsx.scene.model import Probe, Scene
from receding_fenicsx.scene.one_body import sides_of_body


@dataclass(frozen=True)
class BodyFields:
    """Fields of one modelled body, distributed over the ranks.

    Attributes:
        bulk: the body.
        displacement: displacement in the space of degree 1, that of the mesh.
        stresses: stresses in the cells and at the vertices.
    """

    bulk: Body
    displacement: fem.Function
    stresses: Stresses


@dataclass(frozen=True)
class Fields:
    """Displacement and stresses at the vertices of the whole body, on rank 0.

    Attributes:
        points: (n, 2) vertices.
        cells: (m, 3 or 4) vertices around each cell.
        displacement: (n, 2) displacement.
        stress: by name ("sxx", "syy", "szz", "sxy", "von_mises", "max_shear"), (n,) averages over
            the cells around each vertex.
        body: (n,) number of the body that each vertex belongs to; None for one body.
    """

    points: Array
    cells: NDArray[np.int64]
    displacement: Array
    stress: dict[str, Array]
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
    """Return the values at all probes of a scene (at least one), on rank 0; collective.

    Raises:
        InputError: a point lies outside its body; on all ranks.
    """
    bodies.condense()
    places = [_places(bodies, probe) for probe in scene.probes]
    counted = list(zip(scene.probes, places, strict=True))
    names = tuple(probe.name for probe, found in counted for _ in found)
    owners = [_owner(scene, probe) for probe, found in counted for _ in found]
    points = np.concatenate(places)
    found: list[tuple[list[int], Array | None]] = []
    for part in bodies.parts:
        here = [k for k, owner in enumerate(owners) if owner in (None, part.scene.body.name)]
        labels = [f"probe '{names[k]}'" for k in here]
        found.append((here, part.value_rows(points[here], labels) if here else None))

    def matrix() -> ProbeMatrix:
        joined, every = given(bodies.joined), bodies.load_names + bodies.link_names
        rows = np.zeros((len(points), 6, joined.K.shape[0] + len(joined.r_star)))
        for k, (here, own) in enumerate(found):
            if own is not None:
                part = bodies.parts[k]
                n = 2 * len(part.contact.node)
                of_loads = np.zeros((*own.shape[:-1], len(every)))
                of_loads[..., [every.index(name) for name in part.load_names]] = own[..., n:]
                rows[here] = joined.rows(k, own[..., :n], of_loads)
        return ProbeMatrix(names, points, rows)

    return on_root(bodies.comm, matrix)


def _owner(scene: Scene, probe: Probe) -> str | None:
    """Return the name of a probe's body; None for the only one."""
    if probe.edge is None:
        return probe.body
    return scene.find_edge(probe.edge)[0].name if scene.others else None


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
    if bodies.half and not scene.axisymmetric:
        image = points[points[:, 0] > POSITION_TOLERANCE * np.ptp(points[:, 0])]
        points = np.concatenate([image[::-1] * [-1.0, 1.0], points])
    return points


def gather_fields(parts: Sequence[BodyFields]) -> Fields | None:
    """Gather fields on rank 0 and complete half bodies by their mirror image; collective."""
    bodies = []
    for part in parts:
        points, cells, vectors = _gather(part.bulk, part.displacement)
        nodal = {name: _gather(part.bulk, f)[2] for name, f in part.stresses.nodal.items()}
        if part.bulk.comm.rank == 0:
            values = {name: value[:, 0] for name, value in nodal.items()}
            whole = Fields(points, cells, vectors, values)
            bodies.append(_mirrored(whole) if part.bulk.body.half else whole)
    return _together(bodies) if len(bodies) > 1 else bodies[0] if bodies else None


def gather_cell_stresses(parts: Sequence[BodyFields]) -> dict[str, Array] | None:
    """Gather by name the stress of each cell of :func:`gather_fields` on rank 0; collective."""
    bodies = []
    for part in parts:
        stresses = part.stresses.cell
        space = next(iter(stresses.values())).function_space
        dofs = _dolfinx.cell_dofs(space)[: space.dofmap.index_map.size_local, 0]
        values = [function.x.array[dofs] for function in stresses.values()]
        own: Any = part.bulk.comm.gather(values, root=0)
        if own is not None:
            whole = dict(zip(stresses, np.concatenate(own, axis=1), strict=True))
            bodies.append(_with_image(whole) if part.bulk.body.half else whole)
    if not bodies:
        return None
    if len({part.bulk.body.cell for part in parts}) > 1:
        # each quadrilateral is two triangles
        for part, stress in zip(parts, bodies, strict=True):
            if part.bulk.body.cell == "quadrilateral":
                stress.update({name: np.tile(value, 2) for name, value in stress.items()})
    return {name: np.concatenate([body[name] for body in bodies]) for name in bodies[0]}


def _gather(bulk: Body, function: fem.Function) -> tuple[Array, NDArray[np.int64], Array]:
    """Bring points, cells and values of a function of degree 1 to rank 0; empty elsewhere."""
    space = function.function_space
    dofmap, block = space.dofmap, space.dofmap.index_map_bs
    topology = bulk.body.mesh.topology
    owned_cells = topology.index_map(topology.dim).size_local
    local = _dolfinx.cell_dofs(space)[:owned_cells]
    width = {"triangle": 3, "quadrilateral": 4}[bulk.body.cell]
    cells = dofmap.index_map.local_to_global(local.ravel()).reshape(-1, width)
    n = dofmap.index_map.size_local
    points = space.tabulate_dof_coordinates()[:n, :2]
    values = function.x.array[: n * block].reshape(n, block)
    parts: Any = bulk.comm.gather((points, cells, values), root=0)
    if bulk.comm.rank != 0:
        return points, cells, values
    points, cells, values = (np.vstack([part[k] for part in parts]) for k in range(3))
    # DOLFINx numbers a quadrilateral's vertices like a tensor product, pictures go around it
    return points, cells if width == 3 else cells[:, [0, 1, 3, 2]], values


def _together(bodies: Sequence[Fields]) -> Fields:
    """Return the fields of several bodies in one."""
    cells = [body.cells for body in bodies]
    if len({c.shape[1] for c in cells}) > 1:
        # triangles stand for quadrilaterals where another body has triangles
        cells = [np.vstack([c[:, :3], c[:, [0, 2, 3]]]) if c.shape[1] == 4 else c for c in cells]
    sizes = [len(body.points) for body in bodies]
    starts = np.cumsum([0, *sizes[:-1]])
    return Fields(
        np.vstack([body.points for body in bodies]),
        np.vstack([c + start for c, start in zip(cells, starts, strict=True)]),
        np.vstack([body.displacement for body in bodies]),
        {name: np.concatenate([b.stress[name] for b in bodies]) for name in bodies[0].stress},
        np.repeat(np.arange(len(bodies)), sizes),
    )


def _mirrored(half: Fields) -> Fields:
    """Add the image of the half x >= 0: u_x and s_xy change their sign."""
    n = len(half.points)
    flip = np.array([-1.0, 1.0])
    return Fields(
        np.vstack([half.points, half.points * flip]),
        np.vstack([half.cells, half.cells[:, ::-1] + n]),
        np.vstack([half.displacement, half.displacement * flip]),
        _with_image(half.stress),
    )


def _with_image(stress: dict[str, Array]) -> dict[str, Array]:
    """Return stresses of a half body with those of its image."""
    return {
        name: np.concatenate([value, -value if name == "sxy" else value])
        for name, value in stress.items()
    }
