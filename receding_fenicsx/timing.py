"""Timer of the stages of a run."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Called with the name of each stage, and with the progress; on rank 0."""

STAGES = ("mesh", "assemble", "condense", "evolve", "pictures")


class Timer:
    """Seconds spent in each stage."""

    def __init__(self, say: Say | None = None) -> None:
        """Start at zero; ``say`` is called with the name of each stage when it starts."""
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.say = say

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to a stage."""
        if self.say is not None:
            self.say(stage)
        begin = time.perf_counter()
        try:
            yield
        finally:
            spent = self.seconds.get(stage, 0.0)
            self.seconds[stage] = spent + time.perf_counter() - begin
            log.info("%s: %.3f s", stage, self.seconds[stage])
