"""Load histories: polylines in the space of load factors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class History:
    """A path from rest, then a closed polygon that is run through again and again.

    Attributes:
        load_names: n_loads names, one a column.
        path: (n + 1, n_loads) load factors of cycle 0, from zero load to the start of the cycles.
        loop: (m + 1, n_loads) closed polygon of every further cycle, first and last row equal to
            ``path[-1]``; (0, n_loads) when there are no cycles.
        cycles: how many times the loop is run through at most.
        until_steady: stop as soon as the steady state is reached.
    """

    load_names: tuple[str, ...]
    path: NDArray[np.float64]
    loop: NDArray[np.float64]
    cycles: int = 0
    until_steady: bool = False
