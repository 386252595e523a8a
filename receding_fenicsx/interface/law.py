"""The contact law of a node: unilateral contact and Coulomb friction (eqs. 4 to 10).

Friction may differ for the two directions of slip. With the coefficients f_forward and f_backward
the tangential reaction Q and the normal reaction P on the body satisfy

    A = Q + f_forward P >= 0,    B = f_backward P - Q >= 0,

where A = 0 in forward slip (v grows) and B = 0 in backward slip (v falls). All solvers, residuals
and replays take states, signs, margins and limits from this module.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class State(IntEnum):
    """The four states of a contact node, numbered as in section 2 of the paper."""

    STICK = 1
    SEPARATION = 2
    FORWARD_SLIP = 3
    BACKWARD_SLIP = 4


STATE_NAMES = {s: s.name.lower().replace("_", " ") for s in State}
