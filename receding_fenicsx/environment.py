"""Installed versions, and tests of the installation (``receding-fenicsx doctor``)."""

from __future__ import annotations

import contextlib
import ctypes.util
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mpi4py import MPI

MPI_VARIABLES = re.compile(r"^(PMIX_|OMPI_|PMI_|PRTE_|HYDI_|MPI_LOCALNRANKS|MPI_LOCALRANKID)")
"""Variables that make a child process join this MPI job; they are removed for it."""


@dataclass(frozen=True)
class Finding:
    """Requirement with its version; None if it is missing, then ``advice`` tells what to do."""

    name: str
    version: str | None
    advice: str = ""


def versions() -> dict[str, str]:
    """Return the versions of all requirements that are installed."""
    return {f.name: f.version for f in _packages(tested=False) if f.version is not None}


def costs(comm: MPI.Comm, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return timings, memory of all ranks together, and versions, for a summary; collective."""
    # Linux counts in kB, macOS in bytes
    unit = 2.0**20 if sys.platform == "darwin" else 2.0**10
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)
    return {
        "ranks": comm.size,
        "timings": dict(seconds),
        "peak_memory_MB": memory,
        "versions": versions(),
    }


def examine() -> list[Finding]:
    """Look for all requirements and test those that can be tested."""
    compiler = next((c for c in (os.environ.get("CC"), "cc", "gcc") if c and shutil.which(c)), None)
    own = Path(sys.executable).with_name("mpiexec")  # PyPI's MPI needs its own
    program = str(own) if own.exists() else shutil.which("mpirun")
    return [
        *_packages(tested=True),
        Finding("C compiler", compiler, "install gcc: DOLFINx compiles its forms with it"),
        Finding("mpirun", program, "install the MPI that DOLFINx is linked with"),
        _rendering(),
    ]


def child_environment() -> dict[str, str]:
    """Return the environment variables for a child process that does not join this MPI job."""
    return {key: value for key, value in os.environ.items() if not MPI_VARIABLES.match(key)}


def _packages(tested: bool) -> list[Finding]:
    """Find packages and libraries; ``tested``: also test MUMPS and load Matplotlib."""
    debian = "apt install python3-dolfinx-real (Python >= 3.12: or pip install dolfinx-solver-real)"
    of_module, of_package = _module_version, metadata.version
    found: list[tuple[str, Callable[[str], str], str]] = [
        ("python", lambda _: platform.python_version(), ""),
        *((name, of_module, "") for name in ("receding_fenicsx", "numpy", "scipy")),
        ("numba", of_package, ""),
        ("h5py", of_module, "apt install python3-h5py (Debian's DOLFINx needs Debian's)"),
        ("MPI", _mpi, debian),
        ("mpi4py", of_module, debian),
        ("dolfinx", _dolfinx, debian),
        (
            "petsc",
            lambda _: ".".join(map(str, import_module("petsc4py.PETSc").Sys.getVersion())),
            debian,
        ),
        (
            "MUMPS",
            _tested_mumps if tested else _mumps,
            "use a PETSc built with MUMPS, such as Debian's, and the MPI that it belongs to",
        ),
        (
            "gmsh",
            of_module,
            "pip install gmsh in the program's environment and apt install libgl1 libglu1-mesa "
            "libxrender1 libxcursor1 libxfixes3 libxft2 libfontconfig1 libxinerama1",
        ),
        ("matplotlib", of_module if tested else of_package, ""),
        ("pyvista", of_package, ""),
        ("vtk", of_package, "pip install 'vtk>=9.5,<9.6' in the program's environment"),
        *((name, of_package, "") for name in ("pillow", "imageio-ffmpeg", "loky")),
        ("BLAS", _blas, "apt install libopenblas0-pthread"),
    ]
    return [_probe(*entry) for entry in found]


def _probe(name: str, version: Callable[[str], str], advice: str) -> Finding:
    """Find a version by a function of the name."""
    advice = advice or f"pip install {name} in the program's environment"
    try:
        return Finding(name, version(name), advice)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        return Finding(name, None, f"{reason}; {advice}")


def _module_version(name: str) -> str:
    module = import_module(name)
    return str(getattr(module, "__version__", None) or metadata.version(name))


def _dolfinx(name: str) -> str:
    version = _module_version(name)
    # releases that the test suite runs with
    tested = re.match(r"0\.(5|11)(\.|$)", version)
    return version if tested else f"{version}, not tested (0.5 and 0.11 are)"


def _mpi(_: str) -> str:
    from mpi4py import MPI

    first = MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\0")
    return " ".join(first.replace("Version:", "").split())


def _mumps(_: str) -> str:
    from petsc4py import PETSc

    if not PETSc.Sys.hasExternalPackage("mumps"):
        raise RuntimeError("this PETSc has no MUMPS")
    named = _loaded(r"lib(?:dmumps|mumps_common)[-_.]?([0-9][0-9.]*[0-9])?")
    return named[0] if named else "built into PETSc"


def _tested_mumps(_: str) -> str:
    """Factorise a small matrix by MUMPS, which prints its version on every system."""
    _mumps(_)
    output, failure = _child(
        """
import contextlib
with contextlib.suppress(ImportError):
    import dolfinx_solver
from petsc4py import PETSc
for number, value in (3, 6), (4, 2):
    PETSc.Options().setValue(f"mat_mumps_icntl_{number}", value)
rows = [0, 1, 2], [0, 1], [4.0, 4.0]
matrix = PETSc.Mat().createAIJ((2, 2), csr=rows, comm=PETSc.COMM_SELF)
pc = PETSc.PC().create(PETSc.COMM_SELF)
pc.setOperators(matrix)
pc.setType("cholesky")
pc.setFactorSolverType("mumps")
pc.setUp()
"""
    )
    said = re.search(r"DMUMPS +([0-9][0-9.]*)", output)
    if failure or said is None:
        raise RuntimeError(failure or "its output has no version")
    return f"{said[1]}, works"


def _blas(_: str) -> str:
    import_module("numpy")
    with contextlib.suppress(ImportError):  # MUMPS may use another BLAS than NumPy
        import_module("petsc4py.PETSc")
    names = _loaded(r"lib((?:scipy_)?openblas[^/]*?|mkl_rt|blis[^/]*?)(?:-[0-9a-f]+)?\.so")
    # OpenBLAS too has a libblas, in a folder of its own
    slow = "; 3 to 5 times slower than OpenBLAS: apt install libopenblas0-pthread"
    reference = bool(_loaded(r"(libblas)\.so", "/blas/"))
    named = " and ".join(names + ["the reference BLAS"] * reference) or "unknown"
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS") or "all"
    return f"{named}, {threads} thread(s){slow * reference}"


def _loaded(pattern: str, folder: str = "/") -> list[str]:
    """Return the first groups of matches among the shared libraries of this process."""
    try:
        lines = Path("/proc/self/maps").read_text().split("\n")
    except OSError:
        return []
    names = dict.fromkeys(os.path.basename(line.split()[-1]) for line in lines if folder in line)
    matches = (re.match(pattern, name) for name in names)
    return list(dict.fromkeys(match[1] for match in matches if match and match[1]))


def _child(program: str) -> tuple[str, str]:
    """Run a Python program outside this MPI job; return its output, and why it failed, or ""."""
    command, env = [sys.executable, "-c", program], child_environment()
    try:
        done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", type(error).__name__
    if done.returncode == 0:
        return done.stdout, ""
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return done.stdout, f"exit code {done.returncode}, {last}"


def _rendering() -> Finding:
    """Render in a child process, since VTK may crash without EGL and OSMesa."""
    libraries = [lib for lib in ("EGL", "OSMesa") if ctypes.util.find_library(lib)]
    _, failure = _child(
        """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere(), color="red")
picture = plotter.screenshot(return_img=True)
raise SystemExit(0 if picture.std() > 0 else 3)  # 3: the picture is empty
"""
    )
    advice = f"{failure}; apt install libosmesa6 (or libegl1)"
    works = f"works (found: {', '.join(libraries) or 'a display'})"
    return Finding("off-screen rendering", None if failure else works, advice)
