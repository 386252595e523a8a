"""Import of a body from its own finite elements, through the text files of three programs."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from models import q1_stiffness
from scipy import io, sparse

import receding_fenicsx as rf
from receding_fenicsx import cli

pytestmark = pytest.mark.one_rank
assert MPI.COMM_WORLD

COLUMNS, ROWS = 6, 3
"""Square elements of the block."""


class Block:
    """A block of squares, numbered 1, 2, ... row by row from the bottom, where it touches."""

    def __init__(self) -> None:
        x, y = np.meshgrid(np.arange(COLUMNS + 1.0), np.arange(ROWS + 1.0))
        self.points = np.column_stack([x.ravel(), y.ravel()])
        n, wide = len(self.points), COLUMNS + 1
        self.A = np.zeros((2 * n, 2 * n))
        for row in range(ROWS):
            for column in range(COLUMNS):
                first = row * wide + column
                nodes = np.array([first, first + 1, first + wide + 1, first + wide])
                dofs = (2 * nodes[:, None] + np.arange(2)).ravel()
                self.A[np.ix_(dofs, dofs)] += q1_stiffness(1.0, 1.0, 1.0, 0.3)
        top = np.arange(n - wide, n)
        half = np.full(wide, 1.0)
        half[[0, -1]] = 0.5
        self.forces = {name: np.zeros(2 * n) for name in ("P", "Q")}
        self.forces["P"][2 * top + 1] = -0.01 * half
        self.forces["Q"][2 * top] = 0.003 * half
        self.contact = np.arange(wide)
        self.freedoms = [(i + 1, k) for i in range(n) for k in (1, 2)]

    def condensed(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return K and r* of the contact by dense algebra, [v; w]."""
        C = np.concatenate([2 * self.contact, 2 * self.contact + 1])
        inside = np.setdiff1d(np.arange(len(self.A)), C)
        X = np.linalg.solve(self.A[np.ix_(inside, inside)], self.A[np.ix_(inside, C)])
        K = self.A[np.ix_(C, C)] - self.A[np.ix_(C, inside)] @ X
        return K, {name: X.T @ f[inside] - f[C] for name, f in self.forces.items()}


Writer = Callable[[Path, Block], str]


def specification(
    folder: Path, block: Block, stiffness: str = "", more: str = "", free: int = 3
) -> Path:
    """Write the files of an import, and its stiffness where it is not there."""
    stiffness = stiffness or write_market(folder, block)
    rows = [f"{i},{x!r},{y!r}" for i, (x, y) in enumerate(block.points.tolist(), 1)]
    (folder / "nodes.csv").write_text("node,x,y\n" + "\n".join(rows))
    for name, f in block.forces.items():
        pairs = zip(block.freedoms, f.tolist(), strict=True)
        lines = [f"{node},{k},{v!r}" for (node, k), v in pairs if v]
        (folder / f"{name}.txt").write_text("*CLOAD\n  \n" + "\n".join(lines))
    nodes = (block.contact + 1).tolist()[::-1]  # any order
    text = f'stiffness = "{stiffness}"\nnodes = "nodes.csv"\nfree = {free}\n'
    text += f"[[contact]]\nnodes = {nodes}\nnormal = [0.0, 2.0]\nfriction = 0.32\n"
    text += "".join(f'[[load]]\nname = "{k}"\nforces = "{k}.txt"\n' for k in block.forces)
    (folder / "import.toml").write_text(text + more)
    return folder / "import.toml"


def write_market(folder: Path, block: Block) -> str:
    io.mmwrite(folder / "K.mtx", sparse.coo_matrix(block.A), precision=17)
    return "K.mtx"


def write_labelled(folder: Path, block: Block) -> str:
    """Write Abaqus' *MATRIX OUTPUT: the lower triangle, with D before exponents."""
    lines = [
        f"{a[0]},{a[1]}, {b[0]},{b[1]},  {block.A[i, j]:.16e}".replace("e", "D")
        for i, a in enumerate(block.freedoms)
        for j, b in enumerate(block.freedoms[: i + 1])
        if block.A[i, j] or i == j
    ]
    (folder / "job_STIF1.mtx").write_text("\n".join(lines))
    return "job_STIF1.mtx"


