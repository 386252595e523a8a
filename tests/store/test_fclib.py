from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import h5py
import numpy as np
import pytest
from models import block_system
from scipy import sparse
from small import small_system

import receding_fenicsx as rf
from receding_fenicsx import cli
from receding_fenicsx.interface.gauss_seidel.compliance_form import solve_problem, step_problem
from receding_fenicsx.interface.gauss_seidel.sweeps import GaussSeidelOptions, solve_step
from receding_fenicsx.store.fclib import write_fclib
from receding_fenicsx.studies import run as study

pytestmark = pytest.mark.one_rank

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
LOAD = np.array([1.0])


def held_system() -> rf.ContactSystem:
    """A block on springs: no rigid motion is left."""
    system = block_system(16, 8)
    K = system.K + 0.02 * np.diag(~system.held).astype(float) * np.abs(system.K).max()
    return replace(system, K=K, rigid=np.zeros((2 * system.n, 0)))


def unloading(system: rf.ContactSystem) -> tuple[rf.ContactState, np.ndarray]:
    """The state under the full load and the load of the next step."""
    n = system.n
    rest = rf.ContactState(np.zeros(2 * n), np.zeros(2 * n), np.ones(n, dtype=np.int8))
    return solve_step(system, rest, LOAD, GaussSeidelOptions()).end, np.array([0.8])


def read_matrix(group: h5py.Group) -> np.ndarray:
    """Read a matrix as FCLIB does: compressed rows, columns or triplets."""
    m, n, nz = (int(group[key][0]) for key in ("m", "n", "nz"))
    p, i, x = (group[key][()] for key in ("p", "i", "x"))
    assert nz == -2 and len(p) == m + 1 and len(x) == len(i) == int(group["nzmax"][0])
    return np.asarray(sparse.csr_matrix((x, i, p), (m, n)).toarray())


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("first", [True, False])
def test_the_solution_in_a_file_solves_the_problem_in_it(
    tmp_path: Path, free: bool, first: bool
) -> None:
    system = block_system(16, 8) if free else held_system()
    start, load = (None, LOAD) if first else unloading(system)
    path = tmp_path / "step.hdf5"
    write_fclib(path, step_problem(system, load, start), solve_problem(system, load, start))
    with h5py.File(path) as file:
        local = file["fclib_local"]
        assert int(local["spacedim"][0]) == 2
        W, (q, mu) = read_matrix(local["W"]), (local["vectors"][k][()] for k in ("q", "mu"))
        V, s = np.zeros((len(q), 0)), np.zeros(0)
        assert ("V" in local) == free
        if free:
            V, s = read_matrix(local["V"]), local["vectors/s"][()]
            assert not np.any(read_matrix(local["R"]))
        r, u = (file[f"solution/{key}"][()] for key in "ru")
        rho = file["solution/l"][()] if free else s
    np.testing.assert_allclose(W @ r + V @ rho + q, u, atol=1e-9 * np.abs(u).max())
    np.testing.assert_allclose(V.T @ r, -s, atol=1e-9 * np.abs(r).max())
    # projections on the cone after a step against u change nothing
    pushed, limit = r - u * np.abs(r).max() / np.abs(u).max(), mu * r[0::2]
    projected = np.maximum(pushed[0::2], 0.0), np.clip(pushed[1::2], -limit, limit)
    np.testing.assert_allclose(np.transpose(projected).ravel(), r, atol=1e-9 * np.abs(r).max())
    assert (np.abs(u[1::2]) > 1e-9).any()
    assert (u[0::2] > 1e-9).any() == free  # the springs keep the contact closed


@pytest.mark.parametrize("rest", [0.0, 1e-15, 1e-10])
def test_a_motion_that_is_free_to_round_off_is_refused(rest: float) -> None:
    turn = np.array([[1.0, -2.0], [2.0, 1.0]]) / np.sqrt(5.0)
    K = turn @ np.diag([2.0, rest]) @ turn.T
    system = small_system(K, {"a": [-1.0, 3.0]}, 0.5)
    with pytest.raises(rf.InputError, match="singular to round-off"):
        step_problem(replace(system, rigid=np.zeros((2, 0))), LOAD)


def test_nodes_held_normally_are_no_contacts_and_nodes_held_sideways_have_no_friction(
    tmp_path: Path,
) -> None:
    system = block_system(16, 8)
    assert system.held[0] and step_problem(system, LOAD).mu[0] == 0.0
    held = system.held.copy()
    held[system.n + 5] = True
    f = np.where(held[system.n :], 0.0, system.f)
    system = replace(system, held=held, f=f, rigid=np.zeros((2 * system.n, 0)))
    problem = step_problem(system, LOAD)
    assert 5 not in problem.nodes and len(problem.mu) == system.n - 1
    write_fclib(tmp_path / "step.h5", problem)
    with h5py.File(tmp_path / "step.h5") as file:
        found = file["fclib_local/info/contact_nodes"][()].tolist()
    assert found == np.delete(np.arange(system.n), 5).tolist()


