"""Files of a shakedown study: JSON, profile of the safe slip, diagram."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import make_folder, unwritable
from receding_fenicsx.errors import InputError
from receding_fenicsx.output.storage.summary_file import write_summary
from receding_fenicsx.shakedown_study.diagram import Diagram, draw

SUMMARY, SLIP, PICTURE, SCENE = "shakedown.json", "safe_slip.csv", "shakedown.png", "scene.toml"
"""Names of the files."""


def check(path: Path, overwrite: bool) -> None:
    """Raise InputError unless the folder of a study may be created at ``path``.

    Raises:
        InputError: something else is there, or an earlier study that may not be replaced.
    """
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"{path}: is a file; give a new folder")
    if not any(path.iterdir()):
        return
    if not (path / SUMMARY).is_file():
        raise InputError(f"{path}: is not the folder of a shakedown study; choose another folder")
    if not overwrite:
        raise InputError(f"{path}: already exists; choose another folder or give --overwrite")


def write(
    path: Path,
    scene_toml: str,
    summary: Mapping[str, Any],
    slip: tuple[Array, Array] | None,
    diagram: Diagram,
) -> None:
    """Write a study beside its folder and rename it.

    Args:
        path: the folder.
        scene_toml: text of the scene.
        summary: content of ``shakedown.json``.
        slip: positions and values of the safe slip; None writes no profile.
        diagram: the diagram.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    make_folder(beside)
    try:
        write_summary(beside / SUMMARY, summary)
        (beside / SCENE).write_text(scene_toml, encoding="utf-8")
        if slip is not None:
            columns = np.column_stack(slip)
            np.savetxt(beside / SLIP, columns, "%.17g", ",", header="x,value", comments="")
        draw(diagram, beside / PICTURE)
        if path.exists():
            shutil.rmtree(path)
        os.replace(beside, path)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
