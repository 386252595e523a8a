r"""First loading of a joint: load over displacement, macroslip, dissipation by Masing's rule.

Between the events of the exact path the displacement q is linear in the load F. A second path with
a corner at every event therefore gives the work of the first loading exactly,

$$W(\alpha) = \int_0^{q(\alpha)} F \, dq .$$

By Masing's rule each branch of the loop is the first loading at twice its size, so that the loop
between $\pm\alpha$ dissipates

$$D_M(\alpha) = 8 W(\alpha) - 4 \alpha\, q(\alpha) .$$

It holds where contact and pressure stay as they are, as for uncoupled contacts that do not recede.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import NoEquilibrium, NoQuasiStaticContinuation, SolveError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, SolverOptions


@dataclass(frozen=True)
class Backbone:
    """First loading of a joint."""

    load: Array  # (n,) load factors of the drive, from 0
    # (n,) from 0; of a prescribed displacement the force along it times that at factor 1
    displacement: Array
    work: Array  # (n,) work of the drive
    # largest load factor with an equilibrium, to a relative 1e-6; infinite where all have one
    macroslip: float
    reason: str  # why there is none beyond it

    def masing(self, amplitude: Sequence[float] | Array) -> Array:
        """Return the dissipation per cycle by Masing's rule; NaN beyond macroslip."""
        found = np.full(len(amplitude), np.nan)
        for k, a in enumerate(amplitude):
            at = np.flatnonzero(self.load == a)
            if len(at):
                box = 4.0 * a * self.displacement[int(at[0])]
                D = 8.0 * self.work[int(at[0])] - box
                found[k] = D if D > 1e-10 * abs(box) else 0.0  # round-off
        return found


def first_loading(
    system: ContactSystem,
    drive: str,
    preload: Array,
    amplitudes: Sequence[float] | Array,
    solver: SolverOptions | None = None,
) -> Backbone:
    """Follow the first loading of a drive through all amplitudes, which are positive.

    ``preload`` are (k, n_loads) load factors from rest to the preload, those of the drive zero.
    SolveError: the preload has no equilibrium, or a solver fails.
    """
    names = system.load_names
    held = preload[-1]
    unit = np.array([float(name == drive) for name in names])
    reason = ""

    def played(load: Array) -> Record:
        path = np.vstack([preload, held + load[:, None] * unit])
        moves = np.append(True, np.any(np.diff(path, axis=0) != 0.0, axis=1))
        history = History(names, path[moves], np.zeros((0, len(names))))
        return evolve(system, history, solver, OutputOptions(1, "all"))

    if np.any(held):
        played(np.zeros(0))  # a preload that fails is no macroslip
    low, high = 0.0, float(max(amplitudes))
    record: Record | None = None
    tried = high
    while high - low > 1e-6 * high:
        try:
            record, low = played(np.array([tried])), tried
        # any other failure is one of the solver
        except (NoEquilibrium, NoQuasiStaticContinuation) as failed:
            high, reason = tried, str(failed)
        tried = 0.5 * (low + high)
    if record is None or low == 0.0:
        raise SolveError(f"load '{drive}': moves the contact at any load factor: {reason}")
    at_events = record.events.load[:, names.index(drive)]
    given = np.array([a for a in amplitudes if a <= low])
    corners = np.unique(np.concatenate([[low], given, at_events[at_events > 0.0]]))
    table = played(corners).turning_points
    k, n = names.index(drive), len(corners)
    q = table.load_displacement[-n:, k]
    rest = table.load_displacement[-n - 1, k] if np.any(held) else 0.0
    load, displacement = np.append(0.0, corners), np.append(0.0, q - rest)
    if record.load_sign[k] > 0.0:
        # a prescribed displacement: its conjugate is the force
        steps = np.diff(load) * (displacement[1:] + displacement[:-1])
    else:
        steps = np.diff(displacement) * (load[1:] + load[:-1])
    work = np.append(0.0, 0.5 * np.cumsum(steps))
    return Backbone(load, displacement, work, low if reason else np.inf, reason)
