"""Write docs/measured.md: what the demos with known solutions print, with date and versions.

Each demo compares its numbers with a closed form, integral equations or a published result, and
ends with an error where they do not agree.

    python demos/benchmarks/measured.py                # or: measured.py NAME ... for some demos
"""

import ast
import datetime as dt
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import receding_fenicsx as rf

ROOT = Path(__file__).resolve().parents[2]
NAMES = (
    *("block", "frictionless_block", "two_blocks", "layer", "stack", "punch", "half_planes"),
    *("fretting", "lap_joint", "wear", "fatigue", "time_error"),
    *("press_fit", "rolling", "large_bodies"),
)
NO_RESULTS = (" ...", "written to", "are in ")
"""Words in lines of progress, and in those that name files."""


def section(name: str) -> str:
    """Run a demo and return what it prints, below its title."""
    (script,) = (ROOT / "demos").rglob(f"{name}.py")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, script],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    lines = [
        line.rstrip()
        for line in done.stdout.splitlines()
        if not any(words in line for words in NO_RESULTS)
    ]
    title = (ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or "").split("\n")[0]
    text = "\n".join(lines).strip()
    return f"## {name}\n\n{title}\n\n```text\n{text}\n```\n"


def main() -> None:
    """Write the page, or replace the sections of the demos that are named."""
    page = ROOT / "docs" / "measured.md"
    names = sys.argv[1:] or NAMES
    head = (
        "# Measured tables\n\nWhat demos with known solutions print and assert (but for seconds).\n"
        f"Version {rf.__version__}, {dt.date.today()}, Python {platform.python_version()}, "
        f"{platform.machine()}; made by `python demos/benchmarks/measured.py`.\n"
    )
    old = page.read_text(encoding="utf-8").split("\n## ")[1:] if page.exists() else []
    parts = {text.split("\n", 1)[0]: f"## {text.strip()}\n" for text in old}
    parts |= {name: section(name) for name in names}
    page.write_text("\n".join([head, *parts.values()]), encoding="utf-8")


if __name__ == "__main__":
    main()
