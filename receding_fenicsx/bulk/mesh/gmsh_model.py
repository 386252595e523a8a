"""gmsh session with an empty model, silent and on one thread; paths of the .geo files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError


@contextmanager
def gmsh_model() -> Iterator[Any]:
    """Yield the gmsh module with an empty model, silent and on one thread."""
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.model.add("receding_fenicsx")
    gmsh.parser.clear()
    try:
        yield gmsh
    finally:
        gmsh.parser.clear()
        gmsh.model.remove()
        if ours:
            gmsh.finalize()


def geo_path(name: str) -> Path:
    """Return the path of a .geo file of the installed package, or of the repository.

    Raises:
        InputError: there is no such file.
    """
    package = Path(str(resources.files("receding_fenicsx")))
    for path in (package / "meshes" / name, package.parent / "meshes" / name):
        if path.is_file():
            return path
    raise InputError(f"the geometry '{name}' is missing from the package; install it again")
