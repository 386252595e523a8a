"""Compilation of the event loop: what is kept on disk, for how long, and what is said meanwhile."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from test_imports import MODULES, modules_of

import receding_fenicsx as rf
from receding_fenicsx.interface.exact import kernel

pytestmark = [pytest.mark.one_rank, pytest.mark.once(False)]

TWICE = """
from receding_fenicsx.interface.exact import kernel
@kernel.compiled
def twice(x):
    return 2.0 * x
"""

RUN = """
import numpy as np
from receding_fenicsx.interface.exact import compilation, kernel
kernel.follow = kernel.on_limits  # a small part, which takes less than a second
compilation._tell()
print(kernel.on_limits(np.array([0.0, 0.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.0, 1.0])))
stats = kernel.on_limits.stats
print(stats.cache_path, sum(stats.cache_hits.values()))
"""


def module(path: Path) -> ModuleType:
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_machine_code_is_kept_while_all_sources_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "calculation.py"
    path.write_text(TWICE)
    hits = []
    for sources in (kernel.SOURCES, kernel.SOURCES, ("another", *kernel.SOURCES[1:])):
        monkeypatch.setattr(kernel, "SOURCES", sources)
        twice = module(path).twice
        assert twice(3.0) == 6.0
        hits.append(sum(twice.stats.cache_hits.values()))
    assert hits == [0, 1, 0]


def test_all_modules_that_enter_the_machine_code_are_among_its_sources() -> None:
    enters = modules_of("interface.exact.kernel")
    enters -= {"arrays", "interface", "interface.exact"}  # types, and the folders of modules
    for name in enters:
        assert sha256(MODULES[name].read_bytes()).hexdigest() in kernel.SOURCES, name


@pytest.mark.parametrize("home", ["home", "file/home"])
def test_an_installation_that_cannot_be_written_compiles(tmp_path: Path, home: str) -> None:
    (tmp_path / "file").write_text("")
    package = Path(rf.__file__).parent
    away = shutil.ignore_patterns("__pycache__")
    shutil.copytree(package, tmp_path / package.name, ignore=away)
    # a file in the place of the folder keeps root, too, from writing
    (tmp_path / package.name / "interface" / "exact" / "__pycache__").write_text("")
    kept = "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH"
    variables = {k: v for k, v in os.environ.items() if k not in kept}
    variables |= {"PYTHONPATH": str(tmp_path), "HOME": str(tmp_path / home)}
    for repeated in (False, True):
        done = subprocess.run(
            [sys.executable, "-c", RUN], cwd=tmp_path, env=variables, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        count, folder = done.stdout.splitlines()
        assert count == "2"
        if home == "home":
            # said where it is compiled only
            assert folder.startswith(str(tmp_path / home)) and folder.endswith(str(int(repeated)))
            assert done.stderr.count("about 10 s; once") == 1 - repeated
        else:
            assert folder == "None 0"
            assert done.stderr.count("NUMBA_CACHE_DIR") == 1
