"""Checks of which loads a history drives."""

from __future__ import annotations

from collections.abc import Iterable

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.model import HistoryOptions


def check_known(driven: Iterable[str], names: tuple[str, ...], key: str) -> None:
    """Raise InputError for a name under a key of [history] that no load has."""
    for name in driven:
        if name not in names:
            raise InputError(
                f"[history] {key}: no load is named '{name}'; {suggestion(name, names)}"
            )


def check_driven(
    driven: tuple[str, ...], names: tuple[str, ...], options: HistoryOptions, key: str
) -> None:
    """Check that a history drives all loads that are not constant, and these only.

    Args:
        driven: names of the loads that it drives.
        names: names of the loads that are not constant.
        options: the options of the history.
        key: key of [history] that names the driven loads.
    """
    for name in driven:
        if name in options.constant:
            raise InputError(
                f"[history] constant: load '{name}' varies, by [history] {key}; name it in one of "
                "them"
            )
    check_known(driven, names, key)
    for name in names:
        if name not in driven:
            raise InputError(
                f"load '{name}': is not driven by the history; remove it, name it in [history] "
                'constant, or use kind = "table" with a column for it'
            )
