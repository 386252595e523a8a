import numpy as np
import pytest
from hard import (
    SOLVED,
    Case,
    Tally,
    Wrong,
    judge,
    modelled,
)
from hard_block import CASES as BLOCK_CASES
from hard_block import body
from hard_bodies import CASES as BODY_CASES
from hard_trials import CASES as TRIAL_CASES
from law import worst_violation
from small import cyclic

from receding_fenicsx.errors import NoEquilibrium
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.exact import walk
from receding_fenicsx.scene.model import OutputOptions

pytestmark = pytest.mark.one_rank

ALL_CASES = (*BLOCK_CASES, *BODY_CASES, *TRIAL_CASES)


@pytest.mark.parametrize("case", [pytest.param(c, id=c.name) for c in ALL_CASES if c.fast])
def test_hard_case_ends_as_expected(case: Case) -> None:
    found = judge(case)
    assert found.as_expected, f"{found.outcome}, expected {case.expected}: {found.said}"


# -- the judge itself -----------------------------------------------------------------------------


def played() -> Record:
    return evolve(body(), cyclic(1), output=OutputOptions(samples_per_leg=8, cycles="all"))


def test_an_answer_with_a_force_that_is_off_is_found() -> None:
    record = played()
    middle = len(record.x) // 2
    record.samples.P[5, middle + 3] *= 1.0 + 1e-6
    assert worst_violation(body(), modelled(body(), record)) > 1e-8


def test_a_way_on_that_is_denied_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    system = body("mesh.contact_elements=12")
    events = Tally().solve(system, cyclic(1)).events
    denied = events.load[np.flatnonzero((events.cycle == 1) & (events.s > 0.0))[4], 0]
    run = walk.Walk.run

    def deny(self: walk.Walk, s_end: float) -> None:
        (a,), (b,) = self.problem.ends
        s = (denied - a) / (b - a)
        if not 0.0 < s < s_end:
            run(self, s_end)
            return
        run(self, s)
        states = self._states_at(self.path.state)
        raise states.error(self.path.state, np.zeros(0, dtype=np.intp))

    monkeypatch.setattr(walk.Walk, "run", deny)
    with pytest.raises(Wrong, match="a way on exists"):
        Tally().solve(system, cyclic(1))


def test_a_refusal_that_nobody_expected_is_not_as_expected() -> None:
    def refuse(_: Tally) -> str:
        raise NoEquilibrium("gross sliding at p0 = 1")

    assert not judge(Case("a", SOLVED, refuse)).as_expected
    assert judge(Case("a", "gross sliding", refuse)).as_expected
    assert not judge(Case("a", "lift-off", refuse)).as_expected
