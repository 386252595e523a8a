"""Figures of a record drawn in a separate process, beside the computation or other pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import RecedingError
from receding_fenicsx.output.plots.child_process import ChildProcess, Work
from receding_fenicsx.timing import Tell

Request = tuple[Path, Path, tuple[str, ...], bool]
"""File of the record, folder of the figures, formats, whether all figures are drawn."""


class FigureProcess:
    """A process that draws the figures of one record."""

    def __init__(self) -> None:
        """Start the process; it loads its libraries while others compute."""
        self.child = ChildProcess(f"{__name__}:prepare")

    def begin(self, request: Request) -> None:
        """Begin to draw."""
        try:
            self.child.ask(request)
        except OSError:
            raise self._failed() from None

    def finish(self, tell: Tell | None) -> list[Path]:
        """Wait for the figures; return their files.

        Args:
            tell: called with the name of each figure and the number of those before it.

        Raises:
            RecedingError: the process failed, for the reason told.
        """
        while True:
            try:
                answer = self.child.answer()
            except EOFError:
                raise self._failed() from None
            if isinstance(answer, Exception):
                raise answer
            if isinstance(answer, list):
                return answer
            if tell is not None:
                tell(*answer)

    def close(self) -> None:
        """End the process at once."""
        self.child.close(0.0)

    def _failed(self) -> RecedingError:
        return RecedingError(f"figures: drawing failed ({self.child.kill()})")


def prepare() -> Work:
    """Return the function that draws the figures of a record in this process."""
    from receding_fenicsx.output.plots import figures
    from receding_fenicsx.output.storage import hdf5

    def draw(request: Request, send: Callable[[Any], None]) -> None:
        file, folder, formats, everything = request
        record = hdf5.read_record(file)
        made = figures.plot_all(record, folder, formats, lambda *told: send(told), everything)
        send(made)

    return draw
