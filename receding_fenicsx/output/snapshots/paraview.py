"""XDMF files of the whole body and its contact, for ParaView, pyvista and meshio.

An instant is one grid: the cells of all bodies, and the contact as lines between its nodes, which
are points of their own. Half bodies are completed. ``instants.xdmf`` is the series of all instants
of a folder in time. Numbers are in HDF5 files beside the XDMF files. ``docs/formats.md`` has the
names and meanings of the values.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.atomic import new_file
from receding_fenicsx.bulk.fields import Fields
from receding_fenicsx.output.snapshots.view import WholeContact, edge_values
from receding_fenicsx.store.hdf5 import new_hdf5


@dataclass(frozen=True)
class Grid:
    """Points, cells and their values."""

    points: Array  # (n, 3) coordinates
    # for each of the cells its XDMF number (lines: and their number of points), then its points
    topology: Ints
    at_points: dict[str, NDArray[Any]]  # values at points, (n,) or (n, 3)
    in_cells: dict[str, NDArray[Any]]  # values of cells, (m,)


def grid_of(fields: Fields, contact: WholeContact) -> Grid:
    """Join the whole bodies, with stresses of their cells by name, and the contact in one grid."""
    n, m = len(fields.points), len(contact.x)
    names = list(fields.stress)
    values = np.column_stack([fields.displacement, *fields.stress.values()])
    line = np.zeros((m, values.shape[1]))
    for k in np.unique(contact.edge):
        on = contact.edge == k
        line[on] = edge_values(
            fields, values, contact.points[on], contact.normal[on][0], contact.body[on][0]
        )
    joined = np.vstack([values, line])
    third = [(0, 0), (0, 1)]  # vectors of the plane have a third component 0
    p, q = contact.p[:, None], contact.q[:, None]
    of_contact = {
        "p": contact.p,
        "q": contact.q,
        "traction": np.pad(q * contact.tangent + p * contact.normal, third),
        "gap": contact.initial_gap + contact.w,
        "slip": contact.v,
    }
    at_points: dict[str, NDArray[Any]] = {"displacement": np.pad(joined[:, :2], third)}
    at_points |= {name: joined[:, 2 + i] for i, name in enumerate(names)}
    for name, value in of_contact.items():
        before = [(n, 0), (0, 0)][: value.ndim]
        at_points[name] = np.pad(value, before, constant_values=np.nan)
    at_points["state"] = np.pad(contact.state.astype(np.int32), (n, 0))

    start = np.flatnonzero(np.diff(contact.edge) == 0)
    ends = np.column_stack([start, start + 1])
    # XDMF's numbers: 4 a triangle, 5 a quadrilateral, 2 a polyline of two points
    kind = np.full(len(fields.cells), {3: 4, 4: 5}[fields.cells.shape[1]])
    lines = np.column_stack([np.tile((2, 2), (len(ends), 1)), ends + n])
    body = np.zeros(n, dtype=int) if fields.body is None else fields.body
    part = np.append(1 + body[fields.cells[:, 0]], np.zeros(len(ends)))
    in_cells: dict[str, NDArray[Any]] = {"part": part.astype(np.int32)}
    for i, name in enumerate(names):
        in_cells[f"{name}_cell"] = np.append(
            fields.cell_stress[name], line[ends, 2 + i].mean(axis=1)
        )
    return Grid(
        points=np.pad(np.vstack([fields.points, contact.points]), third),
        topology=np.append(np.column_stack([kind, fields.cells]), lines),
        at_points=at_points,
        in_cells=in_cells,
    )


def write_instant(file: Path, grid: Grid, time: float) -> None:
    """Write an instant as XDMF, its numbers as HDF5, and anew the series of all in the folder."""
    data = file.with_suffix(".h5")
    element = ET.Element("Grid", Name=file.stem, GridType="Uniform")
    cells = str(len(grid.in_cells["part"]))
    with new_hdf5(data, overwrite=True) as h5:
        h5.attrs["time"] = time

        def add(parent: ET.Element, name: str, values: NDArray[Any]) -> None:
            h5[name] = values
            item = ET.SubElement(parent, "DataItem", Format="HDF")
            item.set("Dimensions", " ".join(map(str, values.shape)))
            item.set("NumberType", "Float" if values.dtype.kind == "f" else "Int")
            item.set("Precision", str(values.dtype.itemsize))
            item.text = f"{data.name}:/{name}"

        topology = ET.SubElement(element, "Topology", TopologyType="Mixed", NumberOfElements=cells)
        add(topology, "topology", grid.topology)
        add(ET.SubElement(element, "Geometry", GeometryType="XYZ"), "geometry", grid.points)
        for center, group in (("Node", grid.at_points), ("Cell", grid.in_cells)):
            for name, values in group.items():
                kind = "Vector" if values.ndim == 2 else "Scalar"
                attribute = ET.SubElement(element, "Attribute", Name=name, AttributeType=kind)
                attribute.set("Center", center)
                add(attribute, f"{center.lower()}/{name}", values)
    _write(file, element)
    grids = []
    for other in file.parent.glob("cycle*_leg*_s*.xdmf"):
        found, data = ET.parse(other).getroot().find("Domain/Grid"), other.with_suffix(".h5")
        if found is not None and data.is_file():
            with h5py.File(data) as h5:
                when = h5.attrs.get("time")
            if when is not None:
                found.insert(0, ET.Element("Time", Value=repr(float(when))))
                grids.append((float(when), other.name, found))
    series = ET.Element("Grid", Name="instants", GridType="Collection", CollectionType="Temporal")
    series.extend(found for _, _, found in sorted(grids, key=lambda entry: entry[:2]))
    _write(file.with_name("instants.xdmf"), series)


def _write(file: Path, grid: ET.Element) -> None:
    root = ET.Element("Xdmf", Version="3.0")
    ET.SubElement(root, "Domain").append(grid)
    ET.indent(root)
    with new_file(file, overwrite=True) as beside:
        ET.ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)
