"""Timer of the stages of a run, and progress within a stage."""

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


Tell = Callable[[str, int], None]
"""Called with the name of each picture before it is drawn, and the number of those before it."""


class Countdown:
    """Progress of a known number of pictures: those done, and the time left."""

    def __init__(self, say: Say | None, what: str, total: int) -> None:
        """Start to count; ``say`` is called with the progress."""
        self.say, self.what, self.total = say, what, total
        self.begin = time.monotonic()

    def __call__(self, name: str, done: int) -> None:
        """Tell the next picture and the number of those before it."""
        log.info("%s: %d of %d, %s", self.what, done + 1, self.total, name)
        if self.say is None:
            return
        text = f"{self.what}: {done + 1} of {self.total}, {name}"
        if done:
            spent = time.monotonic() - self.begin
            text += f", about {duration(spent / done * (self.total - done))} left"
        self.say(text)


def duration(seconds: float) -> str:
    """Return a duration in seconds, minutes or hours, depending on its length."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
