"""Result of a shakedown study, and its text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from receding_fenicsx.interface.shakedown.limits import ShakedownLimits
from receding_fenicsx.interface.shakedown.opening import Opening
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.studies.shakedown.diagram import Diagram

FOUND_BY = "by a mixed-integer program, verified by exact cycles"
"""How the range with opening nodes is known."""

LIMIT = 1.0 - 1e-6
"""Range over the largest that was looked at from which it is that one."""


@dataclass(frozen=True)
class ShakedownStudy:
    """Shakedown limits of a scene, with what tells how far they hold.

    Attributes:
        system: the condensed system.
        limits: its limits.
        meshes: number of modelled nodes, lower and upper limit of each mesh, the scene's first.
        diagram: limits over one mean load.
        by_cycles: interval of lambda in which cycles from rest or the safe slip begin to slip for
            ever, where a node unloads at the upper limit; else None.
        notes: sentences about the validity of the limits.
        opening: largest range of the opening contact that a program found and cycles verified.
    """

    system: ContactSystem
    limits: ShakedownLimits
    meshes: tuple[tuple[int, float, float], ...]
    diagram: Diagram
    by_cycles: tuple[float, float] | None
    notes: tuple[str, ...]
    opening: Opening | None = None

    def __str__(self) -> str:
        """Return the study as lines for the terminal."""
        limits = self.limits
        beyond = " of the closed contact" if limits.opens else ": above, it never stops"
        if np.isinf(limits.upper):
            beyond = ": the range never makes it slip from the safe slip"
        lines = [
            f"lower limit   {limits.lower:.6g}  ({limits.lower_is}): below, the contact stops "
            "slipping",
            f"upper limit   {limits.upper:.6g}{beyond}",
            f"residual      {limits.residual:.1e} of the largest force, dual gap {limits.gap:.1e}",
        ]
        if len(self.meshes) > 1:
            (own, *_), (nodes, lower, upper) = self.meshes
            lines.append(
                f"second mesh   {lower:.6g} and {upper:.6g} with {nodes} nodes instead of {own}"
            )
        lines += [f"{limit} binds   {limits.binding(limit)}" for limit in ("lower", "upper")]
        if self.by_cycles is not None:
            low, high = self.by_cycles
            lines.append(
                f"exact cycles  from rest or the safe slip end without slip up to {low:.4g}, "
                f"not at {high:.4g}"
            )
        if self.opening is not None:
            found = self.opening
            more = " (none larger was looked at)" if found.value > LIMIT * found.top else ""
            more += " (search cut short)" if found.cut else ""
            lines.append(
                f"with opening  {found.value:.6g}{more}: nodes open and close without slip, found "
                f"{FOUND_BY}"
            )
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])
