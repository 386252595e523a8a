"""Shakedown limits of a load range, and the residual slip that is safe up to the upper one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, described
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.interface.mirror import mirror_of
from receding_fenicsx.interface.shakedown.margins import (
    BACKWARD,
    BINDS,
    FORWARD,
    REFUSE,
    VANISHES,
    Answer,
    Loads,
    Margins,
    dual_bound,
    largest_margin,
    load_range,
    margin_residual,
    minimise,
    prepared,
    with_bound,
)
from receding_fenicsx.interface.system import ContactSystem

PROVED, CONJECTURE = "proved", "conjecture"


@dataclass(frozen=True)
class Active:
    """A margin that vanishes at a limit."""

    limit: str  # "lower" or "upper"
    node: int  # contact node of the model
    x: float  # its position
    kind: str  # "forward slip", "backward slip", "unloads" or "touches"
    vertex: int  # vertex of the range at which the margin vanishes, from 0


@dataclass(frozen=True, repr=False)
class ShakedownLimits:
    """Limits of the load range mean + lambda vertex_k of a contact.

    Attributes:
        lower: lambda_1; below it the contact stops slipping whatever its past. Of a half model:
            whatever its mirror-symmetric past.
        upper: lambda_2; above it no residual slip keeps all margins, so that the contact slips for
            ever (or opens, see ``opens``).
        safe_slip: (M,) residual slip of the whole contact with which nothing slips up to lambda_2.
        safe_slip_modelled: (N,) the same at the modelled nodes, as ``evolve`` takes it.
        lower_is: "proved" (uncoupled, or at most two nodes with friction) or "conjecture".
        active: margins that vanish at the limits.
        opens: at the upper limit a node unloads: beyond, it may open instead of slipping.
        separated: (N,) nodes that were taken as separated throughout.
        residual: largest violation of a margin by the safe slip at lambda_2, and of
            equilibrium, over the largest nodal force; evaluated afresh from K.
        gap: largest difference between a limit and its dual bound, relative.
    """

    lower: float
    upper: float
    safe_slip: Array
    safe_slip_modelled: Array
    lower_is: str
    active: tuple[Active, ...]
    opens: bool
    separated: NDArray[np.bool_]
    residual: float
    gap: float

    def binding(self, limit: str) -> str:
        """Return in words which margins hold the "lower" or the "upper" limit."""
        held = [active for active in self.active if active.limit == limit]
        if not held:
            return "nothing"
        x, kinds = [active.x for active in held], Counter(active.kind for active in held)
        text = ", ".join(f"{kind} ({count})" for kind, count in kinds.items())
        return f"{text} from x = {min(x):.6g} to {max(x):.6g}"

    def __repr__(self) -> str:
        """Return the limits and what binds."""
        rows = [
            ("lower", f"{self.lower:.10g} ({self.lower_is}); {self.binding('lower')}"),
            ("upper", f"{self.upper:.10g}; {self.binding('upper')}"),
            ("opens", f"{self.opens}"),
            ("residual", f"{self.residual:.1e}; gap to the dual bound {self.gap:.1e}"),
        ]
        return described("ShakedownLimits", rows)


Certificates = dict[int, Array]
"""Multipliers of the targets' programs; they stay valid when the mean loads change."""


