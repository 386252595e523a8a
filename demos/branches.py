"""One answer or several: all branches of a history, and the friction at which they may begin.

**Problem.** (1) One contact node whose normal and tangential stiffness are strongly coupled, under
a load that grows from rest. (2) Two such nodes, loaded, unloaded and loaded again. (3) The paper's
block under its first load.

**Equations.** The rates of a contact with friction are a linear complementarity problem, which may
have several solutions. Node (1) with Q = 1.3 p + v + 0.9 w, P = p + 0.9 v + w and f = 1.5:

    stick       v = w = 0:         Q = 1.3 p <= f P = 1.5 p,
    backward    w = 0, Q = f P:    v = -0.2 p / 0.35 < 0,  P = 0.486 p > 0,
    separation  Q = P = 0:         w = 0.17 p / 0.19 > 0.

A slip mode of a closed contact, a motion without any change of the loads, exists where
(K_tt + phi S F K_nt) v = 0 for some directions of slip S = diag(+-1).

**What to look for.** (1) Three branches. (2) The branch on which both nodes stay closed ends at the
first reversal; those on which the first node opens go all the way. (3) The friction below which no
slip mode exists, and a mode not far above, the same on both meshes.
"""

import argparse
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

BLOCK = Path(__file__).with_name("block.toml")


def hand_made(K: np.ndarray, loads: dict[str, list[float]], friction: float) -> rf.ContactSystem:
    """Return a contact system from its stiffness and the reactions of its loads."""
    n = len(K) // 2
    return rf.ContactSystem(
        x=np.arange(n, dtype=float),
        points=np.stack([np.arange(n), np.zeros(n)], axis=1).astype(float),
        weight=np.ones(n),
        K=K,
        r_star=np.array(list(loads.values())),
        load_names=tuple(loads),
        f=np.full(n, friction),
        g0=np.zeros(n),
        held=np.zeros(2 * n, dtype=bool),
        rigid=np.zeros((2 * n, 0)),
    )


def one_node() -> rf.BranchTree:
    """Return the branches of the node with three answers."""
    system = hand_made(np.array([[1.0, 0.9], [0.9, 1.0]]), {"p": [1.3, 1.0]}, 1.5)
    rest_to_one = rf.History(("p",), np.array([[0.0], [1.0]]), np.zeros((0, 1)), 0)
    return rf.branches(system, rest_to_one)


def two_nodes() -> rf.BranchTree:
    """Return the branches of two nodes: press with a, exchange a for b, unload, press again."""
    K = np.kron([[2.0, 1.5], [1.5, 2.0]], np.eye(2))
    system = hand_made(K, {"a": [1.0, 2.0, 0.5, 2.0], "b": [0.5, 0.0, 0.0, 0.0]}, 2.0)
    path = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    return rf.branches(system, rf.History(("a", "b"), path, np.zeros((0, 2)), 0))


def block(elements: int, picture: Path) -> tuple[rf.ContactSystem, rf.CriticalFriction] | None:
    """Return the block's system and its critical friction at the first load, on rank 0."""
    changes = [f"mesh.contact_elements={elements}", "history.cycles=1"]
    scene = rf.read_scene(BLOCK, changes)
    system = rf.condense(scene)
    critical = None
    if system is not None:
        first = rf.evolve(system, scene).at(cycle=0)
        critical = rf.critical_friction(system, first.state)
    rf.draw_slip_mode(scene, critical, picture)  # on all ranks
    return None if system is None or critical is None else (system, critical)


def main() -> None:
    """Follow the branches, bound the critical friction, draw all."""
    parser = argparse.ArgumentParser(description="Branches and critical friction.")
    parser.add_argument("--out", type=Path, default=Path("results/branches"))
    parser.add_argument("--elements", type=int, nargs=2, default=(40, 80))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    picture = options.out / "branches_slip_mode_body.png"
    found = [block(elements, picture) for elements in options.elements]
    meshes = [mesh for mesh in found if mesh is not None]
    if not meshes:  # not rank 0
        return

    node, pair = one_node(), two_nodes()
    print(f"one node: {node}\ntwo nodes: {pair}")
    assert len(node) == 3 and node.complete, "the node has three branches"
    assert len(pair) == 3 and pair.complete, "two answers to each of the loadings by a"
    assert "leg 1" in pair[0].failure and "(s = 0 of the leg)" in pair[0].failure
    assert not pair[1].failure and not pair[2].failure
    for name, tree in (("one_node", node), ("two_nodes", pair)):
        rf.figures.branches(tree).savefig(options.out / f"branches_{name}.png")

    bounds = []
    for elements, (system, critical) in zip(options.elements, meshes, strict=True):
        f = float(system.f.max())
        bounds.append((f * critical.lower_bound, f * critical.factor))
        print(
            f"block, {elements} elements: no slip mode below f = {bounds[-1][0]:.3f}, a slip mode "
            f"at f = {bounds[-1][1]:.3f}; rates unique below f = {f * critical.unique_below:.3f}"
        )
    rf.figures.slip_mode(*meshes[-1]).savefig(options.out / "branches_slip_mode.png")
    assert all(1.6 < low < high < 1.8 for low, high in bounds), "bounds of the critical friction"
    assert np.abs(np.diff(bounds, axis=0)).max() < 0.01, "the bounds depend on the mesh"


if __name__ == "__main__":
    main()
