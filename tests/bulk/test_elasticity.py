"""Loads, supports, contact nodes, and fields, against closed forms."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest
from bodies import CELLS, ELEMENTS, block, built, condense, reactions
from dolfinx import fem
from numpy.typing import NDArray

from receding_fenicsx.bulk.body import Bulk, back_substitute
from receding_fenicsx.bulk.elasticity import warm_up as compile_forms
from receding_fenicsx.bulk.material import lame_constants
from receding_fenicsx.bulk.stress import STRESSES, stresses
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Body, Contact, Load, Material, Support

comm = MPI.COMM_WORLD
Array = NDArray[np.float64]
KINEMATICS = ("plane strain", "plane stress")


def resultant(bulk: Bulk, load: int = 0) -> Array:
    """Force in x and y, and moment about the origin, of a load's nodal forces."""
    force = bulk.loads[load].getArray(readonly=True).reshape(-1, 2)
    points = bulk.space.tabulate_dof_coordinates()[: len(force), :2]
    moment = points[:, 0] * force[:, 1] - points[:, 1] * force[:, 0]
    own = np.array([*force.sum(axis=0), moment.sum()])
    return comm.allreduce(own)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_stresses_of_a_given_field(cell: str, degree: int, kinematics: str) -> None:
    """Hooke's law by hand: linear at order 1, quadratic (so with linear stress) at order 2."""
    material = Material(3.0, 0.25, kinematics)
    bulk = built(block(cell, degree, material=material))
    a, b, c, d = 0.3, -0.2, 0.7, 0.5
    q = 0.4 if degree == 2 else 0.0
    field = fem.Function(bulk.space)
    field.interpolate(
        lambda x: np.array([a * x[0] + b * x[1] + q * x[0] ** 2, c * x[0] + d * x[1]])
    )
    field.x.scatter_forward()
    found = stresses(bulk, field)
    # Hooke's law, each stress from the strains; plane stress by its condition szz = 0
    young, nu = material.young, material.poisson
    middle = found.cell["sxx"].function_space.tabulate_dof_coordinates()[:, 0]
    exx, eyy, exy = a + 2.0 * q * middle, d, 0.5 * (b + c)
    if kinematics == "plane strain":
        factor = young / ((1.0 + nu) * (1.0 - 2.0 * nu))
        sxx = factor * ((1.0 - nu) * exx + nu * eyy)
        syy = factor * ((1.0 - nu) * eyy + nu * exx)
        szz = factor * nu * (exx + eyy)
    else:
        factor = young / (1.0 - nu**2)
        sxx, syy, szz = factor * (exx + nu * eyy), factor * (eyy + nu * exx), 0.0 * exx
    sxy = young / (1.0 + nu) * exy
    tensors = np.zeros((len(middle), 3, 3))
    tensors[:, 0, 0], tensors[:, 1, 1], tensors[:, 2, 2] = sxx, syy, szz
    tensors[:, 0, 1] = tensors[:, 1, 0] = sxy
    deviators = tensors - np.trace(tensors, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    mises = np.sqrt(1.5 * np.einsum("cij,cij->c", deviators, deviators))
    principal = np.linalg.eigvalsh(tensors[:, :2, :2])
    shear = 0.5 * (principal[:, 1] - principal[:, 0])
    for name, value in zip(STRESSES, (sxx, syy, szz, sxy, mises, shear), strict=True):
        assert found.cell[name].x.array == pytest.approx(
            np.broadcast_to(value, len(middle)), abs=1e-12
        )
    # every cell gives the same linear stress, and so does their average at a vertex
    at = found.nodal["sxx"].function_space.tabulate_dof_coordinates()[:, 0]
    along = factor * (1.0 - nu if kinematics == "plane strain" else 1.0)
    slope = along * 2.0 * q
    start = along * a + factor * nu * d
    assert found.nodal["sxx"].x.array == pytest.approx(start + slope * at, abs=1e-11)
    bulk.destroy()


@ELEMENTS
@pytest.mark.parametrize(
    ("load", "expected"),
    [
        # integral of 1 - x^2 over [-1, 1]
        (Load("a", "top", (-1.0, 1.0), pressure="1 - x**2"), (0.0, -4.0 / 3.0, 0.0)),
        # integrals of x and of x^2 over [0, 1]
        (Load("a", "top", (0.0, 1.0), pressure="x"), (0.0, -0.5, -1.0 / 3.0)),
        (Load("a", "right", pressure=2.0), (-2.0, 0.0, 1.0)),
        (Load("a", "left", pressure="y"), (0.5, 0.0, -1.0 / 3.0)),
        # a tent of height 3 on the upper quarter of the left edge
        (
            Load(
                "a",
                "left",
                (0.0, 0.5),
                traction=(0.0, {"x": [0.0, 0.25, 0.5], "value": [0.0, 3.0, 0.0]}),
            ),
            (0.0, 0.75, -1.5),
        ),
        (Load("a", "top", (-2.0, 2.0), traction=(0.5, "y + 1")), (2.0, 8.0, -2.0)),
        (Load("a", "bottom", (-2.0, -1.0), traction=(3.0, 0.0)), (3.0, 0.0, 0.0)),
    ],
)
def test_nodal_forces_have_the_resultant_of_the_traction(
    cell: str, degree: int, load: Load, expected: tuple[float, float, float]
) -> None:
    marks = Load("mark", "left", (0.25, 0.5), pressure=1.0)  # a vertex at the tent's top
    bulk = built(block(cell, degree, loads=(load, marks)))
    assert resultant(bulk) == pytest.approx(expected, abs=1e-13)
    bulk.destroy()


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_pressure_of_degree_12_on_one_element_is_integrated_exactly(cell: str, degree: int) -> None:
    # nodal shape functions make up 1, x and, at degree 2, x^2: x^14 in all
    scene = block(cell, degree, 4, load=Load("a", "top", (0.0, 2.0), pressure="x**12"))
    bulk = built(scene)
    places = bulk.space.tabulate_dof_coordinates()
    x = places[: bulk.space.dofmap.index_map.size_local, 0]
    down = -bulk.loads[0].getArray(readonly=True)[1::2]
    for power in range(degree + 1):
        moment = bulk.comm.allreduce(float(down @ x**power))
        assert moment == pytest.approx(2.0 ** (13 + power) / (13 + power), rel=1e-13), power
    loaded = bulk.comm.allreduce(int(np.count_nonzero(down)))
    assert loaded <= 2 * degree + 1, "the span has more elements than these moments are to test"
    bulk.destroy()


def test_loads_of_one_name_are_one_load() -> None:
    squeeze = tuple(Load("squeeze", edge, pressure=1.0) for edge in ("left", "right"))
    push = Load("push", "top", pressure=1.0)
    bulk = built(block(loads=(squeeze[0], push, squeeze[1])))
    assert bulk.load_names == ("squeeze", "push")
    assert resultant(bulk) == pytest.approx([0.0, 0.0, 0.0], abs=1e-14)
    assert resultant(bulk, 1) == pytest.approx([0.0, -4.0, 0.0], abs=1e-14)
    bulk.destroy()


def test_half_takes_half_of_the_load() -> None:
    loads = (
        Load("squeeze", "left", pressure=1.0),
        Load("squeeze", "right", pressure=1.0),
        Load("p0", "top", (-1.0, 1.0), pressure=3.0),
    )
    bulk = built(block(loads=loads), half=True)
    assert resultant(bulk)[:2] == pytest.approx([-1.0, 0.0], abs=1e-14)
    assert resultant(bulk, 1)[:2] == pytest.approx([0.0, -3.0], abs=1e-14)
    bulk.destroy()


@pytest.mark.parametrize(
    ("edge", "tangent", "normal"),
    [
        ("bottom", (1.0, 0.0), (0.0, 1.0)),
        ("top", (-1.0, 0.0), (0.0, -1.0)),
        ("left", (0.0, -1.0), (1.0, 0.0)),
        ("right", (0.0, 1.0), (-1.0, 0.0)),
    ],
)
def test_contact_frame_points_into_the_body(
    edge: str, tangent: tuple[float, float], normal: tuple[float, float]
) -> None:
    bulk = built(block(contacts=(Contact(edge=edge),), loads=()))
    contact = bulk.contact
    assert np.all(contact.tangent == tangent) and np.all(contact.normal == normal)
    length = 4.0 if edge in ("bottom", "top") else 1.0
    assert contact.sides[0].x == pytest.approx(length * np.arange(-8, 9) / 16, abs=1e-15)
    along = contact.points[:, 0] if length == 4.0 else contact.points[:, 1] - 0.5
    assert contact.sides[0].x == pytest.approx(along, abs=1e-15)
    bulk.destroy()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("span", [None, (-1.0, 1.0)])
def test_contact_nodes_and_weights(
    degree: int, half: bool, span: tuple[float, float] | None
) -> None:
    bulk = built(block(degree=degree, contacts=(Contact(span=span),)), half)
    contact = bulk.contact
    reach = 2.0 if span is None else span[1]
    elements = int(reach / 0.25) * (1 if half else 2)
    assert contact.sides[0].x == pytest.approx(
        np.linspace(0.0 if half else -reach, reach, degree * elements + 1), abs=1e-15
    )
    # integrals of the hat functions, and of the quadratic ones (Simpson's rule)
    pattern = [0.5, 0.5] if degree == 1 else [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0]
    expected = np.zeros(degree * elements + 1)
    for element in range(elements):
        expected[degree * element : degree * (element + 1) + 1] += 0.25 * np.array(pattern)
    assert contact.sides[0].weight == pytest.approx(expected, rel=1e-13)
    bulk.destroy()


@pytest.mark.parametrize(
    ("supports", "half", "motions"),
    [
        ((), False, 3),
        ((), True, 1),
        ((Support("x", point=(0.0, 1.0)),), False, 2),
        ((Support("xy", point=(0.0, 1.0)),), False, 1),
        ((Support("x", edge="right"),), False, 1),
        ((Support("y", edge="right"),), False, 2),
        ((Support("xy", edge="right"),), False, 0),
        ((Support("y", edge="right"),), True, 0),
        ((Support("x", point=(0.0, 0.0)), Support("y", edge="top")), False, 0),
        ((Support("x", point=(-2.0, 0.0)), Support("x", point=(2.0, 0.0))), False, 2),
    ],
)
def test_rigid_motions_left_by_supports(
    supports: tuple[Support, ...], half: bool, motions: int
) -> None:
    bulk = built(block(supports=supports, loads=()), half)
    contact = bulk.contact
    n = len(contact.node)
    assert contact.rigid.shape == (2 * n, motions)
    if motions:
        assert np.linalg.matrix_rank(contact.rigid) == motions
        assert np.abs(contact.rigid).max(axis=0) == pytest.approx(np.ones(motions))
    # each is a rigid motion: v constant, w linear along the edge; and it respects what is held
    v, w = contact.rigid[:n], contact.rigid[n:]
    assert np.abs(np.diff(v, axis=0)).max(initial=0.0) < 1e-14
    assert np.abs(np.diff(w, 2, axis=0)).max(initial=0.0) < 1e-13
    assert np.abs(contact.rigid[contact.held]).max(initial=0.0) < 1e-14
    bulk.destroy()


def test_held_contact_degrees_of_freedom() -> None:
    n = 17
    bulk = built(block(supports=(Support("x", edge="right"),)))
    assert np.flatnonzero(bulk.contact.held).tolist() == [n - 1]
    bulk.destroy()
    bulk = built(block(supports=(Support("xy", edge="left"),)))
    assert np.flatnonzero(bulk.contact.held).tolist() == [0, n]
    bulk.destroy()
    bulk = built(block(), half=True)
    assert np.flatnonzero(bulk.contact.held).tolist() == [0]
    bulk.destroy()
    # on an upright edge the tangent is y
    supports = (Support("y", edge="top"),)
    bulk = built(block(contacts=(Contact(edge="right"),), supports=supports, loads=()))
    assert np.flatnonzero(bulk.contact.held).tolist() == [n - 1]
    bulk.destroy()


@ELEMENTS
@pytest.mark.parametrize(
    ("half", "supports"),
    [(False, ()), (True, ()), (False, (Support("xy", edge="right"),))],
)
def test_field_carries_the_condensed_reactions(
    cell: str, degree: int, half: bool, supports: tuple[Support, ...]
) -> None:
    loads = (
        Load("p0", "top", (-1.0, 1.0), pressure=1.0),
        Load("shear", "top", traction=(1.0, 0.0)),
        Load("under", "bottom", (-1.0, 1.0), pressure=1.0),
    )
    bulk = built(block(cell, degree, loads=loads, supports=supports), half)
    system = condense(bulk)
    load = np.array([0.8, -0.3, 0.5])
    u = None
    if system is not None:
        u = np.where(system.held, 0.0, np.random.default_rng(3).normal(size=2 * system.n))
    field = back_substitute(bulk, load, u)
    found = reactions(bulk, load, field)
    # the loads' displacements: their nodal forces times the field
    own = field.x.array[: bulk.loads[0].getLocalSize()]
    moved = comm.allreduce(np.array([f.getArray(readonly=True) @ own for f in bulk.loads]))
    if system is not None:
        assert u is not None and found is not None
        r = load @ system.r_star + system.K @ u
        assert np.abs(found - r).max() < 1e-11 * np.abs(r).max()
        by_formula = system.load_compliance @ load + system.load_sign * (system.r_star @ u)
        assert by_formula == pytest.approx(moved, rel=1e-11)
        if not supports:
            # equilibrium of the body: the plane carries what the load below does not
            down = (0.8 - 0.5) * (1.0 if half else 2.0)
            scale = np.abs(r).sum()
            assert abs(r[system.n :].sum() - down) < 1e-12 * scale
            if not half:
                assert abs(r[: system.n].sum() + load[1] * 4.0) < 1e-12 * scale
    bulk.destroy()


BELOW = Load("under", "bottom", (-1.0, 1.0), pressure="1 + x")
MOVED = Load("d", "right", (0.0, 0.5), displacement=(0.02, "0.01*y"))


@pytest.mark.parametrize(
    ("edge", "load"), [("left", BELOW), ("right", BELOW), ("top", BELOW), ("bottom", MOVED)]
)
def test_field_above_any_edge_carries_the_condensed_reactions(edge: str, load: Load) -> None:
    """On an upright edge t and n are y and x; a moved edge shares its elements with contact."""
    bulk = built(block("quadrilateral", 2, 8, contacts=(Contact(edge=edge),), loads=(load,)))
    system = condense(bulk)
    factor, u = np.array([0.7]), None
    if system is not None:
        u = np.cos(1.0 + np.arange(2.0 * system.n) ** 2)
    found = reactions(bulk, factor, back_substitute(bulk, factor, u))
    if system is not None:
        assert found is not None and u is not None
        r = factor @ system.r_star + system.K @ u
        assert np.abs(found - r).max() < 1e-11 * np.abs(r).max()
        # nothing but the element between them passes a motion on so strongly
        assert load is BELOW or np.abs(system.r_star[0, [system.n - 1, -1]]).max() > 1e-3
    bulk.destroy()


def test_profile_that_cannot_be_evaluated_is_refused_on_all_ranks() -> None:
    with pytest.raises(InputError, match="finite"):
        built(block(loads=(Load("a", "top", pressure="sqrt(x)"),)))


def test_forms_are_timed_apart() -> None:
    assert compile_forms(comm, "triangle", 2) > 0.0
    bulk = built(block(degree=2))
    assert set(bulk.seconds) == {"forms", "assemble"}
    assert all(value > 0.0 for value in bulk.seconds.values())
    bulk.destroy()


@pytest.mark.parametrize("nu", [-0.4, 0.3, 0.8])
def test_plane_stress_is_plane_strain_of_another_material(nu: float) -> None:
    """E' = E (1 + 2 nu) / (1 + nu)^2, nu' = nu / (1 + nu) give plane stress in plane strain."""
    young = 2.0
    stress = Material(young, nu, "plane stress")
    strain = Material(young * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu), "plane strain")
    constants = [np.array(lame_constants(m)) * m.young for m in (stress, strain)]
    assert constants[0] == pytest.approx(constants[1], rel=1e-14)
    systems = []
    for material in (stress, strain):
        bulk = built(block(degree=2, material=material, body=Body(width=4.0, height=1.0)))
        systems.append(condense(bulk))
        bulk.destroy()
    if systems[0] is not None and systems[1] is not None:
        difference = np.abs(systems[0].K - systems[1].K).max()
        assert difference < 1e-13 * np.abs(systems[0].K).max()
