"""Springs on edges, at points and between bodies: hand formulas, work, bad input."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import ONCE, block, cylinder, last, played

import receding_fenicsx as rf
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.modal import _modes
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.timing import Timer

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

comm = MPI.COMM_WORLD
TWO_LAYERS = Path(__file__).parents[1] / "refused" / "files" / "two.geo"
E, K = 2.0, 0.7
SMOOTH = (rf.Contact(friction=0.0),)


@pytest.mark.parametrize("at", ["top", (1.0, 1.0)])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("round_", [False, True])
def test_pushed_block_shares_its_load_with_the_foundation(
    degree: int, round_: bool, at: str | tuple[float, float]
) -> None:
    """At nu = 0 a platen moves by d = F / (E A / H + k), and the plane carries E A d / H.

    k is that of a bed of K all over the top, or of one spring, of a ring the full circle.
    """
    make, area = (cylinder, 4.0 * np.pi) if round_ else (block, 4.0)
    bed = at == "top"
    parts: dict[str, Any] = {
        "material": rf.Material(E, 0.0, "axisymmetric" if round_ else "plane strain"),
        "springs": (rf.Spring("top", normal=K) if bed else rf.Spring(point=at, y=K),),
        "loads": (rf.Load("p", "top", platen=True, force=(0.0, -0.3)),),
        "history": ONCE,
    }
    record = played(make("triangle", degree, contacts=SMOOTH, **parts))
    moved = 0.3 / (E * area + K * (area if bed else 1.0))
    assert record.half == (bed and not round_) or round_
    assert record.turning_points.P[-1].sum() == pytest.approx(E * area * moved, rel=1e-9)
    assert record.turning_points.load_displacement[-1, 0] == pytest.approx(0.3 * moved, rel=1e-9)


def tied(young: float, degree: int = 1, edge: str = "a.bottom", **parts: Any) -> rf.Scene:
    """A layer on another one, tied beside an open contact by springs of 2 and 1.5 on length 2."""
    bodies = [rf.Body(name, height=0.5, position=(0.0, y)) for name, y in (("a", 0.5), ("b", 0.0))]
    other = {"a.bottom": "b.top", "b.top": "a.bottom"}[edge]
    scene = replace(
        block(degree=degree, material=rf.Material(young, 0.3)),
        body=bodies[0],
        others=(bodies[1],),
        contacts=(rf.Contact("a.bottom", (-0.5, 0.5), 0.3, initial_gap=0.2, against="b.top"),),
        loads=(rf.Load("P", "a.top", pressure=0.3), rf.Load("Q", "a.top", traction=(0.1, 0.0))),
        supports=(rf.Support("xy", edge="b.bottom"),),
        springs=tuple(
            rf.Spring(edge, span, 2.0, 1.5, against=other) for span in ((-1.5, -0.5), (0.5, 1.5))
        ),
        history=rf.HistoryOptions(
            "table", columns=("P", "Q"), rows=((0.5, 0.0), (1.0, 0.0), (1, 1))
        ),
    )
    return replace(scene, **parts)


@pytest.mark.parametrize("edge", ["a.bottom", "b.top"])
@pytest.mark.parametrize("degree", [1, 2])
def test_stiff_bodies_rest_on_the_springs_between_them(degree: int, edge: str) -> None:
    """P / (k_n L) until the gap of 0.2 closes; the contact then carries the rest, with friction."""
    table = played(tied(1e8, degree, edge)).turning_points
    np.testing.assert_allclose(table.w[0], -0.6 / 4.0, rtol=1e-6)
    np.testing.assert_allclose(table.P[1].sum(), 1.2 - 4.0 * 0.2, rtol=1e-5)
    np.testing.assert_allclose(table.v[2], (0.4 - 0.3 * 0.4) / 3.0, rtol=1e-5)


COAT, CORE = rf.Material(10.0, 0.3, name="coat"), rf.Material(1.0, 0.2, name="core")


def two(folder: Path, **parts: object) -> rf.Scene:
    """A coat of 1 below a core of 1, 4 long, pressed unevenly onto a plane."""
    path = folder / "two.geo"
    rf.on_root(comm, lambda: path.write_text(TWO_LAYERS.read_text()))
    scene = rf.Scene(
        body=rf.Body(mesh=str(path)),
        materials=(COAT, CORE),
        contacts=(rf.Contact("foot", friction=0.3),),
        loads=(rf.Load("P", "top", pressure="0.1 + 0.01*x"),),
        history=ONCE,
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


def test_two_materials_in_one_mesh_vibrate_as_two_tied_bodies(shared_tmp_path: Path) -> None:
    """The rows "coated" of alike.txt compare their records."""
    dense = tuple(replace(m, density=rho) for m, rho in ((COAT, 4.0), (CORE, 1.0)))
    one = two(shared_tmp_path, materials=dense)
    coat, core = (rf.Body(name, mesh=one.body.mesh, surface=name) for name in ("coat", "core"))
    tied = replace(
        one,
        body=coat,
        others=(core,),
        contacts=(rf.Contact("coat.foot", friction=0.3),),
        ties=(rf.Tie("core.seam", against="coat.seam"),),
        loads=(replace(one.loads[0], edge="core.top"),),
    )
    omega = []
    for scene in (one, tied):
        bulk = bulk_of(scene, MPI.COMM_SELF, Timer(None))
        omega.append(_modes(bulk, np.ones(2 * len(bulk.contact.x), dtype=bool), 1, 3)[1])
        bulk.destroy()
    assert omega[0] == pytest.approx(omega[1], rel=1e-9)


def test_beam_of_two_materials_bends_as_timoshenko_says(shared_tmp_path: Path) -> None:
    """Under its own stress E_i (y - c) k at the end, tied to a wall; c is the weighted middle.

    Without Poisson's effect u_y = -k x^2 / 2 is exact, also in elements of order 2.
    """
    young, height, k = np.array([10.0, 1.0]), np.array([0.5, 1.5]), 0.001
    c = float(young @ height / young.sum())
    stress = f"where(y < 1, 10, 1)*(y - {c!r})*{k}"
    found = last(
        two(
            shared_tmp_path,
            materials=tuple(replace(m, poisson=0.0) for m in (COAT, CORE)),
            ties=(rf.Tie("wall"),),
            loads=(rf.Load("M", "end", traction=(stress, 0.0)),),
            probes=(rf.Probe("s", points=((4.0, 2.0), (2.0, 0.5), (2.0, 1.5))),),
            contacts=(rf.Contact("foot", initial_gap=1.0),),
        )
    )
    probe = found[1].probe("s")
    # E_i k in each layer by its own modulus; sum E_i I_i k^2 L of work
    bend = float(young @ (1.0 / 12.0 + (height - c) ** 2))
    assert probe.displacement[-1, 0, 1] == pytest.approx(-0.5 * k * 4.0**2, rel=1e-8)
    assert probe.stress[-1, 1:, 0] == pytest.approx(young * (height - c) * k, rel=1e-8)
    work = found[1].turning_points.load_displacement[-1, 0]
    assert work == pytest.approx(bend * k**2 * 4.0, rel=1e-8)


FIBRES = rf.Material(8.0, 0.25, "plane stress", young_2=2.0, shear=0.7)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0])
@pytest.mark.parametrize("degree", [1, 2])
def test_orthotropic_block_has_the_compliance_across_its_fibres(angle: float, degree: int) -> None:
    """1/E_y = s^4/E_1 + c^4/E_2 + s^2 c^2 (1/G - 2 nu/E_1) (Lekhnitskii), c = cos(angle)."""
    scene = block(
        degree=degree,
        material=replace(FIBRES, angle=angle),
        load=rf.Load("p", "top", pressure=0.1),
        contacts=(rf.Contact(friction=0.0),),
        supports=(rf.Support("x", point=(0.0, 0.0)),),
        probes=(rf.Probe("s", points=((1.0, 0.7),)),),
        history=ONCE,
    )
    assert is_half_meshed(scene) == (angle != 30.0)
    record = last(scene)[1]
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    soft = s**4 / 8.0 + c**4 / 2.0 + s**2 * c**2 * (1.0 / 0.7 - 2.0 * 0.25 / 8.0)
    assert record.turning_points.P[-1].sum() == pytest.approx(0.4, rel=1e-9)
    work = record.turning_points.load_displacement[-1, 0]
    assert work == pytest.approx(0.1**2 * 4.0 * soft, rel=1e-9)
    expected = np.array([0.0, -0.1, 0.0, 0.0])
    assert record.probe("s").stress[-1, 0] == pytest.approx(expected, abs=1e-11)
