import pytest
from hard import CASES, Case, judge

pytestmark = pytest.mark.one_rank


@pytest.mark.parametrize("case", [pytest.param(c, id=c.name) for c in CASES if c.fast])
def test_hard_case_ends_as_expected(case: Case) -> None:
    outcome, said, as_expected = judge(case)
    assert as_expected, f"{outcome}, expected {case.expected}: {said}"
