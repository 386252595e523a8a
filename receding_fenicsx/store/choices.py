"""Choices of a record, the instants with several continuations, as text and back."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from receding_fenicsx.interface.branches.choice import Choice


def text_of(choices: Iterable[Choice]) -> str:
    """Return choices as JSON."""
    return json.dumps([asdict(choice) for choice in choices])


def choices_of(text: str) -> tuple[Choice, ...]:
    """Return choices from JSON; lists become tuples."""

    def fixed(value: Any) -> Any:
        return tuple(map(fixed, value)) if isinstance(value, list) else value

    return tuple(Choice(**{k: fixed(v) for k, v in one.items()}) for one in json.loads(text))
