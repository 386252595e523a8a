"""One load on several edges: several tables of one name act together under one load factor."""

from collections.abc import Callable
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank  # small bodies are condensed by one rank

PRESS = rf.Load("P", "top", pressure="1 + 0.2*x")
PARTS = {
    "pressure and tractions on three edges": (
        rf.Load("L", "left", (-0.25, 0.25), traction=(1.0, 0.5)),
        rf.Load("L", "top", traction=(0.3, "0.1*x")),
        rf.Load("L", "right", (0.0, 0.5), pressure=0.5),
    ),
    "two platens": (
        rf.Load("L", "left", (0.0, 0.5), platen=True, force=(0.2, 0.1)),
        rf.Load("L", "right", (0.0, 0.5), platen=True, force=(0.3, -0.2)),
    ),
    "a platen and a traction": (
        rf.Load("L", "left", (0.0, 0.5), platen=True, force=(0.2, 0.1)),
        rf.Load("L", "top", (0.0, 1.0), traction=(0.1, -0.2)),
    ),
    "two moved edges": (
        rf.Load("L", "left", (0.0, 0.5), displacement=(0.1, "free")),
        rf.Load("L", "right", (0.0, 0.5), displacement=("0.1", -0.02)),
    ),
}


def system_of(scene: rf.Scene) -> rf.ContactSystem:
    return rf.given(rf.condense(scene, MPI.COMM_SELF))


def driven(names: tuple[str, ...]) -> rf.HistoryOptions:
    return rf.HistoryOptions(kind="table", columns=names, rows=((1.0,) * len(names),))


@pytest.mark.parametrize("case", PARTS)
def test_load_of_several_parts_is_their_sum(case: str) -> None:
    """Reactions and compliance against loads of their own names."""
    parts, even = PARTS[case], rf.SolverOptions(symmetry="none")
    own = tuple(replace(part, name=f"L{k}") for k, part in enumerate(parts))
    one, many = (
        system_of(block(loads=(PRESS, *loads), history=driven(("P", *names)), solver=even))
        for loads, names in ((parts, ("L",)), (own, [part.name for part in own]))
    )
    assert one.load_names == ("P", "L")
    total = np.vstack([many.r_star[:1], many.r_star[1:].sum(axis=0)])
    size = np.abs(total).max()
    np.testing.assert_allclose(one.r_star, total, atol=1e-11 * size)
    sums = np.zeros((2, 1 + len(parts)))
    sums[0, 0], sums[1, 1:] = 1.0, 1.0
    compliance = sums @ many.load_compliance @ sums.T
    np.testing.assert_allclose(
        one.load_compliance, compliance, atol=1e-11 * np.abs(compliance).max()
    )


@pytest.mark.parametrize(
    "load",
    [
        lambda s: rf.Load("L", "top", displacement=("0.1*x", f"-0.1*(1 + {s})")),
        lambda s: rf.Load("L", "top", traction=(f"1 + {s}", 0.5)),
        lambda s: rf.Load("L", "bottom", gap=f"0.1*(1 + {s})"),
    ],
    ids=["displacement", "traction", "gap"],
)
def test_halves_of_an_edge_are_the_whole_edge(load: Callable[[str], rf.Load]) -> None:
    """The moved node in the middle belongs to both halves."""
    parts = (("0*x", (-2.0, 0.0)), ("x", (0.0, 2.0)))
    whole, halves = load("max(x, 0)"), tuple(replace(load(s), span=span) for s, span in parts)
    even, alone = rf.SolverOptions(symmetry="none"), rf.HistoryOptions(kind="monotonic")
    one, two = (
        system_of(block("quadrilateral", growth=1.0, loads=loads, solver=even, history=alone))
        for loads in ((whole,), halves)
    )
    scale = np.abs(one.r_star).max()
    np.testing.assert_allclose(two.r_star, one.r_star, atol=1e-10 * scale)
    np.testing.assert_allclose(two.load_compliance, one.load_compliance, rtol=1e-9)
    np.testing.assert_allclose(two.K, one.K, atol=1e-10 * np.abs(one.K).max())
