"""What is installed: versions, and whether everything that is needed works."""

from __future__ import annotations

import ctypes.util
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path

RENDER_SECONDS = 120
"""Patience with the child process that draws a test picture."""

RENDER = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere(), color="red")
picture = plotter.screenshot(return_img=True)
raise SystemExit(0 if picture.std() > 0 else 3)
"""
"""Draws a ball and looks whether it is there."""

MPI_VARIABLES = re.compile(r"^(PMIX_|OMPI_|PMI_|PRTE_|MPI_LOCALNRANKS|MPI_LOCALRANKID)")
"""Variables by which a process of an MPI job is known: a child must not take itself for one."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for: its version, or what to do when ``version`` is None."""

    name: str
    version: str | None
    advice: str = ""


def versions() -> dict[str, str]:
    """Versions of what a run depends on; what is missing is left out."""
    found = {f.name: f.version for f in _modules()}
    return {name: version for name, version in found.items() if version is not None}


def examine() -> list[Finding]:
    """Look for everything that the program needs, also by trying it."""
    findings = _modules()
    compiler = next((c for c in (os.environ.get("CC"), "cc", "gcc") if c and shutil.which(c)), None)
    findings.append(
        Finding("C compiler", compiler, "install gcc: DOLFINx compiles its forms with it")
    )
    findings.append(_rendering())
    return findings


def child_environment() -> dict[str, str]:
    """The environment without what would make a child process a part of this MPI job."""
    return {key: value for key, value in os.environ.items() if not MPI_VARIABLES.match(key)}


def _modules() -> list[Finding]:
    debian = (
        "apt install python3-dolfinx-real (or pip install dolfinx-solver-real on Python >= 3.12)"
    )
    pip = "pip install {} in the program's environment"
    probes: list[tuple[str, Callable[[], str], str]] = [
        ("python", platform.python_version, ""),
        ("receding_fenicsx", lambda: str(import_module("receding_fenicsx").__version__), ""),
        ("numpy", lambda: _module_version("numpy"), pip.format("numpy")),
        ("scipy", lambda: _module_version("scipy"), pip.format("scipy")),
        (
            "h5py",
            lambda: _module_version("h5py"),
            "apt install python3-h5py (Debian's DOLFINx needs Debian's)",
        ),
        ("MPI", _mpi, debian),
        ("dolfinx", lambda: _module_version("dolfinx"), debian),
        ("petsc", _petsc, debian),
        ("MUMPS", _mumps, "use a PETSc that was built with MUMPS, as Debian's is"),
        (
            "gmsh",
            _gmsh,
            pip.format("gmsh") + " and apt install libgl1 libglu1-mesa libxrender1 libxcursor1 "
            "libxfixes3 libxft2 libfontconfig1 libxinerama1",
        ),
        ("matplotlib", lambda: _module_version("matplotlib"), pip.format("matplotlib")),
        ("pyvista", lambda: metadata.version("pyvista"), pip.format("pyvista")),
        ("vtk", lambda: metadata.version("vtk"), pip.format("'vtk>=9.5,<9.6'")),
        ("BLAS", _blas, "apt install libopenblas0-pthread"),
    ]
    return [_probe(*probe) for probe in probes]


def _probe(name: str, version: Callable[[], str], advice: str) -> Finding:
    try:
        return Finding(name, version(), advice)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        return Finding(name, None, f"{reason}; {advice}")


def _module_version(name: str) -> str:
    module = import_module(name)
    return str(getattr(module, "__version__", None) or metadata.version(name))


def _mpi() -> str:
    from mpi4py import MPI

    return MPI.Get_library_version().split("\n")[0].split(",")[0].strip().strip("\0")


def _petsc() -> str:
    from petsc4py import PETSc

    return ".".join(str(part) for part in PETSc.Sys.getVersion())


def _mumps() -> str:
    from petsc4py import PETSc

    if not PETSc.Sys.hasExternalPackage("mumps"):
        raise RuntimeError("this PETSc has no MUMPS")
    return _loaded(r"lib(?:dmumps|mumps_common)[-_.]?([0-9][0-9.]*[0-9])?") or "version unknown"


def _gmsh() -> str:
    return str(import_module("gmsh").__version__)


def _blas() -> str:
    import_module("numpy")
    name = _loaded(r"lib((?:scipy_)?openblas[^/]*?|mkl_rt|blis[^/]*?|blas)(?:-[0-9a-f]+)?\.so")
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS") or "all"
    return f"{name or 'unknown'}, {threads} thread(s)"


def _loaded(pattern: str) -> str | None:
    """First match among the shared libraries that this process has loaded."""
    try:
        lines = Path("/proc/self/maps").read_text().split("\n")
    except OSError:
        return None
    for path in dict.fromkeys(line.split()[-1] for line in lines if "/" in line):
        match = re.match(pattern, os.path.basename(path))
        if match and match.group(1):
            return match.group(1)
    return None


def _rendering() -> Finding:
    """Draw in a child process: without EGL and OSMesa VTK may crash instead of complaining."""
    name = "off-screen rendering"
    advice = "apt install libosmesa6 (or libegl1)"
    libraries = [lib for lib in ("EGL", "OSMesa") if ctypes.util.find_library(lib)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", RENDER],
            env=child_environment(),
            capture_output=True,
            text=True,
            timeout=RENDER_SECONDS,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(name, None, f"{type(error).__name__}; {advice}")
    if done.returncode == 0:
        return Finding(name, f"works (found: {', '.join(libraries) or 'a display'})")
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return Finding(name, None, f"exit code {done.returncode}, {last}; {advice}")
