"""Commands ``import``, ``export --matrices`` and ``export --reduced``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import io

from receding_fenicsx.atomic import check_file
from receding_fenicsx.exchange.importing import import_system
from receding_fenicsx.scene.toml_file import read_scene
from receding_fenicsx.store.hdf5 import read_system, write_system
from receding_fenicsx.store.run_folder import SYSTEM
from receding_fenicsx.store.workspace import FolderKind

COLUMNS = ("x", "px", "py", "weight", "f_forward", "f_backward", "gap", "held_v", "held_w")
"""Columns of ``nodes.csv``; the points are (px, py)."""


def import_file(specification: str, out: str, overwrite: bool) -> None:
    """Import a system, save it and print what it is."""
    path = Path(out)
    check_file(path, overwrite)
    system = import_system(specification)
    write_system(path, system, overwrite)
    pressed = system.r_star[:, system.n :].sum(axis=1)
    loads = zip(system.load_names, pressed, strict=True)
    told = ", ".join(f"{name} (pressed by {P:.6g})" for name, P in loads)
    motions = system.rigid.shape[1]
    print(f"{system.n} contact nodes, {motions} rigid motion(s), {told}, written to {path}")


def export_matrices(source: Path, out: Path, overwrite: bool) -> None:
    """Write K (rows [v; w]), r* (a row a load) and rigid motions as MatrixMarket, nodes as CSV."""
    kind = FolderKind("set of matrices", ("stiffness.mtx",), resumable=False)
    kind.check(out, overwrite)
    system = read_system(source / SYSTEM if source.is_dir() else source)
    matrices = {"stiffness": system.K, "r_star": system.r_star, "rigid": system.rigid}
    law = (system.weight, system.friction.forward, system.friction.backward, system.g0)
    table = np.column_stack([system.x, system.points, *law, system.held.reshape(2, -1).T])
    with kind.new(out, overwrite) as beside:
        for name, matrix in matrices.items():
            symmetry = "symmetric" if name == "stiffness" else "general"
            text = f"{name} of [v; w]; loads {', '.join(system.load_names)}"
            io.mmwrite(beside / f"{name}.mtx", matrix, text, precision=17, symmetry=symmetry)
        np.savetxt(beside / "nodes.csv", table, "%.17g", ",", header=",".join(COLUMNS), comments="")
    print(f"{system.n} contact nodes, {len(system.load_names)} load(s), written to {out}")


def export_reduced(source: Path, out: Path, overwrite: bool) -> None:
    """Write the reduced model of a scene."""
    from receding_fenicsx.exchange.reduced import reduced_model

    check_file(out, overwrite)
    model = reduced_model(read_scene(source))
    model.save(out, overwrite)
    found = ", ".join(f"{omega:.6g}" for omega in model.omega)
    print(
        f"{len(model.M)} coordinates, {len(model.points)} contact nodes, modes with the contact "
        f"held at omega = {found}, written to {out}"
    )
