"""Reader and writer of ``summary.json``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from receding_fenicsx.atomic import new_file
from receding_fenicsx.errors import InputError


def write_summary(path: Path, summary: Mapping[str, Any], overwrite: bool = False) -> None:
    """Write a summary as JSON; numbers that are not finite become null."""
    with new_file(path, overwrite) as beside:
        text = json.dumps(_finite(summary), indent=2, ensure_ascii=False, allow_nan=False)
        beside.write_text(text + "\n", encoding="utf-8")


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary.

    Raises:
        InputError: the file does not exist or is not a summary.
    """
    try:
        summary = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give the folder of a finished run") from None
    except (OSError, ValueError):
        raise InputError(f"{path}: is damaged or not a JSON file; run the scene again") from None
    needed = {"title", "steady", "turning_points", "dissipation_per_cycle"}
    if not isinstance(summary, dict) or not needed <= summary.keys():
        raise InputError(f"{path}: is not a summary of a run; run the scene again")
    return summary


def _finite(value: Any) -> Any:
    """Return a value with every number that is not finite replaced by None."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
