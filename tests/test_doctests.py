"""Run the examples in docstrings."""

import doctest
from importlib import import_module

import pytest

pytestmark = pytest.mark.one_rank

MODULES = (
    "bulk.join_bodies",
    "interface.law",
    "interface.system",
)
"""Modules whose docstrings hold examples."""


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_docstrings_hold(name: str) -> None:
    failed, tried = doctest.testmod(import_module(f"receding_fenicsx.{name}"))
    assert tried > 0 and failed == 0
