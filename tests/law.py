"""The contact law checked on a record by code that shares nothing with the solvers.

Only the definitions of the paper's eqs. (4) to (12) are used, each written out for one instant.
"""

import numpy as np

from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.system import ContactSystem


def worst_violation(system: ContactSystem, record: Record) -> float:
    """Return the largest violation of any law at any kept instant, over the largest force.

    For whole models (``half = False``) of kind "frictional"; instants are the record's samples.
    """
    s, n = record.samples, system.n
    K, forward = np.asarray(system.K), system.f
    backward = forward if system.f_backward is None else system.f_backward
    # a contact that opens altogether has no force of its own: the held reactions are the scale then
    scale = max(np.abs(s.P).max(), np.abs(s.Q).max(), 0.01 * np.abs(s.load @ system.r_star).max())
    worst = 0.0
    for j in range(len(s.s)):
        u = np.concatenate([s.v[j], s.w[j]])
        r = K @ u
        for k in range(len(system.load_names)):
            r = r + s.load[j, k] * system.r_star[k]
        Q, P, gap = s.Q[j], s.P[j], s.w[j] + system.g0
        equilibrium = np.concatenate([r[:n] - Q, r[n:] - P])
        equilibrium[system.held] = 0.0
        k_n, touches = np.diagonal(K)[n:], ~system.held[n:]
        laws = [
            np.abs(equilibrium).max(),  # eq. (11)
            np.maximum(-P, 0.0)[touches].max(initial=0.0),  # compression only
            np.maximum(-gap * k_n, 0.0)[touches].max(initial=0.0),  # no penetration
            # one of them vanishes
            np.minimum(np.abs(P), np.abs(gap) * k_n)[touches].max(initial=0.0),
        ]
        free = ~system.held[:n] & touches
        laws.append(np.maximum(Q - backward * np.abs(P), 0.0)[free].max(initial=0.0))
        laws.append(np.maximum(-Q - forward * np.abs(P), 0.0)[free].max(initial=0.0))
        slips = free & (forward + backward > 0)
        laws.append(np.abs(Q + forward * P)[slips & (s.state[j] == 3)].max(initial=0.0))
        laws.append(np.abs(Q - backward * P)[slips & (s.state[j] == 4)].max(initial=0.0))
        worst = max(worst, *laws)
    return float(worst / scale) if scale > 0 else 0.0


def worst_slip(system: ContactSystem, record: Record) -> float:
    """Return the largest slip in a stuck node or against its direction, as a relative force.

    Compared are neighbouring samples of a leg between which no event lies.
    """
    s, e = record.samples, record.events
    k_t = np.diagonal(np.asarray(system.K))[: system.n]
    rough = system.f > 0
    if system.f_backward is not None:
        rough = rough | (system.f_backward > 0)
    scale = max(np.abs(s.P).max(), np.abs(s.Q).max(), 0.01 * np.abs(s.load @ system.r_star).max())
    worst = 0.0
    for j in range(len(s.s) - 1):
        if (s.cycle[j], s.leg[j]) != (s.cycle[j + 1], s.leg[j + 1]):
            continue
        here = (e.cycle == s.cycle[j]) & (e.leg == s.leg[j])
        if np.any(here & (e.s >= s.s[j] - 1e-12) & (e.s <= s.s[j + 1] + 1e-12)):
            continue
        dv = (s.v[j + 1] - s.v[j]) * k_t
        state = s.state[j]
        wrong = [
            np.abs(dv[(state == 1) & rough]).max(initial=0.0),
            np.maximum(-dv[(state == 3) & rough], 0.0).max(initial=0.0),
            np.maximum(dv[(state == 4) & rough], 0.0).max(initial=0.0),
        ]
        worst = max(worst, *wrong)
    return float(worst / scale) if scale > 0 else 0.0


def random_system(seed: int, n: int, margin: float, n_loads: int = 2) -> ContactSystem:
    """Return a random positive definite system, f |row of K_tn|_1 <= margin * min eig K_tt.

    Loads press mostly, so that contact, slip and separation all occur.
    """
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((2 * n, 3 * n))
    K = G @ G.T / (3 * n) + 0.2 * np.eye(2 * n)
    K_tn = K[:n, n:]
    f = margin * np.linalg.eigvalsh(K[:n, :n]).min() / np.abs(K_tn).sum(axis=1).max()
    r_star = rng.standard_normal((n_loads, 2 * n))
    r_star[0, n:] = np.abs(r_star[0, n:]) + 0.3
    return ContactSystem(
        x=np.arange(n, dtype=float),
        points=np.stack([np.arange(n), np.zeros(n)], 1).astype(float),
        weight=np.ones(n),
        K=0.5 * (K + K.T),
        r_star=r_star,
        load_names=tuple(f"load{k}" for k in range(n_loads)),
        f=np.full(n, f),
        g0=np.zeros(n),
        held=np.zeros(2 * n, dtype=bool),
        rigid=np.zeros((2 * n, 0)),
    )