def write_calculix(folder: Path, block: Block) -> str:
    """Write CalculiX' .sti and .dof: the upper triangle, rows and columns from 1, in any order."""
    A, n = block.A[::-1, ::-1], len(block.A)
    rows = [(i, j) for j in range(n) for i in range(j + 1) if A[i, j]]
    (folder / "job.sti").write_text("".join(f"{i + 1} {j + 1} {A[i, j]:20.13e}\n" for i, j in rows))
    (folder / "job.dof").write_text("".join(f"{node}.{k}\n" for node, k in block.freedoms[::-1]))
    return "job.sti"


def write_user_element(
    folder: Path, K: np.ndarray, freedoms: list[tuple[int, int]], calculix: bool
) -> str:
    """Write a substructure; CalculiX repeats a node for each of its freedoms."""
    if calculix:
        nodes = [node for node, _ in freedoms]
        named = [f"{freedoms[0][1]:10d}"]
        named += [f"{i:10d},{k:10d}" for i, (_, k) in enumerate(freedoms, 1) if i > 1]
    else:
        # all nodes but the first one have their second freedom first
        nodes, named = list(dict.fromkeys(node for node, _ in freedoms)), ["1, 2", "2, 2, 1"]
        order = np.append([0, 1], np.arange(2, len(K)).reshape(-1, 2)[:, ::-1])
        K = K[np.ix_(order, order)]
    head = ["**", f"*USER ELEMENT, NODES={len(nodes):10d}, LINEAR", "** ELEMENT NODES"]
    head += [f"** {', '.join(map(str, nodes[i : i + 10]))}," for i in range(0, len(nodes), 10)]
    mass = ["*MATRIX,TYPE=MASS", *["7.0"] * (len(K) * (len(K) + 1) // 2)]
    # the matrices come in any order
    lines = [*head, *named, *([] if calculix else mass), "*MATRIX,TYPE=STIFFNESS"]
    for i in range(len(K)):
        row = [f"{value:.{13 if calculix else 16}e}" for value in K[i, : i + 1]]
        lines += [", ".join(row[j : j + 4]) + "," for j in range(0, i + 1, 4)]
    lines = [*lines, "**", *(mass if calculix else ["*DAMPING"])]
    (folder / "sub.mtx").write_text("\n".join(lines))
    return "sub.mtx"


@pytest.mark.parametrize("write", [write_market, write_labelled, write_calculix])
def test_a_block_of_own_elements_is_condensed(write: Writer, tmp_path: Path) -> None:
    block = Block()
    system = rf.import_system(specification(tmp_path, block, write(tmp_path, block)))
    K, r_star = block.condensed()
    digits = 1e-12 if write is write_calculix else 1e-14
    assert np.abs(system.K - K).max() < 100 * digits * np.abs(K).max()
    for k, name in enumerate(system.load_names):
        assert np.abs(system.r_star[k] - r_star[name]).max() < 100 * digits * 0.01
    # forces balance: the reactions carry all loads
    n = system.n
    assert system.r_star[0, n:].sum() == pytest.approx(0.01 * COLUMNS)
    assert system.r_star[1, :n].sum() == pytest.approx(-0.003 * COLUMNS)
    assert system.rigid.shape == (2 * n, 3) and np.all(np.diff(system.x) > 0.0)
    assert system.weight.sum() == COLUMNS


@pytest.mark.parametrize("form", ["market", "abaqus", "lower case", "calculix"])
def test_an_imported_system_holds_the_arrays_bit_by_bit(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = Block()
    block.forces["Q"] += block.forces["P"]  # along and across the contact
    K, r_star = block.condensed()
    n = len(block.contact)
    nodes = (block.contact + 1).tolist()
    by_node = np.arange(2 * n).reshape(2, n).T.ravel()  # x and y of each node in turn
    freedoms = [(node, k) for node in nodes for k in (1, 2)]
    block.points = block.points[:n]
    # what 14 digits hold is the matrix of both
    lower = np.tril([[float(f"{value:.13e}") for value in row] for row in K])
    K = lower + np.tril(lower, -1).T
    if form == "market":
        io.mmwrite(tmp_path / "K.mtx", K[np.ix_(by_node, by_node)], precision=17)
        name = "K.mtx"
    else:
        local = K[np.ix_(by_node, by_node)]
        name = write_user_element(tmp_path, local, freedoms, form == "calculix")
        if form == "lower case":  # Abaqus' keywords have any case
            (tmp_path / name).write_text((tmp_path / name).read_text().lower())
    block.freedoms, block.forces = freedoms, {k: -r[by_node] for k, r in r_star.items()}
    path = specification(tmp_path, block, name)
    head = ["import", str(path), "--out", str(tmp_path / "system.h5")]
    words = f"{n} contact nodes, 3 rigid motion(s), P (pressed by 0.06), Q (pressed by 0.06)"
    for more, code in (([], 0), ([], 2), (["--overwrite"], 0)):
        assert cli.main([*head, *more]) == code
        said = capsys.readouterr()
        assert words in said.out if code == 0 else "already exists" in said.err
    imported = rf.read_system(tmp_path / "system.h5")
    by_hand = {
        "x": block.points[:, 0] - COLUMNS / 2,
        "points": block.points,
        "weight": [0.5, *[1.0] * (n - 2), 0.5],
        "K": K,
        "r_star": list(r_star.values()),
        "load_names": ("P", "Q"),
        "f": np.full(n, 0.32),
        "g0": np.zeros(n),
        "held": np.zeros(2 * n),
        "load_compliance": np.zeros((2, 2)),
        "load_sign": -np.ones(2),
    }
    for name, known in by_hand.items():
        assert np.array_equal(getattr(imported, name), known), name


def test_supports_hold_and_interior_nodes_can_be_fixed(tmp_path: Path) -> None:
    block = Block()
    name = write_market(tmp_path, block)
    top = list(range(len(block.points) - COLUMNS, len(block.points) + 1))
    more = f'[[support]]\nnodes = {top}\nfix = "x"\n[[support]]\nnodes = [1]\nfix = "x"\n'
    system = rf.import_system(specification(tmp_path, block, name, more, free=1))
    assert system.held.nonzero()[0].tolist() == [0]
    # the block moves along y alone
    assert np.allclose(np.abs(system.rigid[:, 0]), np.repeat([0.0, 1.0], system.n))
    more = more.replace('nodes = [1]\nfix = "x"', 'nodes = [1]\nfix = "xy"')
    system = rf.import_system(specification(tmp_path, block, name, more, free=0))
    assert system.held.nonzero()[0].tolist() == [0, system.n]
    # the support carries the normal force
    assert system.f[0] == 0.0 and np.all(system.f[1:] == 0.32)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 180.0, 250.0])
def test_a_turned_block_has_the_same_system_along_its_own_directions(
    degrees: float, tmp_path: Path
) -> None:
    block, angle = Block(), np.radians(degrees)
    block.forces["Q"] += block.forces["P"]  # each moves the other
    K, r_star = block.condensed()
    inside = np.arange(2 * len(block.contact), len(block.A))
    forces = np.array(list(block.forces.values()))[:, inside]
    compliance = forces @ np.linalg.solve(block.A[np.ix_(inside, inside)], forces.T)
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = np.kron(np.eye(len(block.points)), R)
    block.points, block.A = block.points @ R.T, turn @ block.A @ turn.T
    block.forces = {name: turn @ f for name, f in block.forces.items()}
    path = specification(tmp_path, block)
    turned(path, "[0.0, 2.0]", str((2.0 * R[:, 1]).tolist()))
    turned(path, "friction = 0.32", "friction = {forward = 0.4, backward = 0.1}")
    system = rf.import_system(path)
    assert np.abs(system.K - K).max() < 1e-12 * np.abs(K).max()
    assert np.abs(system.r_star - list(r_star.values())).max() < 1e-14
    assert system.load_compliance == pytest.approx(compliance, rel=1e-11, abs=1e-14)
    assert np.all(system.f == 0.4) and np.all(system.friction.backward == 0.1)


def test_the_order_of_nodes_and_of_lines_of_force_is_free(tmp_path: Path) -> None:
    path = specification(tmp_path, block := Block())
    text = path.read_text()
    named = text[text.index("nodes = [") : text.index("normal")]
    n, rng = len(block.contact), np.random.default_rng(1)
    weights = rng.uniform(0.5, 1.5, n)
    systems = []
    for order in (np.arange(n), rng.permutation(n)):
        nodes = (
            f"nodes = {(block.contact[order] + 1).tolist()}\nweights = {weights[order].tolist()}"
        )
        path.write_text(text.replace(named, nodes + "\n"))
        systems.append(rf.import_system(path))
        # the same forces in more lines: those on one freedom add up
        for name, f in block.forces.items():
            at = [(freedom, 0.5 * v) for freedom, v in zip(block.freedoms, f.tolist(), strict=True)]
            lines = [f"{node},{k},{v!r}" for (node, k), v in [*at[::-1], *at] if v]
            (tmp_path / f"{name}.txt").write_text("*CLOAD\n" + "\n".join(lines))
    assert np.array_equal(systems[0].weight, weights)  # node 1 is the leftmost
    for name, value in vars(systems[0]).items():
        assert np.array_equal(value, getattr(systems[1], name)), name


def test_several_contacts_have_their_own_friction_and_names(tmp_path: Path) -> None:
    path = specification(tmp_path, Block())
    turned(path, "[7, 6, 5, 4, 3, 2, 1]", "[1, 4, 2]")
    second = "[[contact]]\nname = 'pad'\nnodes = [7, 6]\nnormal = [0, 1]\nfriction = 0.1\n"
    turned(path, "[[load]]", f"{second}initial_gap = '0.1 + 0.2*x'\n[[load]]")
    system = rf.import_system(path)
    assert system.edges.tolist() == [0, 0, 0, 1, 1] and system.edge_names == ("contact", "pad")
    assert system.points[:, 0].tolist() == [0.0, 1.0, 3.0, 5.0, 6.0]
    assert system.f.tolist() == [0.32] * 3 + [0.1] * 2
    assert system.g0 == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.2])
    assert system.x.tolist() == [-1.5, -0.5, 1.5, -0.5, 0.5]
    assert system.weight.tolist() == [0.5, 1.5, 1.0, 0.5, 0.5]


