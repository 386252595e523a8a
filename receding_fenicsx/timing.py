"""Timer of the stages of a run, and progress within a stage."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Called on rank 0 with the name of each stage, and with each :class:`Step` within it."""


class Timer:
    """Seconds spent in each stage."""

    def __init__(self, say: Say | None = None) -> None:
        """Start at zero; ``say`` is called with the name of each stage when it starts."""
        self.seconds = dict.fromkeys(("mesh", "assemble", "condense", "evolve", "pictures"), 0.0)
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


class Step(str):
    """Text of the progress within a stage; a terminal draws ``done`` of ``total`` as a bar."""

    done, total = 0, 0


class Countdown:
    """Progress of a known number of steps: those done, and the time left at the recent pace."""

    def __init__(self, say: Say | None, what: str, about: str = "about") -> None:
        """Start to count ``what``, the beginning of the text; ``about`` is before the time left."""
        self.say, self.what, self.about = say, what, about
        self.ends = deque([time.monotonic()], maxlen=21)

    def __call__(self, done: int, total: int, text: str) -> None:
        """Log and tell the number of steps done, and a text about the last or the next one."""
        if done > 0:
            self.ends.append(time.monotonic())
        told = f"{self.what} {done} of {total}, "
        log.info("%s%s", told, text)
        if self.say is None:
            return
        told += text.partition(",")[0]  # a terminal has one line
        if len(self.ends) > 1:
            a_step = (self.ends[-1] - self.ends[0]) / (len(self.ends) - 1)
            told += f", {self.about} {duration(a_step * (total - done))} left"
        step = Step(told)
        step.done, step.total = done, total
        self.say(step)


def duration(seconds: float) -> str:
    """Return a duration in seconds, minutes or hours, depending on its length."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
