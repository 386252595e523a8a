"""XDMF files for ParaView: all fields of a body in one grid, all instants in one time series.

DOLFINx writes each field as a separate grid, which ParaView shows as separate blocks. Here the
fields of an instant are joined in one grid, and the instants of a folder in one temporal
collection, ``instants.xdmf``, which refers to their data. Time counts cycles: 1 is the start of
cycle 1, 1.5 the end of the first of two legs.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from receding_fenicsx.atomic import check_room, new_file
from receding_fenicsx.mpi import on_root

if TYPE_CHECKING:
    from receding_fenicsx.bulk.fields import BodyFields

INSTANT = re.compile(r"cycle\d+_leg\d+_s\d+\.\d+(_.+)?\.xdmf")
"""File names of instants; with two bodies the name of the body is at the end."""

XDMF_OVERHEAD = 100_000
"""Upper bound of the bytes of an XDMF file and its HDF5 file besides the arrays."""


def write_fields(parts: Sequence[BodyFields], file: Path) -> list[Path]:
    """Write displacement and cell stresses of the modelled bodies to XDMF files; collective.

    Args:
        parts: fields of each body.
        file: an .xdmf file; of two bodies each has its own, with the body's name in it.

    Returns:
        The file of each body.
    """
    files = [file]
    if len(parts) > 1:
        files = [file.with_stem(f"{file.stem}_{part.bulk.scene.body.name}") for part in parts]
    for part, own in zip(parts, files, strict=True):
        _write_body(part, own)
    return files


def _write_body(fields: BodyFields, file: Path) -> None:
    from dolfinx import io

    functions = [fields.displacement, *fields.stresses.cell.values()]
    comm, mesh = fields.bulk.comm, fields.bulk.body.mesh
    counts = [mesh.topology.index_map(dim).size_global for dim in (0, 2)]
    numbers = 4 * counts[1] + sum(3 * max(counts) for _ in ("geometry", *functions))
    on_root(comm, lambda: check_room(file, 8 * numbers + XDMF_OVERHEAD))
    with io.XDMFFile(comm, str(file), "w") as xdmf:
        xdmf.write_mesh(mesh)
        for function in functions:
            xdmf.write_function(function, 0.0)


def time_of(cycle: int, leg: int, s: float, legs: int) -> float:
    """Return the time of an instant, counted in cycles.

    Args:
        cycle: its cycle; 0 is the path from rest.
        leg: its leg in the cycle.
        s: its position on the leg, in [0, 1].
        legs: number of legs of the cycle.
    """
    return cycle + (leg + s) / legs


def join_fields(file: Path, time: float) -> None:
    """Join the fields that DOLFINx has written in one grid.

    Args:
        file: the XDMF file, replaced.
        time: time of the instant.
    """
    domain = ET.parse(file).getroot().find("Domain")
    assert domain is not None
    mesh = domain.find("Grid")
    assert mesh is not None
    grid = ET.Element("Grid", Name=file.stem, GridType="Uniform")
    grid.extend([part for part in mesh if part.tag in ("Topology", "Geometry")])
    ET.SubElement(grid, "Time", Value=repr(time))
    grid.extend(domain.iter("Attribute"))
    _write(file, grid)


def join_instants(folder: Path) -> list[Path]:
    """Write the series of a folder's instants, one for each body; return the files."""
    series: dict[str, list[ET.Element]] = {}
    for file in folder.glob("*.xdmf"):
        name = INSTANT.fullmatch(file.name)
        grid = ET.parse(file).getroot().find("Domain/Grid") if name else None
        if name is not None and grid is not None and grid.find("Time") is not None:
            series.setdefault(name[1] or "", []).append(grid)
    made = []
    for body, grids in series.items():
        whole = ET.Element("Grid", Name=f"instants{body}", GridType="Collection")
        whole.set("CollectionType", "Temporal")
        whole.extend(sorted(grids, key=_time))
        made.append(folder / f"instants{body}.xdmf")
        _write(made[-1], whole)
    return made


def _time(grid: ET.Element) -> float:
    time = grid.find("Time")
    assert time is not None
    return float(time.attrib["Value"])


def _write(file: Path, grid: ET.Element) -> None:
    root = ET.Element("Xdmf", Version="3.0")
    ET.SubElement(root, "Domain").append(grid)
    ET.indent(root)
    with new_file(file, overwrite=True) as beside:
        ET.ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)
