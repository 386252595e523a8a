"""Line contact of equal cylinders under any history of normal and shear force.

Every tangential traction is a superposition of differences of Hertz's pressures of smaller loads
(Jäger's principle), so with d(P') in [-1, 1] for 0 < P' < P,

    q(x) = f int_0^P d(P') (dp(x; P') / dP') dP',      Q = f int_0^P d dP',
    u = f int_0^P d (du_n / dP') dP' = c Q - f / (pi E*) int_0^P d ln P' dP',

where u is the relative tangential displacement far away (u_n the normal one), and c depends on
where it is measured. d is +1 or -1 where the points at the edge of the contact of the load P' have
slipped last, and in between where the contact has grown without slip. It is piecewise constant
between turning points of the loads: this memory is updated step by step, exactly.

Sources: J. Jäger, Journal of Tribology 120 (1998) 677-684; V. Aleshin, O. Bou Matar and K. Van Den
Abeele, International Journal of Solids and Structures 60-61 (2015) 84-95.
"""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.reference.closed_forms import Hertz


def cycle_dissipation(hertz: Hertz, f: float, P: Array, Q: Array, cycles: int = 3) -> float:
    """Return the dissipation of the last of some equal cycles of P and Q.

    The dissipation of a closed cycle is the work of Q on u; Dundurs' constant beta is 0.

    Args:
        hertz: radius and modulus of the contact; its force is not used.
        f: coefficient of friction.
        P: (n,) normal forces around the cycle, positive, first and last equal; in small steps, as
            between them the loads count as straight.
        Q: (n,) shear forces, abs(Q) < f P.
        cycles: number of cycles; the last one is steady from the second or third on.
    """
    memory = [(0.0, 0.0), (float(P[0]), float(Q[0]) / (f * float(P[0])))]
    work = 0.0
    for number in range(cycles):
        u = [_displacement(memory)]
        for load, shear in zip(P[1:].tolist(), Q[1:].tolist(), strict=True):
            _follow(memory, load, shear / f)
            u.append(_displacement(memory))
        if number == cycles - 1:
            work = float(np.sum(0.5 * (Q[1:] + Q[:-1]) * np.diff(u)))
    return f / (np.pi * hertz.modulus) * work


def _displacement(memory: list[tuple[float, float]]) -> float:
    """Return -int d ln P' dP'."""
    ends, values = np.array(memory).T
    logs = np.log(np.where(ends > 0.0, ends, 1.0))
    return -float(values[1:] @ np.diff(ends * logs - ends))


def _follow(memory: list[tuple[float, float]], load: float, wanted: float) -> None:
    """Update the memory, pairs (end, d) of rising ends, to a load P and a force Q / f."""
    before = memory[-1][0]
    low = min(load, before)
    while len(memory) > 2 and memory[-2][0] >= low:
        memory.pop()
    memory[-1] = (low, memory[-1][1])
    ends, values = np.array(memory).T
    total = float(values[1:] @ np.diff(ends))
    if load > before and abs(wanted - total) <= load - before:
        memory.append((load, (wanted - total) / (load - before)))
        return
    sign = float(np.sign(wanted - total))
    if sign == 0.0:
        return
    # slip from the edge of the contact inwards to where the force is met
    while len(memory) > 1:
        end, value = memory.pop()
        start = memory[-1][0]
        total -= (end - start) * value
        if sign * (total + sign * (load - start)) >= sign * wanted:
            if value != sign:
                reach = (wanted - total + value * start - sign * load) / (value - sign)
                if reach > start:
                    memory.append((reach, value))
            break
    memory.append((load, sign))
