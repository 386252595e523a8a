import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from models import block_system, pushed_block
from small import assert_same_bits, small_system, table

from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.output.report.summary import summarise
from receding_fenicsx.scene.model import Scene, SolverOptions
from receding_fenicsx.scene.toml_file import from_toml, to_toml
from receding_fenicsx.store.hdf5 import (
    new_hdf5,
    read_record,
    read_system,
    write_record,
    write_system,
)
from receding_fenicsx.store.run_folder import write_summary

pytestmark = pytest.mark.one_rank

BLOCK = (Path(__file__).parents[2] / "demos" / "block.toml").read_text()
SHORT = ["history.cycles=3", "solver.method=events", "output.samples_per_leg=8"]


def system_of(scene: Scene) -> ContactSystem:
    """The paper's block, as condensed for a scene."""
    return dataclasses.replace(block_system(40, 20), scene_toml=to_toml(scene))


def evolved(*overrides: str) -> Record:
    scene = from_toml(BLOCK, [*SHORT, *overrides])
    return evolve(system_of(scene), scene)


@pytest.fixture(scope="module")
def record() -> Record:
    return evolved()


def test_record_reads_back_bitwise(record: Record, tmp_path: Path) -> None:
    short = evolved("history.kind=monotonic", "output.cycles=[]")
    assert len(short.cycles.dissipation) == 0
    node = small_system([[1.0, 0.9], [0.9, 1.0]], {"p0": [1.3, 1.0]}, 1.5)
    forked = evolve(node, table(node, [0.0, 1.0]), SolverOptions(branch=2))
    assert forked.choices
    long = dataclasses.replace(record, scene_toml=f"{record.scene_toml}# {100_000 * 'x'}\n")
    for one in (record, short, forked, long):
        write_record(tmp_path / "record.h5", one, overwrite=True)
        assert_same_bits(one, read_record(tmp_path / "record.h5"))
        assert os.listdir(tmp_path) == ["record.h5"]


def test_record_file_has_the_layout_of_the_page_of_formats(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "record.h5", record)
    n = len(record.x)
    with h5py.File(tmp_path / "record.h5") as file:
        for part in (file["turning_points"], file["samples"]):
            rows = len(part["s"])
            shapes = {(rows,): "cycle leg s", (rows, 1): "load load_displacement"}
            for shape, keys in (shapes | {(rows, n): "state P Q p q v w"}).items():
                assert {part[key].shape for key in keys.split()} == {shape}
        assert {"cycle", "leg", "s", "load", "node", "old", "new"} <= set(file["events"])
        for key in ("dissipation_density", "slip_increment"):
            assert file["cycles"][key].shape == (3, n)
        assert {"x", "points", "f", "g0", "weight", "edge"} <= set(file["nodes"])
        assert list(file.attrs["load_names"]) == ["p0"] and file.attrs["format_version"] == 1


def test_system_takes_the_scene_s_own_friction_and_gap(tmp_path: Path) -> None:
    path = tmp_path / "system.h5"
    stored = system_of(from_toml(BLOCK))
    write_system(path, stored)
    scene = from_toml(BLOCK, ["contact.friction=0.2 + 0.1*abs(x)", "contact.initial_gap=0.01*x**2"])
    system = read_system(path, scene)
    np.testing.assert_allclose(system.f, 0.2 + 0.1 * np.abs(stored.x), rtol=1e-14)
    np.testing.assert_allclose(system.g0, 0.01 * stored.x**2, rtol=1e-14)
    assert system.scene_toml == to_toml(scene)
    smooth = read_system(path, from_toml(BLOCK, ["contact.friction=0"]))
    assert smooth.kind == "normal" and smooth.K.shape == (41, 41)
    # and what has lost its tangential displacements cannot serve friction
    write_system(path, smooth, overwrite=True)
    with pytest.raises(InputError, match=r"system.h5: the system has no tangential"):
        read_system(path, from_toml(BLOCK))
    write_system(path, dataclasses.replace(smooth, scene_toml=""), overwrite=True)
    with pytest.raises(InputError, match=r"system.h5: was not condensed from a scene; condense"):
        read_system(path, from_toml(BLOCK))


