"""Matrices of finite element programs as text; the content of a file says which form it has.

* MatrixMarket, a first line ``%%MatrixMarket``: rows without names.
* Abaqus' and CalculiX' ``*SUBSTRUCTURE MATRIX OUTPUT`` as a user element: the nodes in comments
  after ``** ELEMENT NODES``, the freedoms of the first node, "place in the list of nodes, freedoms"
  where they change, and under ``*MATRIX,TYPE=STIFFNESS`` the lower triangle row by row.
* Abaqus' ``*MATRIX OUTPUT`` and CalculiX' ``OUTPUT FILE=MATRIX``: "node, freedom, node, freedom,
  value", one triangle or both; of a load "node, freedom, value".
* CalculiX' ``SOLVER=MATRIXSTORAGE``: "row column value" of a triangle in ``NAME.sti``, and the line
  "node.freedom" of each row in ``NAME.dof``.
"""

from __future__ import annotations

import math
import re
from inspect import signature
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io, sparse

from receding_fenicsx.arrays import Array
from receding_fenicsx.atomic import read_text
from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.profiles import numbers_in

Freedom = tuple[int, int]
"""Number of a node, and 1 for its displacement in x, 2 for that in y."""
Named = tuple[sparse.csc_matrix, list[Freedom] | None]
"""A square matrix, and the freedom of each row where the file names them."""


def read_matrix(path: Path) -> Named:
    """Read a stiffness."""
    text = read_text(path)
    try:
        if text.startswith("%%MatrixMarket"):
            matrix = sparse.csc_matrix(_market(path, text))
            if matrix.shape[0] != matrix.shape[1]:
                raise ValueError(f"it is {matrix.shape[0]} by {matrix.shape[1]}, not square")
            return matrix, None
        if "*USER ELEMENT" in text.upper():
            return _user_element(text)
        rows = _table(text, (5, 3))
        if rows.shape[1] == 5:
            entries = _whole(rows[:, :4]).reshape(-1, 2).tolist()
            freedoms = sorted({(node, k) for node, k in entries})
            place = {freedom: i for i, freedom in enumerate(freedoms)}
            i, j = np.array([place[node, k] for node, k in entries]).reshape(-1, 2).T
            return _both_triangles(i, j, rows[:, 4], len(freedoms)), freedoms
        words = (word.split(".") for word in read_text(path.with_suffix(".dof")).split())
        freedoms = [(int(node), int(k)) for node, k in words]
        i, j = _whole(rows[:, :2]).T - 1
        return _both_triangles(i, j, rows[:, 2], len(freedoms)), freedoms
    except (ValueError, IndexError, TypeError, StopIteration) as error:
        raise InputError(f"{path}: is not a stiffness ({error})".replace("\n", " ")) from None


def read_vector(path: Path, freedoms: list[Freedom]) -> Array:
    """Read nodal forces in the order of given freedoms."""
    text, values = read_text(path), np.zeros(len(freedoms))
    try:
        if text.startswith("%%MatrixMarket"):
            found = sparse.csc_matrix(_market(path, text)).toarray()
            if 1 not in found.shape:
                raise ValueError(f"it is {found.shape[0]} by {found.shape[1]}, not one column")
            values = np.ravel(found)
        else:
            rows, place = _table(text, (3,)), {freedom: i for i, freedom in enumerate(freedoms)}
            for (node, k), value in zip(_whole(rows[:, :2]).tolist(), rows[:, 2], strict=True):
                if (node, k) not in place:
                    raise ValueError(f"the stiffness has no freedom {k} of node {node}")
                values[place[node, k]] += value
    except (ValueError, IndexError, TypeError) as error:
        raise InputError(f"{path}: is not a load ({error})".replace("\n", " ")) from None
    finite = np.count_nonzero(np.isfinite(values))
    if not finite == values.size == len(freedoms):
        raise InputError(f"{path}: needs {len(freedoms)} finite values, has {finite}")
    return values


