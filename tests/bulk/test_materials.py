"""Several materials in one mesh, and orthotropic ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from bodies import ONCE, block

import receding_fenicsx as rf
from receding_fenicsx.bulk.material import stiffness_of
from receding_fenicsx.mpi import on_root
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.studies.run import condense

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

comm = MPI.COMM_WORLD

TWO = """
Point(1) = {0, 0, 0, 0.5}; Point(2) = {4, 0, 0, 0.5}; Point(3) = {4, 1, 0, 0.5};
Point(4) = {0, 1, 0, 0.5}; Point(5) = {4, 2, 0, 0.5}; Point(6) = {0, 2, 0, 0.5};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {3, 5}; Line(6) = {5, 6}; Line(7) = {6, 4};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {-3, 5, 6, 7}; Plane Surface(2) = {2};
Physical Surface("coat") = {1}; Physical Surface("core") = {2};
Physical Curve("foot") = {1}; Physical Curve("top") = {6}; Physical Curve("seam") = {3};
Physical Curve("end") = {2, 5}; Physical Curve("wall") = {4, 7};
"""
COAT, CORE = rf.Material(10.0, 0.3, name="coat"), rf.Material(1.0, 0.2, name="core")


def two(folder: Path, **parts: object) -> rf.Scene:
    """A coat of 1 below a core of 1, 4 long, pressed unevenly onto a plane."""
    path = folder / "two.geo"
    on_root(comm, lambda: path.write_text(TWO))
    scene = rf.Scene(
        body=rf.Body(mesh=str(path)),
        materials=(COAT, CORE),
        contacts=(rf.Contact("foot", friction=0.3),),
        loads=(rf.Load("P", "top", pressure="0.1 + 0.01*x"),),
        history=ONCE,
    )
    return replace(scene, **parts)  # type: ignore[arg-type]


def last(scene: rf.Scene) -> tuple[rf.ContactSystem, rf.Record] | None:
    """The system and record of a scene, on rank 0."""
    rf.validate(scene)
    system = condense(scene, comm)
    return on_root(comm, lambda: None if system is None else (system, rf.evolve(system, scene)))


@pytest.mark.parametrize("kinematics", ["plane strain", "plane stress", "axisymmetric"])
def test_two_materials_in_one_mesh_are_two_tied_bodies(
    kinematics: str, shared_tmp_path: Path
) -> None:
    """Under a load, warmed, at probes: all that sees the material of a cell."""
    one = two(shared_tmp_path)
    warm = rf.Load("T", thermal_strain="0.01*(1 + x + y)")
    one = replace(
        one,
        materials=tuple(replace(m, kinematics=kinematics) for m in one.materials),
        loads=(*one.loads, warm),
        probes=(rf.Probe("s", points=((1.3, 0.4), (2.1, 1.7))),),
        history=rf.HistoryOptions(
            "table",
            columns=("P", "T"),
            rows=((1.0, 0.0),),
            cycle_rows=((1.0, 1.0), (1.0, 0.0)),
            cycles=1,
        ),
    )
    coat, core = (rf.Body(name, mesh=one.body.mesh, surface=name) for name in ("coat", "core"))
    tied = replace(
        one,
        body=coat,
        others=(core,),
        contacts=(rf.Contact("coat.foot", friction=0.3),),
        ties=(rf.Tie("core.seam", against="coat.seam"),),
        loads=(
            replace(one.loads[0], edge="core.top"),
            replace(warm, body="coat"),
            replace(warm, body="core"),
        ),
        probes=(
            rf.Probe("s", points=((1.3, 0.4),), body="coat"),
            rf.Probe("r", points=((2.1, 1.7),), body="core"),
        ),
    )
    a, b = last(one), last(tied)
    if a is not None and b is not None:
        assert np.abs(a[0].K - b[0].K).max() < 1e-12 * np.abs(a[0].K).max()
        assert np.abs(a[0].r_star - b[0].r_star).max() < 1e-12
        assert a[1].turning_points.P == pytest.approx(b[1].turning_points.P, abs=1e-12)
        whole, parts = a[1].probe("s"), (b[1].probe("s"), b[1].probe("r"))
        for name in ("displacement", "stress"):
            found = np.concatenate([getattr(part, name) for part in parts], axis=1)
            assert getattr(whole, name) == pytest.approx(found, abs=1e-11), name


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"materials": (COAT,)},
            "the physical surface 'core' has no material; add [material.core]",
        ),
        ({"materials": (COAT, replace(CORE, kinematics="plane stress"))}, "kinematics: differs"),
        ({"materials": (COAT, replace(CORE, young_2=1.0))}, "has both young_2 and shear; give"),
        ({"materials": (COAT, replace(CORE, young_2=1.0, shear=1.0))}, "are for plane stress"),
    ],
)
def test_materials_that_cannot_serve_are_refused_in_one_line(
    change: dict, words: str, shared_tmp_path: Path
) -> None:
    with pytest.raises(rf.InputError) as caught:
        last(two(shared_tmp_path, **change))
    assert words in str(caught.value) and "\n" not in str(caught.value)


FIBRES = rf.Material(8.0, 0.25, "plane stress", young_2=2.0, shear=0.7)


def test_isotropic_constants_are_a_case_of_the_orthotropic_ones() -> None:
    plain = rf.Material(3.0, 0.3, "plane stress")
    for angle in (0.0, 37.0):
        same = replace(plain, young_2=3.0, shear=3.0 / 2.6, angle=angle)
        assert stiffness_of(same) == pytest.approx(stiffness_of(plain), abs=1e-14)
    across = replace(FIBRES, young=2.0, young_2=8.0, poisson=0.0625)
    assert stiffness_of(replace(FIBRES, angle=90.0)) == pytest.approx(stiffness_of(across))


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
    found = last(scene)
    if found is not None:
        _, record = found
        s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
        soft = s**4 / 8.0 + c**4 / 2.0 + s**2 * c**2 * (1.0 / 0.7 - 2.0 * 0.25 / 8.0)
        assert record.turning_points.P[-1].sum() == pytest.approx(0.4, rel=1e-9)
        work = record.turning_points.load_displacement[-1, 0]
        assert work == pytest.approx(0.1**2 * 4.0 * soft, rel=1e-9)
        expected = np.array([0.0, -0.1, 0.0, 0.0])
        assert record.probe("s").stress[-1, 0] == pytest.approx(expected, abs=1e-11)
