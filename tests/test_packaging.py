"""What pyproject.toml says of the package's folders is what stands there."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def test_every_package_is_shipped() -> None:
    folders = {path.parent for path in (ROOT / "receding_fenicsx").rglob("__init__.py")}
    names = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(SETUPTOOLS["packages"]) == names | set(SETUPTOOLS["package-dir"])


def test_all_mesh_sources_are_shipped() -> None:
    assert SETUPTOOLS["package-dir"]["receding_fenicsx.meshes"] == "meshes"
    files = {path for path in (ROOT / "meshes").iterdir() if not path.name.startswith(("__", "."))}
    patterns = SETUPTOOLS["package-data"]["receding_fenicsx.meshes"]
    assert files
    assert files == {path for pattern in patterns for path in (ROOT / "meshes").glob(pattern)}
