from dataclasses import replace

import numpy as np
import pytest
from hard import CASES, SOLVED, Case, block, confirmed, judge, modelled
from law import worst_slip, worst_violation
from small import cyclic

import receding_fenicsx as rf

pytestmark = pytest.mark.one_rank


@pytest.mark.parametrize("case", [pytest.param(c, id=c.name) for c in CASES if c.fast])
def test_hard_case_ends_as_expected(case: Case) -> None:
    found = judge(case)
    assert found.as_expected, f"{found.outcome}, expected {case.expected}: {found.said}"


def test_the_judge_finds_forces_and_slips_that_are_off() -> None:
    system = block()
    record = rf.evolve(system, cyclic(1), output=rf.OutputOptions(8, "all"))
    assert worst_slip(system, modelled(system, record)) < 1e-12
    state = record.samples.state
    turned = replace(record.samples, state=np.where(state > 2, 7 - state, state))
    assert worst_slip(system, modelled(system, replace(record, samples=turned))) > 1e-4
    record.samples.P[5, len(record.x) // 2 + 3] *= 1.0 + 1e-6
    assert worst_violation(system, modelled(system, record)) > 1e-8


def test_a_way_on_that_is_denied_is_found() -> None:
    system = block("mesh.contact_elements=12")
    events = rf.evolve(system, cyclic(1)).events
    s = events.s[np.flatnonzero((events.cycle == 1) & (events.s > 0.0))[4]]
    leg = events.leg[np.flatnonzero((events.cycle == 1) & (events.s > 0.0))[4]]
    denied = rf.NoQuasiStaticContinuation(f"cycle 1, leg {leg}: ends (s = {s:.9g} of the leg)")
    assert not confirmed(system, cyclic(1), denied)


def test_a_refusal_that_nobody_expected_is_not_as_expected() -> None:
    def refused() -> tuple[rf.ContactSystem, rf.History]:
        return block(), cyclic(1, -0.5)

    assert not judge(Case("a", SOLVED, refused)).as_expected
    assert not judge(Case("a", "gross sliding", refused)).as_expected
    assert judge(Case("a", "lift-off or pull the body off", refused)).as_expected
