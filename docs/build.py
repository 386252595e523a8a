"""Build the reference from the docstrings, with their equations: ``python docs/build.py``.

It needs pdoc (``pip install pdoc``) beside the program and writes HTML to ``results/reference``.
Formulas are drawn by MathJax, which the pages load from the network.
"""

import argparse
import contextlib
import warnings
from pathlib import Path
from typing import Any

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401 - PyPI's stack must be loaded before mpi4py

import receding_fenicsx


def main() -> None:
    """Build the reference into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Build the reference.")
    parser.add_argument("--out", default="results/reference", help="folder for the pages")
    out = Path(parser.parse_args().out)
    build(out)
    print(f"{len(list(out.rglob('*.html')))} pages in {out}, the first is {out / 'index.html'}")


def build(out: Path) -> None:
    """Build the reference of all modules.

    Raises:
        RuntimeError: a module cannot be imported; pdoc would leave it out with a warning.
    """
    import pdoc

    # pdoc warns of types of libraries that are not installed; it shows their names
    warnings.filterwarnings("ignore", category=UserWarning, module=r"pdoc\..*")
    pdoc.render.configure(docformat="google", math=True, show_source=True)
    package: Any = receding_fenicsx
    # the docstring lists the public names; with __all__ pdoc would document them alone, without the
    # modules
    names = package.__all__
    del package.__all__
    try:
        missing = [name for name in modules() if not imports(name)]
        if missing:
            raise RuntimeError(f"cannot import {', '.join(missing)}: see receding-fenicsx doctor")
        pdoc.pdoc("receding_fenicsx", output_directory=out)
    finally:
        package.__all__ = names


def modules() -> list[str]:
    """Names of all modules of the package."""
    root = Path(receding_fenicsx.__file__).parent
    parts = [path.relative_to(root.parent).with_suffix("").parts for path in root.rglob("*.py")]
    found = {".".join(part[:-1] if part[-1] == "__init__" else part) for part in parts}
    return sorted(name for name in found if not name.endswith("__main__"))


def imports(name: str) -> bool:
    """Whether a module can be imported."""
    try:
        __import__(name)
    except ImportError:
        return False
    return True


if __name__ == "__main__":
    main()