@pytest.fixture(scope="module")
def written(record: Record, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A record and a system in files."""
    folder = tmp_path_factory.mktemp("written")
    system = dataclasses.replace(system_of(from_toml(BLOCK)), edge=np.zeros(41, dtype=np.int64))
    write_record(folder / "record.h5", record)
    write_system(folder / "system.h5", system)
    return {"record": folder / "record.h5", "contact system": folder / "system.h5"}


READERS: dict[str, Callable[[Path], object]] = {
    "record": read_record,
    "contact system": read_system,
}
each_kind = pytest.mark.parametrize("kind", READERS)


@each_kind
def test_files_with_any_changed_bit_or_cut_anywhere_are_refused(
    kind: str, written: dict[str, Path], tmp_path: Path
) -> None:
    whole = written[kind].read_bytes()
    path, rng = tmp_path / "file.h5", np.random.default_rng(7)
    for place in rng.integers(8 * len(whole), size=60):
        changed = bytearray(whole)
        changed[place // 8] ^= 1 << place % 8
        path.write_bytes(changed)
        with pytest.raises(InputError, match=r"file\.h5: is damaged"):
            READERS[kind](path)
    for length in [0, 7, 100, 512, len(whole) - 1, *rng.integers(len(whole), size=10)]:
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"file\.h5: is damaged"):
            READERS[kind](path)


@each_kind
def test_foreign_files_are_refused(kind: str, written: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with pytest.raises(InputError, match=r"file\.h5: no such file"):
        READERS[kind](path)
    with h5py.File(path, "w") as file:
        file["K"] = np.eye(4)
    others = [path.read_bytes(), b"no HDF5 at all\n", *(written[k].read_bytes() for k in READERS)]
    for content in others:
        path.write_bytes(content)
        if content != written[kind].read_bytes():
            with pytest.raises(InputError, match=f"is not a receding_fenicsx {kind}"):
                READERS[kind](path)


def test_a_file_of_another_version_of_the_program_is_refused(tmp_path: Path) -> None:
    with new_hdf5(tmp_path / "file.h5", kind="receding_fenicsx record"):
        pass
    with pytest.raises(InputError, match=r"file\.h5: is of another version of this program"):
        read_record(tmp_path / "file.h5")


def test_dissipation_counts_where_it_is_beyond_both_round_offs(record: Record) -> None:
    """1e-13 of all pressure times the largest slip; what residuals may feign at all nodes."""
    table, n = record.turning_points, len(record.x)
    v = np.where(table.cycle[:, None] == 0, 0.0, -np.abs(table.v))
    table = dataclasses.replace(table, v=v, Q=-2.0 * table.P)
    slip = 1e-13 * table.P.sum(axis=1).max() * np.abs(table.v[:3]).max()
    feigned = 2.0 * n * np.abs([table.P, table.Q]).max() * np.abs(table.v).max()
    for residual in (0.0, 0.5 * slip / feigned, 1e-9):
        for factor in (0.99, 1.01):
            D = factor * max(slip, residual * feigned) * np.ones(1)
            cycles = dataclasses.replace(record.cycles, dissipation=D)
            other = dataclasses.replace(
                record, turning_points=table, cycles=cycles, residual_max=residual
            )
            assert other.dissipates == (factor > 1.0)


def test_numbers_that_json_cannot_hold_become_null(record: Record, tmp_path: Path) -> None:
    bad = summarise(dataclasses.replace(record, residual_max=float("nan")))
    write_summary(tmp_path / "s.json", bad)
    assert json.loads((tmp_path / "s.json").read_text())["residual_max"] is None


@pytest.mark.parametrize("f", [0.3, 0.7])
def test_dissipation_on_soft_springs_is_known_to_its_round_off(f: float) -> None:
    # the springs move the body by thousands of its lengths; by how much decides D by their part
    block, found = pushed_block(), []
    slide = np.repeat([1.0, 0.0], block.n)
    for soft in (1e-6, 1e-8):
        K = block.K + soft * np.abs(block.K).max() / block.n * np.outer(slide, slide)
        body = dataclasses.replace(
            block, K=K, rigid=np.zeros((2 * block.n, 0)), f=np.full(block.n, f)
        )
        loop = [[1.0, 2.0], [0.9, 2.0], [1.0, 2.0]]
        found.append(evolve(body, table(body, [[0.0, 0.0], loop[0]], loop, 3)))
    one, other = (record.cycles.dissipation[1:] for record in found)
    allowed = [record.dissipation_round_off for record in found]
    assert np.abs(one - other).max() <= sum(allowed) and allowed[1] > 10.0 * allowed[0]
