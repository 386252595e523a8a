"""Interference: contacts that overlap by a depth delta as made, closed by a load factor 0 to 1.

The gap is g = g0 + w - lambda delta. With u = u' + lambda s, s = [0; delta], it is g0 + w', and

    r = sum_k lambda_k r*_k + lambda K s + K u',

so that the interference is a load with r* = K s, prescribed like a displacement; its conjugate is
sum_i delta_i P_i. The contact system, its path and its record have u', whose w is the change of the
gap; the true displacement u is needed where the bodies' fields are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk.contact_nodes import ContactNodes
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import INTERFERENCE, Scene
from receding_fenicsx.scene.profiles import evaluate_checked

KEY = "[contact] interference"


def interference_shift(
    scene: Scene, contact: ContactNodes, held: NDArray[np.bool_]
) -> Array | None:
    """Return s (2N,), zero at held degrees of freedom; None without interference.

    Raises:
        InputError: the interference is negative somewhere, or zero everywhere.
    """
    if INTERFERENCE not in scene.preloads:
        return None
    depth = np.zeros(len(contact.x))
    for k, part in enumerate(scene.contacts):
        on = contact.edge == k
        if part.interference is not None:
            depth[on] = evaluate_checked(part.interference, contact.x[on], None, KEY)
    if depth.min() < 0.0 or not depth.any():
        what = "zero everywhere" if not depth.any() else "negative"
        raise InputError(f"{KEY}: is {what}; give a depth, or remove it")
    return np.where(held, 0.0, np.concatenate([np.zeros(len(depth)), depth]))


def with_interference(system: ContactSystem, shift: Array) -> ContactSystem:
    """Return a system with the interference as its last load.

    Raises:
        InputError: a free motion opens the whole contact, so that nothing presses.
    """
    if _is_free(system.rigid[system.n :][~system.held[system.n :]]):
        raise InputError(
            f"{KEY}: the body is free to move off the contact, so nothing presses; hold it by a "
            "[[support]], or remove the interference"
        )
    r_star, sign = shift @ system.K, system.load_sign
    cross = system.r_star @ shift
    compliance = np.block(
        [
            [system.load_compliance, (sign * cross)[:, None]],
            [cross[None, :], np.array([[r_star @ shift]])],
        ]
    )
    return replace(
        system,
        r_star=np.vstack([system.r_star, r_star]),
        load_names=(*system.load_names, INTERFERENCE),
        load_compliance=compliance,
        load_sign=np.append(sign, 1.0),
    )


def _is_free(lift: Array) -> bool:
    """Return whether a combination of motions (nodes, m) opens the gap of every node."""
    if not lift.shape[1]:
        return False
    zero = np.zeros(lift.shape[1])
    return bool(linprog(zero, -lift, -np.ones(len(lift)), bounds=(None, None)).status == 0)
