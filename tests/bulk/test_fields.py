"""Fields of whole bodies against probes, which take their values by another way."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS
from kinds import EVEN, UNEVEN, pair

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.bulk import _dolfinx, stack
from receding_fenicsx.bulk.elasticity import reference
from receding_fenicsx.bulk.fields import (
    Fields,
    fields_at,
    gather_fields,
    probe_matrix,
    solve_fields,
)
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.evolution.replay import turning_point
from receding_fenicsx.timing import Timer

pytestmark = pytest.mark.one_rank
SCENES = EVEN | UNEVEN
PLANES = SCENES["half-planes"]
SCENES["half-planes, upside down"] = replace(
    PLANES,
    others=(replace(PLANES.others[0], window=(3.0, 2.0)),),
    contacts=(rf.Contact("a.top", (-0.75, 1.25), 0.4, "(x - 0.25)**2/200", "b.bottom"),),
    loads=(replace(PLANES.loads[0], force=(0.2, 1.0)), *PLANES.loads[1:]),
    probes=(),
)


STAR = 1e-3 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@cache
def probed(name: str) -> tuple[rf.Record, Fields, list[Ints], list[Array], list[rf.Body]]:
    """Record, fields, vertices and middles of cells at probes, middles of stars, and bodies."""
    scene = SCENES[name]
    bulk = bulk_of(scene, MPI.COMM_SELF, Timer(None))
    parts = [part.scene.body for part in bulk.parts]
    system = rf.given(stack.condense(bulk))
    found = rf.given(fields_at(bulk, np.zeros(len(system.load_names)), np.zeros(2 * system.n)))
    vertices, middles = len(found.points), found.points[found.cells].mean(axis=1)
    half = bulk.parts[0].half or any(part.is_half_plane for part in parts)
    assert half or scene.mesh.degree == 2 or bulk.dofs == 2 * vertices
    places = np.vstack([found.points, middles])
    bodies = np.zeros(vertices, int) if found.body is None else found.body
    bodies = np.append(bodies, bodies[found.cells[:, 0]])
    probes, chosen, centres = [], [], []
    for k, body in enumerate(parts):
        # averages at the axis are those of one side
        own = np.flatnonzero((bodies == k) & (np.abs(places[:, 0]) > 1e-9))
        if body.is_half_plane:  # away from the surface, where stresses are singular at nodes
            y = places[own, 1]
            depth = np.abs(y - y[np.argmin(np.abs(y))])
            own = own[(depth > 0.2 * np.ptp(y)) & (own < vertices)]
        if scene.axisymmetric:
            own = own[places[own, 0] >= 0.0]
        inside = own if body.is_half_plane else own[own >= vertices]
        chosen.append(own[np.linspace(0, len(own) - 1, 25).astype(int)])
        centres.append(places[inside[np.linspace(0, len(inside) - 1, 9).astype(int)]])
        stars = (centres[k][:, None] + STAR).reshape(-1, 2)
        for kind, points in (("of", places[chosen[k]]), ("around", stars)):
            at, of = tuple(map(tuple, points.tolist())), body.name if scene.others else None
            probes.append(rf.Probe(f"{kind} {k}", points=at, body=of))
    scene = replace(scene, probes=tuple(probes), fatigue=None)
    system = replace(system, probes=probe_matrix(bulk, scene), scene_toml=rf.to_toml(scene))
    record = rf.evolve(system, scene)
    now = turning_point(record, system, -1)
    moved = fields_at(bulk, record.turning_points.load[-1], np.concatenate([now.v, now.w]))
    bulk.destroy()
    return record, rf.given(moved), chosen, centres, parts


@pytest.mark.parametrize("name", SCENES)
def test_fields_of_bodies_are_those_of_probes(name: str) -> None:
    """At vertices and in the middle of cells, on both sides of a half or of the axis."""
    record, found, chosen, _, parts = probed(name)
    size = np.abs(found.displacement).max()
    assert not (record.half and found.stress["sxy"][found.points[:, 0] == 0.0].any())
    for k, own in enumerate(chosen):
        probe, at_vertex = record.probe(f"of {k}"), own < len(found.points)
        row = np.flatnonzero(probe.kind == "turning point")[-1]
        u = found.displacement[own[at_vertex]]
        assert np.abs(probe.displacement[row][at_vertex] - u).max() < 1e-9 * size
        values = dict(zip(("sxx", "syy", "szz", "sxy"), probe.stress[row].T, strict=True))
        largest = np.abs(probe.stress[row]).max()
        for part, stress in values.items():
            known = np.append(found.stress[part], found.cell_stress[part])[own]
            assert np.abs(stress - known).max() < 1e-9 * largest, part
        # at vertices of elements these are averages over cells
        exact = ~at_vertex | parts[k].is_half_plane
        values["von_mises"] = probe.von_mises[row]
        values["max_shear"] = np.hypot(0.5 * (values["sxx"] - values["syy"]), values["sxy"])
        for part in ("von_mises", "max_shear"):
            known = np.append(found.stress[part], found.cell_stress[part])[own]
            assert np.abs(values[part] - known)[exact].max() < 1e-9 * largest, part


@pytest.mark.parametrize("name", SCENES)
def test_stresses_at_probes_follow_hookes_law(name: str) -> None:
    """From differences of displacements in a cell, in which they are at most quadratic."""
    scene = SCENES[name]
    if any(load.thermal_strain for load in scene.loads) or scene.material.young_2:
        pytest.skip("other strains, other stiffness")
    record, _, _, centres, parts = probed(name)
    for k, body in enumerate(parts):
        material, probe = scene.material_of(body), record.probe(f"around {k}")
        u, stress = probe.displacement[-1].reshape(-1, 5, 2), probe.stress[-1].reshape(-1, 5, 4)
        by_x, by_y = (0.5 / STAR.max() * (u[:, i] - u[:, i + 1]) for i in (1, 3))
        xx, yy, nu = by_x[:, 0], by_y[:, 1], material.poisson
        zz = {
            "plane strain": 0.0 * xx,
            "plane stress": -nu / (1.0 - nu) * (xx + yy),
            "axisymmetric": u[:, 0, 0] / centres[k][:, 0],
        }[material.kinematics]
        mu = 0.5 * material.young / (1.0 + nu)
        bulk = 2.0 * mu * nu / (1.0 - 2.0 * nu) * (xx + yy + zz)
        shear = mu * (by_x[:, 1] + by_y[:, 0])
        known = np.stack([*(2.0 * mu * e + bulk for e in (xx, yy, zz)), shear], axis=1)
        size = np.abs(known).max()
        tolerance = 1e-4 if body.is_half_plane else 1e-8
        assert np.abs(stress[:, 0] - known).max() < tolerance * size


def test_quadrilaterals_beside_triangles_are_two_triangles_of_the_same_stresses() -> None:
    load, below = rf.Load("T", "a.left", traction=(0.02, 0.0)), rf.Body("b", shape="half-plane")
    held = rf.Support("xy", edge="b.far")
    scene = pair(load, cell="quadrilateral", others=(below,), supports=(held,), probes=())
    bodies = bulk_of(scene, MPI.COMM_SELF, Timer(None))
    nodes = rf.given(rf.condense(scene, MPI.COMM_SELF)).n
    turned = replace(scene, contacts=(rf.Contact("b.top", against="a.bottom"),))
    assert len(stack.contact_of(turned)[0].x) == nodes
    parts = solve_fields(bodies, np.ones(2), np.random.default_rng(1).standard_normal(2 * nodes))
    alone, both = (rf.given(gather_fields(some)) for some in (parts[:1], parts))
    bodies.destroy()
    own = rf.given(both.body)[both.cells[:, 0]] == 0
    around = [[set(cell) <= set(quad) for quad in alone.cells] for cell in both.cells[own]]
    assert np.all(np.sum(around, axis=0) == 2)
    centres = [both.points[both.cells[own]].mean(axis=1), alone.points[alone.cells].mean(axis=1)]
    assert 0.5 * np.array(around).T @ centres[0] == pytest.approx(centres[1])
    for name, stress in alone.cell_stress.items():
        assert np.array_equal(both.cell_stress[name][own], stress[np.argmax(around, axis=1)])


def test_windows_of_half_planes_are_where_and_as_large_as_asked_for() -> None:
    found = probed("half-planes, upside down")[1]
    for body, size, upper in ((0, (4.0, 2.0), False), (1, (3.0, 2.0), True)):
        x, y = found.points[found.body == body].T
        assert [x.min(), x.max()] == pytest.approx([0.25 - 0.5 * size[0], 0.25 + 0.5 * size[0]])
        ends = [0.0, size[1]] if upper else [-size[1], 0.0]
        assert [y.min(), y.max()] == pytest.approx(ends)


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
