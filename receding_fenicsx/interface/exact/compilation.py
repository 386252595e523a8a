"""Compilation of the loop: told where it takes place, and done beforehand by the set-up.

Machine code is kept beside the sources, in the folder ``NUMBA_CACHE_DIR`` or in the user's cache.
"""

from __future__ import annotations

import logging
from functools import cache

import numpy as np
from numba.core import event

from receding_fenicsx.interface.exact import kernel
from receding_fenicsx.interface.exact.legs import LegProblem
from receding_fenicsx.interface.exact.loop import Loop
from receding_fenicsx.interface.exact.segments import Segments
from receding_fenicsx.interface.exact.walk import Walk
from receding_fenicsx.interface.law import STICK
from receding_fenicsx.interface.system import ContactState, ContactSystem, reactions

log = logging.getLogger(__name__)

NOT_KEPT = "name a folder that can be written in NUMBA_CACHE_DIR to keep it"


class _Told(event.Listener):
    """Says that the loop is compiled; nothing where its machine code is found."""

    def on_start(self, event: event.Event) -> None:
        """Called before any function is compiled."""
        if event.data["dispatcher"] is kernel.follow:
            kept = "once" if kernel.follow.stats.cache_path else NOT_KEPT
            log.warning("compiling the event loop of the exact path, about 10 s; %s", kept)

    def on_end(self, event: event.Event) -> None:
        """Called afterwards."""


@cache
def _tell() -> None:
    event.register("numba:compile", _Told())


def loop_of(segments: Segments) -> Loop:
    """Return the compiled loop of a contact; log a line where it has to be compiled."""
    _tell()
    return Loop(segments)


def warm_up() -> None:
    """Compile the loop, or load it from where its machine code is kept."""
    # a node on springs sticks, pressed on the plane, and is sheared
    system = ContactSystem(
        x=np.zeros(1),
        points=np.zeros((1, 2)),
        weight=np.ones(1),
        K=np.array([[2.0, 0.5], [0.5, 2.0]]),
        r_star=np.array([[0.0, 1.0], [1.0, 0.0]]),
        load_names=("press", "shear"),
        f=np.full(1, 0.5),
        g0=np.zeros(1),
        held=np.zeros(2, dtype=bool),
        rigid=np.zeros((2, 0)),
    )
    pressed = np.array([1.0, 0.0])
    state = np.full(1, STICK, dtype=np.int8)
    start = ContactState(np.zeros(2), reactions(system, pressed, np.zeros(2)), state)
    Walk(Loop(Segments(system)), LegProblem(start, (pressed, np.ones(2)), 1.0)).run(1.0)