def _numbers(line: str) -> list[float]:
    """Return the numbers of a line, which are finite."""
    words = [word for word in re.split(r"[,\s]+", line) if word]
    found = [math.nan if number is None else number for number in numbers_in(words)]
    for word, number in zip(words, found, strict=True):
        if not math.isfinite(number):
            raise ValueError(f'"{word[:40]}" is not a finite number')
    return found


def _table(text: str, widths: tuple[int, ...]) -> Array:
    """Return rows of as many numbers each; lines of comments and keywords begin with *."""
    rows: list[list[float]] = []
    for k, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.startswith("*"):
            try:
                rows.append(_numbers(line))
                if len(rows[-1]) not in widths:
                    need = " or ".join(map(str, widths))
                    raise ValueError(f"{len(rows[-1])} numbers, not {need}")
                widths = (len(rows[-1]),)
            except ValueError as error:
                raise ValueError(f"line {k}: {error}") from None
    if not rows:
        raise ValueError("it has no row of numbers")
    return np.array(rows)


def _market(path: Path, text: str) -> Any:
    """Return the matrix of a MatrixMarket file; SciPy's reader never ends on a file of comments."""
    if re.match(r"\S+\s+\S+\s+\S+\s+(pattern|complex)", text, re.IGNORECASE):
        raise ValueError("its numbers are complex, or it has none")
    if not re.search(r"(?m)^\s*[^%\s]", text):
        raise ValueError("it ends before the numbers of its rows and columns")
    # SciPy's newer releases warn where they are not told which kind of matrix to return
    told = {"spmatrix": False} if "spmatrix" in signature(io.mmread).parameters else {}
    return io.mmread(path, **told).astype(float)


def _whole(values: Array) -> Any:
    if not np.all((values == np.round(values)) & (np.abs(values) < 2**53)):
        raise ValueError("numbers of nodes, freedoms and rows have to be whole")
    return values.astype(int)


def _user_element(text: str) -> Named:
    """Return the stiffness of a user element."""
    # split at the keyword lines before the entries
    head, *parts = re.split(r"(?im)^\*MATRIX\s*,\s*TYPE\s*=\s*(\w+).*$", text)
    kinds = [kind.upper() for kind in parts[::2]]
    if kinds.count("STIFFNESS") != 1 or head.upper().count("*USER ELEMENT") != 1:
        raise ValueError("one *USER ELEMENT with one *MATRIX,TYPE=STIFFNESS is needed")
    if "UNSYMM" in head.upper():
        raise ValueError("the user element is unsymmetric")
    _, named, *_ = (*re.split(r"(?im)^\*\* *ELEMENT NODES.*$", head), "")
    lines = [line for line in named.splitlines() if line.strip()]
    comments = takewhile(lambda line: line.startswith("**"), lines)
    nodes = [int(k) for line in comments for k in _numbers(line.strip("* "))]
    now, *rest = ([int(k) for k in _numbers(line)] for line in lines if line[0] != "*")
    changes, freedoms = {place: directions for place, *directions in rest}, []
    for place, node in enumerate(nodes, 1):
        now = changes.get(place, now)
        freedoms += [(node, k) for k in now]
    body = parts[2 * kinds.index("STIFFNESS") + 1].splitlines()
    values = np.array([k for line in body if line[:1] != "*" for k in _numbers(line)])
    n = len(freedoms)
    if len(values) != n * (n + 1) // 2:
        raise ValueError(f"{len(values)} entries for the triangle of {n} freedoms")
    return _both_triangles(*np.tril_indices(n), values, n), freedoms


def _both_triangles(i: Any, j: Any, values: Array, n: int) -> sparse.csc_matrix:
    """Return a symmetric matrix of which one triangle is given, or both."""
    given = sparse.coo_matrix((values, (i, j)), shape=(n, n))
    if len(np.unique(np.asarray(i) * n + j)) < len(values):
        raise ValueError("an entry is given twice")
    if np.any(i < j) and np.any(i > j):
        return given.tocsc()
    return (given + given.T - sparse.diags(given.diagonal())).tocsc()
