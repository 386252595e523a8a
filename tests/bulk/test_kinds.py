"""Scenes of all kinds: halves, mirror images, units, files, and the balance of energy."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from kinds import EVEN, UNEVEN, mirrored, scaled

import receding_fenicsx as rf
from receding_fenicsx.interface.law import MIRRORED
from receding_fenicsx.output.plots.series import loop_of
from receding_fenicsx.store.hdf5 import write_record

pytestmark = pytest.mark.one_rank
KINDS = EVEN | UNEVEN


def whole(scene: rf.Scene) -> rf.Scene:
    return replace(scene, solver=rf.SolverOptions(symmetry="none"))


@cache
def systems(name: str) -> rf.ContactSystem:
    return rf.given(rf.condense(KINDS[name], MPI.COMM_SELF))


def played(scene: rf.Scene) -> rf.Record:
    return rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)


@cache
def record(name: str) -> rf.Record:
    return rf.evolve(systems(name), KINDS[name])


def assert_close(
    found: Any, known: Any, name: str, tolerance: float = 1e-8, size: float = 0.0
) -> None:
    size = max(size, float(np.abs(known).max(initial=0.0)))
    assert np.shape(found) == np.shape(known), name
    assert np.abs(np.subtract(found, known)).max(initial=0.0) <= tolerance * size + 1e-300, name


@pytest.mark.parametrize("name", EVEN)
def test_half_of_a_body_tells_of_the_whole(name: str) -> None:
    half, other = record(name), played(whole(EVEN[name]))
    assert half.half == (name != "cylinder" and systems(name).half)
    assert half.half or name in ("cylinder", "two edges")
    for key in ("x", "f", "g0", "weight"):
        assert_close(getattr(half, key), getattr(other, key), key)
    a, b = half.turning_points, other.turning_points
    for key in ("P", "Q", "v", "w"):
        scale = np.abs(b.P if key in "PQ" else np.stack([b.v, b.w])).max()
        assert np.abs(getattr(a, key) - getattr(b, key)).max() < 1e-8 * scale, key
    assert_close(a.load_displacement, b.load_displacement, "load displacement")
    assert_close(half.cycles.dissipation, other.cycles.dissipation, "dissipation", 1e-7)
    one, two = half.probe("s"), other.probe("s")
    for key in ("displacement", "stress"):
        found, known = (getattr(each, key)[each.kind == "turning point"] for each in (one, two))
        assert_close(found, known, key)


@pytest.mark.parametrize("name", UNEVEN)
def test_a_mirror_image_of_a_scene_has_the_mirror_image_of_its_record(name: str) -> None:
    scene, found = mirrored(UNEVEN[name]), record(name)
    assert not found.half and mirrored(scene) != scene
    image = played(scene)
    a, b = found.turning_points, image.turning_points
    assert_close(-image.x[::-1], found.x, "x")
    assert np.mean(MIRRORED[b.state][:, ::-1] == a.state) > 0.95  # of nodes at both limits either
    for key, sign in (("P", 1), ("w", 1), ("Q", -1), ("v", -1)):
        known = getattr(a, key)
        scale = np.abs(a.P if key in "PQ" else np.stack([a.v, a.w])).max()
        assert np.abs(sign * getattr(b, key)[:, ::-1] - known).max() < 1e-8 * scale, key
    assert_close(b.load_displacement, a.load_displacement, "load displacement")
    assert_close(image.cycles.dissipation, found.cycles.dissipation, "dissipation", 1e-7)
    one, two = found.probe("s"), image.probe("s")
    ends = one.kind == "turning point"
    known = one.stress[ends] * [1.0, 1.0, 1.0, -1.0]
    assert_close(two.stress[two.kind == "turning point"], known, "stress")


LENGTH, STRESS = 2.0**4, 2.0**-9
POWERS = {
    **{key: (1, 0) for key in ("x", "g0", "v", "w", "slip_increment", "displacement")},
    **{key: (0, 1) for key in ("p", "q", "stress")},
    **{key: (1, 1) for key in ("P", "Q", "dissipation_density")},
    **{key: (2, 1) for key in ("dissipation", "load_displacement")},
    **{key: (0, 0) for key in ("f", "state", "cycle", "leg", "s", "load", "node", "old", "new")},
}
"""Powers of a length and of a stress in what a record holds, in the plane."""


@pytest.mark.parametrize("name", KINDS)
def test_other_units_of_length_and_stress_change_all_numbers_of_a_record_alike(name: str) -> None:
    if name == "cylinder":
        pytest.skip("forces of a body of revolution are those of the circle")
    found, other = record(name), played(scaled(KINDS[name], LENGTH, STRESS))
    # load factors of bolts are lengths
    bolts = np.isin(found.load_names, [bolt.name for bolt in KINDS[name].bolts])
    factor, compared = np.where(bolts, LENGTH, 1.0), 0
    tables = ("turning_points", "events", "cycles")
    parts = [(found, other), (found.probe("s"), other.probe("s"))]
    parts += [(getattr(found, key), getattr(other, key)) for key in tables]
    for one, two in parts:
        for key, (length, stress) in POWERS.items():
            if hasattr(one, key):
                known = getattr(one, key) * LENGTH**length * STRESS**stress
                known = known * {"load": factor, "load_displacement": 1.0 / factor}.get(key, 1.0)
                # increments of slip may be round-off of displacements
                size = LENGTH * np.abs(found.turning_points.v).max() * (key == "slip_increment")
                assert_close(getattr(two, key), known, key, 1e-7, size)
                compared += 1
    assert compared > 25


@pytest.mark.parametrize("name", KINDS)
def test_energies_balance_and_loops_enclose_the_dissipation(name: str) -> None:
    found = record(name)
    assert found.energy_error_max < 1e-9 and found.residual_max < 1e-9
    assert np.any(found.turning_points.state >= rf.State.FORWARD_SLIP)
    first, last = found.cycles.dissipation
    if abs(last - first) < 1e-6 * first:  # a closed loop
        fine = replace(KINDS[name], output=rf.OutputOptions(200, (2,)))
        loop = loop_of(rf.evolve(systems(name), fine), 2)
        assert loop.area().sum() == pytest.approx(last, rel=0.01)


@pytest.mark.parametrize("name", KINDS)
def test_scene_system_and_record_are_read_as_they_were_written(name: str, tmp_path: Path) -> None:
    scene, system, found = KINDS[name], systems(name), record(name)
    assert rf.from_toml(rf.to_toml(scene)) == scene
    rf.write_system(tmp_path / "system.h5", system)
    read = rf.read_system(tmp_path / "system.h5", scene)
    write_record(tmp_path / "record.h5", found)
    again = rf.read_record(tmp_path / "record.h5")
    pairs: list[tuple[Any, Any]] = [(system, read), (found, again)]
    pairs += [
        (getattr(found, key), getattr(again, key))
        for key in ("turning_points", "samples", "events", "cycles")
    ]
    for one, two in pairs:
        for key, value in vars(one).items():
            if isinstance(value, np.ndarray | str | float | tuple) and not key.startswith("_"):
                assert np.array_equal(value, getattr(two, key)), key
    assert again.scene == found.scene
