"""The condensed body: against an own assembly, between ranks, after a turn, with faults."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, built, condense, system_of
from cffi import VerificationError
from models import block_system

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import _dolfinx, schur
from receding_fenicsx.bulk.schur import norm

comm = MPI.COMM_WORLD
WRONG = (
    r"^the condensed stiffness is off by \S+ from a solve \(at most 1e-10\): move Poisson's ratio "
    "off its limit, or mend the mesh$"
)
LOST = (
    r"^the condensed stiffness resists a rigid motion by \S+ of its size \(at most 1e-12\); check "
    "the mesh for degenerate cells$"
)
UNCOMPILED = (
    (
        OSError(13, "Denied", "/x"),
        "/x: compiled forms cannot be kept there (Denied); set XDG_CACHE_HOME to a folder that can "
        "be written",
    ),
    (OSError(28, "No room", "/x"), "[Errno 28] No room: '/x'"),
    (VerificationError("no compiler"), "the forms cannot be compiled: no compiler"),
)


@pytest.mark.parametrize("half", [False, True])
def test_system_is_that_of_an_own_dense_assembly(half: bool) -> None:
    """Of bilinear squares; the other elements pass patch tests and converge to closed forms."""
    system = system_of(block("quadrilateral", growth=1.0), half)
    if system is not None:
        own = block_system(8 if half else 16, 4, half=half, young=2.0)
        for name in ("x", "weight", "K", "r_star", "load_compliance"):
            found, known = getattr(system, name), getattr(own, name)
            assert np.abs(found - known).max() < 1e-11 * np.abs(known).max(), name
        assert np.array_equal(system.held, own.held) and system.rigid.shape == own.rigid.shape


@pytest.mark.one_rank
@pytest.mark.parametrize("size", [2, 256, 422])  # tiles have 128 rows: one, whole ones, a part
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi])
def test_turning_is_a_congruence_and_keeps_symmetry_to_the_last_bit(
    size: int, angle: float
) -> None:
    c, s = np.cos(angle), np.sin(angle)
    R = np.kron([[c, s], [-s, c]], np.eye(size // 2))
    matrix = np.random.default_rng(size).standard_normal((size, size))
    schur.symmetrise(matrix)
    expected = R @ matrix @ R.T
    schur.turn(matrix, lambda values: R @ values)
    assert np.array_equal(matrix, matrix.T)
    assert matrix == pytest.approx(expected, abs=1e-13 * norm(expected))


def test_a_wrong_triangle_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """MUMPS leaves garbage in one triangle: the comparison with a solve must catch a mix-up."""
    real = schur._complement
    swapped = lambda factor, size, ranks: real(factor, size, 3 - min(ranks, 2))  # noqa: E731
    monkeypatch.setattr(schur, "_complement", swapped)
    with pytest.raises(rf.SolveError, match=WRONG):
        system_of(block())


def test_few_freedoms_inside_beside_many_contact_nodes_are_condensed() -> None:
    """MUMPS then needs more workspace than it expects. Squeezed, p = 2 M / h, M = 35 / 13."""
    strip, edges = rf.Body(width=4.0, height=0.02), (rf.Contact("bottom"), rf.Contact("top"))
    load = rf.Load("p", "left", pressure=1.0)
    system = system_of(block(elements=100, load=load, body=strip, contacts=edges))
    if system is not None:
        p = system.K[system.n :, system.n :].sum(axis=1) / system.weight
        assert p[np.abs(system.x) < 1.0] == pytest.approx(2.0 / 0.02 * 35.0 / 13.0, rel=1e-9)


def test_lost_rigid_motions_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = schur.factorise

    def spoilt(matrix: Any, contact: Any) -> tuple[Any, Array | None]:
        factor, K = real(matrix, contact)
        return factor, None if K is None else K + 1e-11 * norm(K) * np.eye(len(K))

    monkeypatch.setattr(schur, "factorise", spoilt)
    with pytest.raises(rf.SolveError, match=LOST):
        system_of(block())


@pytest.mark.one_rank
@pytest.mark.parametrize(("error", "said"), UNCOMPILED)
def test_why_forms_are_not_compiled_is_said(error: Exception, said: str) -> None:
    kinds = (rf.InputError, ImportError, OSError)
    with pytest.raises(kinds) as caught, _dolfinx._quiet():
        raise error
    assert str(caught.value) == said


@pytest.mark.one_rank
def test_nothing_is_left_behind() -> None:
    """PETSc's objects count references that petsc4py alone would keep: 8 MB a body here."""

    def resident() -> float:
        status = Path("/proc/self/status").read_text().splitlines()
        return int(next(line.split()[1] for line in status if "VmRSS" in line)) / 1024.0

    scene = block("quadrilateral", 2, elements=80, growth=1.0)
    sizes = []
    for _ in range(6):
        bulk = built(scene)
        condense(bulk)
        bulk.destroy()
        sizes.append(resident())
    # the first rounds fill pools that later ones use again
    assert sizes[-1] - sizes[2] < 12.0
