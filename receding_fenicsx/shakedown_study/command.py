"""Command ``shakedown`` of the command line."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mpi4py import MPI

    from receding_fenicsx.scene.model import Scene
    from receding_fenicsx.shakedown_study.study import ShakedownStudy
    from receding_fenicsx.timing import Say


def arguments(added: argparse.ArgumentParser) -> None:
    """Add the arguments of the command, beside the scene's."""
    added.add_argument("--out", required=True, metavar="DIR", help="output folder")
    added.add_argument("--overwrite", action="store_true", help="replace an earlier study")


def run(scene: Scene, options: argparse.Namespace, comm: MPI.Comm, say: Say) -> str:
    """Run the command on all ranks; return the text that rank 0 prints."""
    from receding_fenicsx.shakedown_study.study import shakedown

    found = shakedown(scene, options.out, options.overwrite, comm, say)
    return "" if found is None else f"{text_of(found)}\nwritten to {options.out}"


def text_of(found: ShakedownStudy) -> str:
    """Return a study as lines for the terminal."""
    limits = found.limits
    beyond = " of the closed contact" if limits.opens else ": above, it never stops"
    if np.isinf(limits.upper):
        beyond = ": the range never makes it slip from the safe slip"
    lines = [
        f"lower limit   {limits.lower:.6g}  ({limits.lower_is}): below, the contact stops slipping",
        f"upper limit   {limits.upper:.6g}{beyond}",
        f"residual      {limits.residual:.1e} of the largest force, dual gap {limits.gap:.1e}",
    ]
    if len(found.meshes) > 1:
        nodes, lower, upper = found.meshes[1]
        lines.append(
            f"second mesh   {lower:.6g} and {upper:.6g} with {nodes} nodes instead of "
            f"{found.meshes[0][0]}"
        )
    lines += [f"{limit} binds   {limits.binding(limit)}" for limit in ("lower", "upper")]
    if found.by_cycles is not None:
        low, high = found.by_cycles
        lines.append(
            f"exact cycles  from rest or the safe slip end without slip up to {low:.4g}, "
            f"not at {high:.4g}"
        )
    return "\n".join([*lines, *(f"note: {note}" for note in found.notes)])