def shakedown_limits(
    system: ContactSystem,
    mean: Loads,
    range: Sequence[Loads],
    separated: str = REFUSE,
    largest_slip: float | None = None,
) -> ShakedownLimits:
    """Return the shakedown limits of the loads mean + lambda range[k].

    Args:
        system: the condensed body.
        mean: load factors of the mean loads, by name.
        range: changes of the load factors at the corners of the range at lambda = 1.
        separated: "refuse" nodes that are separated under the mean loads, or let them "stay"
            separated throughout.
        largest_slip: bound of the residual slips that the lower limit is for, as far as they stay
            below it; a limit of 0 may be due to slips that no history leaves behind.

    Raises:
        InputError: a load is not the system's, the range is empty, the scene has no friction, no
            slip can hold the mean loads, or nodes are separated under them.
        SolveError: a program does not pass its checks.

    One node of K_tt = 2, f = 1/2, pressed by 1 and pulled to and fro: it slips from lambda = 1/2:

        >>> one = ContactSystem(
        ...     x=np.zeros(1), points=np.zeros((1, 2)), weight=np.ones(1), K=np.diag([2.0, 4.0]),
        ...     r_star=np.array([[0.0, 1.0], [1.0, 0.0]]), load_names=("press", "shear"),
        ...     f=np.array([0.5]), g0=np.zeros(1), held=np.zeros(2, bool), rigid=np.zeros((2, 0)),
        ... )
        >>> limits = shakedown_limits(one, {"press": 1.0}, [{"shear": 1.0}, {"shear": -1.0}])
        >>> limits.lower, limits.upper, limits.lower_is
        (0.5, 0.5, 'proved')
    """
    loads = load_range(system, mean, range)
    margins, away = prepared(system, loads, separated)
    upper = upper_limit(margins)
    lower, _ = lower_limit(with_bound(margins, largest_slip), upper)
    bounded = np.isfinite(upper.value)
    mu = -upper.value
    y = upper.z[:-1] if bounded else largest_margin(margins).z[:-1]
    if lower is not None and lower.value > mu:
        lower = None
    # the smallest slip with the same margins: nothing resists a free motion along the plane
    y = np.linalg.lstsq(margins.G, margins.G @ y, rcond=1e-10)[0]
    v = np.zeros(system.n)
    v[margins.nodes] = margins.slip_scale * y
    top = mu * margins.range_scale
    residual = margin_residual(system, loads, v, top if bounded else 0.0, away)
    if residual > BINDS:
        raise SolveError(f"the safe slip violates margins by {residual:.1e} of the largest force")
    answers = {"lower": lower, "upper": upper if bounded else None}
    found = {limit: answer for limit, answer in answers.items() if answer is not None}
    active = []
    for limit, answer in found.items():
        # rows with a multiplier but bounds of slips, and the equations
        size = np.abs(answer.multipliers[: len(margins.c)])
        holding = np.flatnonzero(size > BINDS * np.abs(answer.multipliers).max(initial=0.0))
        for row in np.union1d(holding, np.array(answer.equations, dtype=int)):
            node, vertex = int(margins.node[row]), int(np.argmin(margins.D[row]))
            active.append(Active(limit, node, float(system.x[node]), margins.kind[row], vertex))
    # a node loses its pressure, or another one touches
    at_upper = {(a.node, a.vertex, a.kind) for a in active if a.limit == "upper"}
    opens = any(
        kind not in (FORWARD, BACKWARD) or (kind == FORWARD and (n, k, BACKWARD) in at_upper)
        for n, k, kind in at_upper
    )
    proved = not margins.coupled or (
        len(margins.nodes) <= 2 and 2 * len(margins.nodes) == len(margins.c)
    )
    return ShakedownLimits(
        top if lower is None else lower.value * margins.range_scale,
        top,
        mirror_of(system).odd(v),
        v,
        PROVED if proved else CONJECTURE,
        tuple(active),
        opens,
        away,
        residual,
        max((abs(a.value - a.bound) / (1.0 + abs(a.value)) for a in found.values()), default=0.0),
    )


def upper_limit(margins: Margins) -> Answer:
    """Return lambda_2: the largest mu with G y + c + mu d >= 0 for some y; its value is -mu."""
    cost = np.append(np.zeros(margins.G.shape[1]), -1.0)
    # a bound of the slips is for the lower limit only
    rows = len(margins.kind)
    return minimise(cost, np.hstack([margins.G, margins.d[:, None]])[:rows], margins.c[:rows])


def lower_limit(
    margins: Margins,
    upper: Answer,
    certificates: Certificates | None = None,
) -> tuple[Answer | None, Certificates]:
    """Return the smallest mu at which all margins of a target may vanish; None where none can.

    A program for the smallest A_i + B_i below
    the best mu so far shows by its dual bound that a node cannot improve it; only where the sum
    reaches zero a second program finds mu. Multipliers of another mean load are tried before any
    program is solved.
    """
    bounded = len(margins.c) > len(margins.kind)
    if bounded and largest_margin(margins).value > 1.0 + VANISHES:
        raise InputError(
            "largest_slip: no residual slip below it holds the mean loads; give a larger one"
        )
    G = np.hstack([margins.G, margins.d[:, None]])
    cost = np.append(np.zeros(margins.G.shape[1]), 1.0)
    top, best, proofs = -upper.value, None, dict(certificates or {})
    # nodes with a wide range for little pressure come first: a small best prunes the others
    sums = [(x[list(rows)].sum() for x in (margins.c, margins.d)) for rows in margins.targets]
    reach = [-c / d if d < 0.0 else np.inf for c, d in sums]
    for t in np.argsort(reach, kind="stable"):
        rows = margins.targets[t]
        total, constant = G[list(rows)].sum(axis=0), margins.c[list(rows)].sum()
        if t in proofs:
            proved = dual_bound(proofs[t], total, G, margins.c, top, np.ones(len(cost)))
            if proved + constant > VANISHES:
                continue
        smallest = minimise(total, G, margins.c, top)
        proofs[int(t)] = smallest.multipliers
        if smallest.value + constant > VANISHES:
            continue
        found = minimise(cost, G, margins.c, top, rows)
        if found.value < top or (best is None and np.isfinite(found.value)):
            top, best = found.value, found
        if top <= VANISHES:
            break
    return best, proofs
