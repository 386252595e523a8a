"""Whether a path ends where the program says so: all states of the nodes on limits are tried.

Nothing of the package's solvers decides; ``ways.py`` does.
"""

import re

import numpy as np
from equations import Body
from replay import HELD_SHARE
from small import table
from ways import choices, rates

from receding_fenicsx.errors import SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History

NEAR = 1e-4
"""Distance from a limit, over the largest force, that counts as being on it."""


SETS = 4**8
"""Sets of states that are gone through."""


def confirmed(system: ContactSystem, history: History, error: SolveError) -> bool:
    """Return whether no rates of any kind satisfy the law where the error says that none do.

    The exact path is followed to just before that place, all states are tried there.
    """
    text = str(error)
    found = re.search(r"cycle (\d+), leg (\d+): .* \(s = (\S+) of the leg\)", text)
    assert found is not None, text
    cycle, leg, s = int(found[1]), int(found[2]), float(found[3])
    polyline = history.path if cycle == 0 else history.loop
    before = [*history.path[:-1]] + [*history.loop[:-1]] * (cycle - 1) if cycle else []
    corners = [*before, *polyline[: leg + 1]]
    a, b = polyline[leg], polyline[leg + 1]
    if s > 1e-8:
        corners.append((1.0 - s + 1e-8) * a + (s - 1e-8) * b)
    short = table(system, corners)
    end = evolve(system, short).turning_points
    # the record is of the whole contact, the axis node carrying both halves
    state, Q, P, v, w = (
        getattr(end, name)[-1, -system.n :].copy() for name in ("state", "Q", "P", "v", "w")
    )
    P[0] *= 0.5 if system.half else 1.0
    r, u = np.concatenate([Q, P]), np.concatenate([v, w])
    force = max(np.abs(r).max(), HELD_SHARE * np.abs(system.r_star).max())
    body, near = Body(system), np.full(2 * system.n, NEAR * force)
    return not rates(body, b - a, choices(body, r, u, state, near), SETS)
