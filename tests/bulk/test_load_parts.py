"""One load on several edges: several tables of one name act together under one load factor."""

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