def test_export_of_a_run_s_step_is_that_step(tmp_path: Path) -> None:
    settings = ["mesh.contact_elements=24", "history.cycles=2", "solver.steps_per_leg=400"]
    rows, cycle = ((0.5,), (1.0,)), ((1.0 / 3.0,), (1.0,))
    table = rf.HistoryOptions("table", columns=("p0",), rows=rows, cycle_rows=cycle, cycles=2)
    scene = replace(rf.read_scene(BLOCK, settings), history=table)
    record = study.run(scene, tmp_path / "run", study.RunOptions(pictures=False), MPI.COMM_SELF)
    assert record is not None
    path = tmp_path / "step.hdf5"
    text = rf.export(tmp_path / "run", path, (1, "unloading", 1.0))
    free = "25 contacts, 1 rigid motion(s) left to the contact"
    assert text == f"cycle 1, leg 0, from s = 0.9975 to 1: {free}"
    row = np.flatnonzero((record.turning_points.cycle == 1) & (record.turning_points.leg == 0))[0]
    P = record.turning_points.P[row][24:].copy()
    P[0] *= 0.5  # half of the axis node's
    with h5py.File(path) as file:
        r = file["solution/r"][()]
        assert file["fclib_local/info/title"][()] == b"Ahn & Barber block"
        assert b"from s = 0.9975 to 1" in file["fclib_local/info/description"][()]
        about = file["fclib_local/info/math_info"][()]
        assert about.startswith(b"W symmetric, positive semi-definite; u_N gap at the end")
    # a step is the exact path up to what changes within it
    np.testing.assert_allclose(r[0::2], P, atol=1e-6 * P.max())
    # the half body carries half of the load, 1 - (2/3) s or (1 + s) / 2, on the edge of length 2
    for where, force in (((1, "unloading", 0.25), 1.0 - 0.25 * 2.0 / 3.0), ((0, "1", 0.5), 0.75)):
        rf.export(tmp_path / "run", path, where, overwrite=True)
        with h5py.File(path) as file:
            assert file["solution/r"][0::2].sum() == pytest.approx(force, rel=1e-9)
    with pytest.raises(rf.InputError, match="already exists"):
        rf.export(tmp_path / "run", path)
    assert "from s = 0 to 1" in rf.export(tmp_path / "run", path, overwrite=True)
    later = rf.export(tmp_path / "run", path, (0, "1", 1.0), overwrite=True)
    assert "cycle 0, leg 1, from s = 0.9975 to 1" in later
    for where, since, words in (
        ((1, "unloading", 0.0), None, "^--at 0: must lie on the leg, 0 < s <= 1$"),
        ((1, "unloading", 1.1), None, "^--at 1.1: must lie on the leg, 0 < s <= 1$"),
        ((1, "unloading", 0.5), 0.5, r"^--since 0.5: must lie on the leg, 0 <= s < 0.5 \(--at\)$"),
        ((1, "unloading", 0.5), -0.1, r"^--since -0.1: must .* s < 0.5 \(--at\)$"),
        ((7, "unloading", 0.5), None, "^cycle 7 does not occur: there are cycles 0 to 2$"),
    ):
        with pytest.raises(rf.InputError, match=words):
            rf.export(tmp_path / "run", tmp_path / "x.hdf5", where, since)
    slipped = replace(scene, history=replace(table, initial_slip="1e-3*x"))
    for stored, words in (
        (rf.to_toml(slipped), "the first leg does not start from rest; use a later leg$"),
        ("", "record.h5: has no scene; give the folder of a run"),
    ):
        other = replace(record, scene_toml=stored)
        rf.write_record(tmp_path / "run" / "record.h5", other, overwrite=True)
        with pytest.raises(rf.InputError, match=words):
            rf.export(tmp_path / "run", tmp_path / "x.hdf5")
        assert not (tmp_path / "x.hdf5").exists()


def test_export_of_a_saved_system_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rf.write_system(tmp_path / "system.h5", block_system(16, 8))
    arguments = ["export", str(tmp_path / "system.h5"), "--out", str(tmp_path / "x.hdf5")]
    assert cli.main(arguments) == 0
    said = "17 contacts, 1 rigid motion(s) left to the contact, written to"
    assert f"from rest to load factors 1: {said} {arguments[-1]}\n" == capsys.readouterr().out
    with h5py.File(arguments[-1]) as file:
        assert file["fclib_local/info/title"][()] == b"frictional contact"
