"""Specification of an import: a TOML file that names matrices, contact nodes, supports, loads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.exchange.formats import Freedom
from receding_fenicsx.scene.checks import Number, OneOf, Pair, Table
from receding_fenicsx.scene.column_file import read_columns
from receding_fenicsx.scene.profiles import FrictionProfile, Profile
from receding_fenicsx.scene.toml_reader import Place, as_list, convert, parse_toml

DIRECTIONS = {"x": (1,), "y": (2,), "xy": (1, 2)}
"""Freedoms that a support holds."""


@dataclass(frozen=True)
class Edge(Table):
    """Straight contact edge: its nodes, the normal into the body, and the law.

    ``weights`` are the lengths that the nodes stand for; default: half of those to the neighbours.
    """

    nodes: tuple[Number, ...]
    normal: Pair
    friction: FrictionProfile = 0.35
    initial_gap: Profile = 0.0
    weights: tuple[Number, ...] = ()
    name: str = "contact"


@dataclass(frozen=True)
class Fixed(Table):
    """Nodes that are held in "x", "y" or "xy"."""

    nodes: tuple[Number, ...]
    fix: Annotated[str, OneOf("x", "y", "xy")]


@dataclass(frozen=True)
class NodalLoad(Table):
    """Load: a file of nodal forces on the body, or of r*, which hold the contact against them."""

    name: str
    forces: str = ""
    reactions: str = ""


@dataclass(frozen=True)
class Specification(Table):
    """Files, their order of rows, and the number of rigid motions that are left free.

    The rows of a MatrixMarket file are x and y of one node after the other (``order`` "nodes"), or
    x of all nodes, then y ("components").
    """

    stiffness: str
    nodes: str
    free: int
    order: Annotated[str, OneOf("nodes", "components")] = "nodes"
    title: str = ""


@dataclass(frozen=True)
class Import:
    """A specification with its tables and the coordinates of its nodes by their numbers."""

    files: Specification
    contact: tuple[Edge, ...]
    support: tuple[Fixed, ...]
    load: tuple[NodalLoad, ...]
    points: dict[int, Array]
    folder: Path

    @property
    def fixed(self) -> set[Freedom]:
        """Freedoms that supports hold."""
        return {(int(n), k) for s in self.support for n in s.nodes for k in DIRECTIONS[s.fix]}

    @property
    def freedoms(self) -> list[Freedom]:
        """Freedom of each row of a matrix that does not name them."""
        if self.files.order == "nodes":
            return [(node, k) for node in self.points for k in (1, 2)]
        return [(node, k) for k in (1, 2) for node in self.points]


def read_specification(path: Path) -> Import:
    """Read a specification and the file of its nodes.

    Raises:
        InputError: a file cannot be read, a key is unknown or missing, or a value is wrong.
    """
    raw = parse_toml(read_text(path))
    tables: dict[str, Any] = {}
    for name, kind in (("contact", Edge), ("support", Fixed), ("load", NodalLoad)):
        label = f"[[{name}]]"
        items = as_list(raw.pop(name, []), name)
        tables[name] = tuple(convert(kind, item, partial(_labelled, label)) for item in items)
    files = convert(Specification, raw, partial(_labelled, "specification"))
    names = [load.name for load in tables["load"]]
    if not tables["contact"] or not names or len(set(names)) < len(names):
        raise InputError("needs a [[contact]], and [[load]] tables with names of their own")
    for load in tables["load"]:
        if bool(load.forces) == bool(load.reactions):
            raise InputError(f"load '{load.name}': give either forces or reactions")
    wanted = ("node", "x", "y")
    columns = read_columns(files.nodes, path.parent, "nodes", wanted, wanted)
    if len(columns.names) != 3:
        columns.refuse(f"has {len(columns.names)} column(s), not node, x, y")
    points = {int(row[0]): row[1:] for row in columns.values}
    if len(points) < len(columns.values) or np.any(columns.values[:, 0] % 1.0):
        columns.refuse("the numbers of the nodes have to be whole and different")
    return Import(files, **tables, points=points, folder=path.parent)


def _labelled(label: str, place: Place) -> tuple[str, Place]:
    return label, place
