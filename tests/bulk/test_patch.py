"""The whole way on blocks whose answer is known: uniform pressure, and sliding under shear."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import CELLS, ELEMENTS, block, built
from numpy.typing import NDArray
from small import named_loads

import receding_fenicsx as rf
from receding_fenicsx.bulk.body import back_substitute
from receding_fenicsx.bulk.stress import stresses
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.scene.symmetry import is_half_meshed

Array = NDArray[np.float64]
FRICTION = 0.35


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kinematics", ["plane strain", "plane stress", "axisymmetric"])
@pytest.mark.parametrize("symmetry", ["auto", "none"])
def test_uniform_pressure_on_a_free_sliding_block_gives_uniform_stress(
    cell: str, degree: int, kinematics: str, symmetry: str
) -> None:
    p, young, nu = 0.75, 2.0, 0.3
    scene = block(
        cell,
        degree,
        load=rf.Load("p", "top", pressure=1.0),
        material=rf.Material(young, nu, kinematics),
        contacts=(rf.Contact(friction=0.0),),
        history=rf.HistoryOptions(kind="monotonic", maximum=p),
        solver=rf.SolverOptions(symmetry=symmetry),
    )
    system = rf.condense(scene)
    u = None
    if system is not None:
        record = rf.evolve(system, scene)
        table = record.turning_points
        assert table.p[-1] == pytest.approx(p, rel=1e-11)
        assert np.abs(table.q[-1]).max() == 0.0
        stretch = nu * (1.0 + nu) if kinematics == "plane strain" else nu
        slid = table.v[-1] - stretch * p / young * record.x
        assert np.ptp(slid) < 1e-12
        assert record.residual_max < 1e-13
        modelled = ~mirror_of(system).left
        u = np.concatenate([table.v[-1][modelled], table.w[-1][modelled]])
    bulk = built(scene, is_half_meshed(scene))
    field = stresses(bulk, back_substitute(bulk, np.array([p]), u))
    szz = -nu * p if kinematics == "plane strain" else 0.0
    for name, value in (("sxx", 0.0), ("syy", -p), ("szz", szz), ("sxy", 0.0)):
        for function in (field.cell[name], field.nodal[name]):
            assert np.abs(function.x.array - value).max() < 2e-12, name
    bulk.destroy()


def sheared(
    shear: float, poisson: float, loads: tuple[rf.Load, ...], cell: str, degree: int
) -> rf.Scene:
    """A block under its weight, sheared up to a multiple of f times the weight."""
    names = ("weight", *(load.name for load in loads))
    rows = ((1.0,) + (0.0,) * len(loads), (1.0,) + (shear,) * len(loads))
    return block(
        cell,
        degree,
        elements=32 // degree,
        loads=(rf.Load("weight", "top", pressure=1.0), *loads),
        material=rf.Material(1.0, poisson),
        contacts=(rf.Contact(friction=FRICTION),),
        history=rf.HistoryOptions(kind="table", columns=names, rows=rows),
    )


def sliding_factors(system: rf.ContactSystem, scene: rf.Scene, solver: rf.SolverOptions) -> Array:
    """Load factors at which gross sliding is reported."""
    with pytest.raises(rf.NoEquilibrium, match="gross sliding") as caught:
        rf.evolve(system, rf.history_from_scene(scene), solver)
    return np.array(named_loads(caught.value, *system.load_names))


TOP = rf.Load("top", "top", traction=(FRICTION, 0.0))
SIDES = (
    rf.Load("right", "right", traction=(0.0, FRICTION)),
    rf.Load("left", "left", traction=(0.0, -FRICTION)),
)


@ELEMENTS
@pytest.mark.parametrize(
    ("loads", "poisson"), [((TOP, *SIDES), 0.0), ((TOP,), 0.3)], ids=["uniform", "top"]
)
def test_block_sticks_at_99_percent_of_friction_and_slides_at_100(
    cell: str, degree: int, loads: tuple[rf.Load, ...], poisson: float
) -> None:
    """In uniform stress all of it sticks; sheared at its top only, some of it does."""
    scene = sheared(0.99, poisson, loads, cell, degree)
    system = rf.condense(scene)
    if system is None:
        return
    record = rf.evolve(system, scene)
    state, Q = record.turning_points.state[-1], record.turning_points.Q[-1]
    assert Q.sum() == pytest.approx(-0.99 * FRICTION * 4.0, rel=1e-12)
    assert np.any(state == rf.State.STICK)
    if len(loads) == 3:
        assert np.all(state == rf.State.STICK)
        assert record.turning_points.q[-1] == pytest.approx(-0.99 * FRICTION, rel=1e-11)
        assert record.turning_points.p[-1] == pytest.approx(1.0, rel=1e-11)
    beyond = sheared(1.01, poisson, loads, cell, degree)
    assert sliding_factors(system, beyond, beyond.solver) == pytest.approx(1.0, rel=1e-8)