def turned(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_exported_matrices_can_be_imported_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = Block()
    first = rf.import_system(specification(tmp_path, block))
    laws: dict[str, Any] = {
        "f_backward": np.full(first.n, 0.1),
        "g0": np.linspace(0.5, 1.0, first.n),
        "held": np.arange(2 * first.n) == 1,  # v of the second node
    }
    rf.write_system(tmp_path / "system.h5", replace(first, **laws))
    out = tmp_path / "matrices"
    head = ["export", str(tmp_path / "system.h5"), "--matrices", "--out", str(out)]
    assert cli.main(head) == 0
    assert "7 contact nodes, 2 load(s), written to" in capsys.readouterr().out
    assert cli.main(head) == 2 and "already exists" in capsys.readouterr().err
    assert cli.main(["export", str(tmp_path), *head[2:], "--overwrite"]) == 0  # of a run's folder
    table = np.loadtxt(out / "nodes.csv", delimiter=",", skiprows=1)
    names = (out / "nodes.csv").read_text().splitlines()[0]
    assert names.lstrip("# ") == "x,px,py,weight,f_forward,f_backward,gap,held_v,held_w"
    columns = [first.x, first.points, first.weight, first.f, laws["f_backward"], laws["g0"]]
    assert np.array_equal(table, np.column_stack([*columns, *laws["held"].reshape(2, -1)]))
    rows = [f"{i},{x!r},{y!r}" for i, (x, y) in enumerate(table[:, 1:3].tolist(), 1)]
    (out / "points.csv").write_text("\n".join(rows))
    r_star = io.mmread(out / "r_star.mtx")
    assert "r_star of [v; w]; loads P, Q\n" in (out / "r_star.mtx").read_text()
    text = 'stiffness = "stiffness.mtx"\nnodes = "points.csv"\nfree = 3\norder = "components"\n'
    text += f"[[contact]]\nnodes = {list(range(1, first.n + 1))}\nnormal = [0, 1]\n"
    text += "friction = 0.32\n"
    for k, name in enumerate(first.load_names):
        io.mmwrite(out / f"{name}.mtx", r_star[k][:, None], precision=17)
        text += f'[[load]]\nname = "{name}"\nreactions = "{name}.mtx"\n'
    (out / "import.toml").write_text(text)
    again = rf.import_system(out / "import.toml")
    for name in ("x", "points", "weight", "K", "r_star", "f", "held"):
        assert np.array_equal(getattr(again, name), getattr(first, name)), name
    assert np.array_equal(io.mmread(out / "rigid.mtx"), first.rigid)
