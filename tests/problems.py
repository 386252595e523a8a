"""Random contact problems, what became of each, and whether that was right.

A problem follows from its number alone. Accepted records are replayed by ``replay.py``; of a
refusal ``ways.py`` says whether any way on exists where the path is said to end.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from equations import OPEN, STICK
from replay import HELD_SHARE, Replay, replay
from small import named_loads, small_system, table
from ways import NEAR, TooMany, balanced, follow

import receding_fenicsx as rf

STEPS = 40
"""Load steps a leg of the problems that are played in load steps."""
SAMPLES = 12
"""Samples a leg of the others."""
SAME = 1e-6
"""Part of a leg within which the place of a refusal is that where a branch ends."""
SUSPECT = 0.03
"""Energy lost in a load step, over force times motion, above which it may have jumped."""
NEARER = 1e-12, 1e-13
"""Distances from a limit, over the largest force, that count as being on it beside a jump: in a
limit of infinitely many cycles the force that a jump releases may vanish."""
HIDDEN = 1e-7
"""Round-off of the reactions, over the largest force, that may hide a way on beside a jump."""
APART = 0.5
"""Distance from every continuous way, over the step's motion, above which a step has jumped."""

ACCEPTED, REFUSED = "accepted", "refused"
"""Right: the record keeps all laws; no way leads on where the path is said to end."""
WRONG, FALSE = "WRONG", "FALSELY REFUSED"
"""The record contradicts a law, or the program has crashed; a way on exists."""
MISNAMED = "refused, misnamed"
"""The path ends, but what is said is that a solver has given up."""
UNJUDGED = "refused, not judged"
"""There are too many sets of states to try, or of several branches some go on."""


@dataclass(frozen=True)
class Problem:
    """One random problem; ``tags`` name its features."""

    number: int
    system: rf.ContactSystem
    history: rf.History
    solver: rf.SolverOptions
    tags: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What became of a problem: the judgement, what it is about, and the words of the program."""

    verdict: str
    reason: str
    said: str = ""


def problem(number: int) -> Problem:
    """Return the problem of a number."""
    rng = np.random.default_rng([number, 20080])
    tags: list[str] = []
    shares = [0.2, 0.2, 0.16, 0.14, 0.1, 0.08, 0.05, 0.05, 0.02]
    n = int(rng.choice([1, 2, 3, 4, 5, 6, 7, 8, 12], p=shares))
    kind = str(rng.choice(["plain", "coupled", "near-singular", "integer", "mirror", "equal"]))
    tags.append(kind)
    K: np.ndarray = _stiffness(rng, kind, n)
    loads = 1 + int(rng.integers(3))
    ties = kind in ("integer", "mirror", "equal")
    held = _held(rng, n, rng.random() < 0.35)
    rigid = np.zeros((2 * n, 0))
    if rng.random() < 0.3:
        rigid = _rigid(rng, n, held)
    if rigid.shape[1]:
        tags.append("free body")
        basis = np.linalg.qr(rigid)[0]
        free = np.eye(2 * n) - basis @ basis.T
        K = free @ K @ free
        K = 0.5 * (K + K.T)
    if held.any():
        tags.append("held")
    f = np.where(held[n:], 0.0, _friction(rng, n, kind))
    if kind == "coupled":
        f *= 2.0 / max(1.0, f.max() / 1.5)
    g0 = _gaps(rng, n, ties)
    if g0.any():
        tags.append("gaps")
    r_star = _loads(rng, n, loads, kind)
    names = {f"L{k}": r_star[k] for k in range(loads)}
    system = replace(small_system(K, names, f, g0, rigid.T), held=held)
    if rng.random() < 0.3:
        method, tags = "gauss-seidel", [*tags, "gauss-seidel"]
    else:
        method = "events"
    on_jump = str(rng.choice(["stop", "static"]))
    solver = rf.SolverOptions(method=method, steps_per_leg=STEPS, on_jump=on_jump)
    return Problem(number, system, random_history(rng, system, ties), solver, (*tags, on_jump))


def directed(p: Problem) -> Problem:
    """Return a problem with other friction for backward slip, none of it at some nodes."""
    rng, system = np.random.default_rng([p.number, 1]), p.system
    f_backward = system.f * rng.choice([0.0, 0.3, 0.8, 1.0, 1.5], system.n)
    forward = np.where(rng.random(system.n) < 0.1, 0.0, system.f)
    system = replace(system, f=forward, f_backward=f_backward)
    return replace(p, system=system, tags=(*p.tags, "directions"))


def oblique(p: Problem) -> Problem:
    """Return a problem whose body is guided or hinged, with two edges oblique to each other.

    One guided node has no stiffness of its own for load steps to go by; it is followed exactly.
    """
    rng, system = np.random.default_rng([p.number, 2]), p.system
    n, angles = system.n, rng.choice([0.25, 0.5, 0.75, -0.25, -0.5, -0.75, 0.1, -0.1], 2) * np.pi
    first = np.arange(n) < int(rng.integers(1, n + 1))
    angle = np.where(first, *angles)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    places = along * (1.0 + np.arange(n))[:, None]
    hinge = places - rng.choice([-2.0, -1.0, 0.0, 1.0, 3.0], 2)
    turn = np.stack([-hinge[:, 1], hinge[:, 0]], axis=1)
    ways = [np.broadcast_to(one, (n, 2)) for one in np.eye(2)]
    motions = [ways[:1], ways, [turn], [*ways, turn]][rng.choice(4, p=[0.4, 0.2, 0.3, 0.1])]
    local = [np.concatenate([(m * along).sum(1), (m * across).sum(1)]) for m in motions]
    rigid = np.array(local).T[:, : max(1, 2 * n - 2)]
    left, size, _ = np.linalg.svd(rigid, full_matrices=False)
    basis = left[:, size > 1e-8]
    rest = np.eye(2 * n) - basis @ basis.T
    K = rest @ (system.K + 0.1 * np.eye(2 * n)) @ rest
    balanced_loads, r_star = system.r_star @ rest, system.r_star
    if rng.random() < 0.2 and np.abs(balanced_loads).max(axis=1).min() > 1e-9:
        r_star = balanced_loads
    free = np.zeros(2 * n, dtype=bool)
    system = replace(system, K=0.5 * (K + K.T), r_star=r_star, held=free, rigid=basis)
    solver = replace(p.solver, method="events") if n == 1 else p.solver
    return replace(p, system=system, solver=solver, tags=(*p.tags, "oblique"))


def limited(p: Problem) -> Problem:
    """Return a problem on the exact path until the limit of infinitely many cycles."""
    history = replace(p.history, cycles=30, until_limit=len(p.history.loop) > 0)
    solver = replace(p.solver, method="events")
    return replace(p, history=history, solver=solver, tags=(*p.tags, "limit"))


def sprung(p: Problem, soft: tuple[float, float] = (4.0, 9.0)) -> Problem:
    """Return a problem whose body soft springs hold where only its contact or guides did.

    Args:
        p: the problem; a body that is not free, and every second one, is guided or hinged first.
        soft: range of -log10 of the springs' stiffness over the largest of the body.
    """
    if p.number % 2 or not p.system.rigid.shape[1]:
        p = oblique(p)
    rng, system = np.random.default_rng([p.number, 3]), p.system
    basis = np.linalg.qr(system.rigid)[0]
    largest = np.abs(system.K).max() or 1.0
    springs = 10.0 ** -rng.uniform(*soft) * largest * basis @ basis.T
    K = system.K + springs
    system = replace(system, K=0.5 * (K + K.T), rigid=np.zeros((len(K), 0)))
    return replace(p, system=system, tags=(*p.tags, "sprung"))


def capped(p: Problem) -> Problem:
    """Return a problem with a shear limit, a cohesion or both, other friction backward at times.

    They are of the size of the forces; some nodes have none, a few are held by cohesion alone.
    """
    rng = np.random.default_rng([p.number, 4])
    if rng.random() < 0.3:
        p = directed(p)
    system = p.system
    n, force = system.n, float(np.abs(system.r_star).max()) or 1.0
    free = ~system.held[n:]
    kind = str(rng.choice(["limit", "cohesion", "both"], p=[0.5, 0.2, 0.3]))
    parts: dict[str, Any] = {}
    if kind != "cohesion":
        limit = force * rng.choice([0.05, 0.2, 0.5, 1.0, 4.0], n)
        parts["shear_limit"] = np.where(rng.random(n) < 0.05, 0.0, limit) / system.weight
    if kind != "limit":
        cohesion = force * rng.choice([0.0, 0.05, 0.2, 0.5, 1.0], n)
        parts["cohesion"] = np.where(free, cohesion, 0.0) / system.weight
    if rng.random() < 0.3:
        parts = {key: np.full(n, part[0]) for key, part in parts.items()}
        if "cohesion" in parts:
            parts["cohesion"] = np.where(free, parts["cohesion"], 0.0)
    return replace(p, system=replace(system, **parts), tags=(*p.tags, kind))


FAMILIES = {
    "plain": lambda p: p,
    "directed": directed,
    "oblique": oblique,
    "limit": limited,
    "sprung": sprung,
    "capped": capped,
}
"""What becomes of the problem of a number, by name."""


def _stiffness(rng: np.random.Generator, kind: str, n: int) -> np.ndarray:
    m = 2 * n
    G = rng.standard_normal((m, 3 * m // 2 + 1))
    K: np.ndarray = G @ G.T / len(G[0])
    if kind == "plain":
        K += 0.2 * np.eye(m)
    if kind == "coupled":  # f |K_tn| above K_tt: paths jump
        couple = rng.uniform(0.6, 0.95, n) * rng.choice([-1.0, 1.0], n)
        K = 0.1 * K + np.kron(np.eye(2), np.eye(n)) + np.kron([[0, 1], [1, 0]], np.diag(couple))
    if kind == "near-singular":
        vectors = np.linalg.qr(rng.standard_normal((m, m)))[0]
        size = 10.0 ** -(rng.uniform(2.0, 8.0) * rng.random(m))
        size[0], size[-1] = 1.0, 10.0 ** -rng.uniform(2.0, 8.0)
        K = (vectors * size) @ vectors.T
    if kind == "integer":
        A = rng.integers(-2, 3, (m, m)).astype(float)
        K = A @ A.T + np.eye(m)
    if kind == "equal":
        one = rng.choice([[2.0, 1.5, 2.0], [2.0, -1.0, 2.0], [1.0, 0.0, 1.0], [3.0, 1.0, 2.0]])
        K = np.kron([[one[0], one[1]], [one[1], one[2]]], np.eye(n))
        if n > 1 and rng.random() < 0.5:
            K += np.kron(np.eye(2), np.full((n, n), 0.25))
    if kind == "mirror":
        S = _mirror(n)
        K = K + 0.1 * np.eye(m)
        K = 0.5 * (K + S @ K @ S)
    return 0.5 * (K + K.T)


def _mirror(n: int) -> np.ndarray:
    """Return the reflection: v odd, w even."""
    J = np.eye(n)[::-1]
    return np.kron([[-1.0, 0.0], [0.0, 1.0]], J)


def _held(rng: np.random.Generator, n: int, some: bool) -> np.ndarray:
    """Hold some nodes tangentially, normally or both."""
    held = np.zeros(2 * n, dtype=bool)
    if not some:
        return held
    for i in rng.choice(n, size=1 + int(rng.integers(max(1, n // 2))), replace=False):
        held[i], held[n + i] = [(True, False), (False, True), (True, True)][int(rng.integers(3))]
    return held


def _rigid(rng: np.random.Generator, n: int, held: np.ndarray) -> np.ndarray:
    """Return rigid motions that leave held freedoms where they are."""
    zero, one, x = np.zeros(n), np.ones(n), np.arange(n) - 0.5 * (n - 1)
    motions = [np.concatenate([zero, one]), np.concatenate([one, zero])]
    if n > 1:
        motions.append(np.concatenate([zero, x / np.abs(x).max()]))
    count = 1 + int(rng.integers(len(motions)))
    kept = [motion for motion in motions[:count] if not np.any(motion[held])]
    return np.array(kept).reshape(-1, 2 * n).T


def _friction(rng: np.random.Generator, n: int, kind: str) -> np.ndarray:
    choice = rng.integers(5)
    if choice == 0:
        f = rng.uniform(0.0, 3.0, n)
    elif choice == 1:
        f = np.full(n, float(rng.choice([0.25, 0.5, 1.0, 2.0])))
    elif choice == 2:
        f = np.where(rng.random(n) < 0.4, 0.0, rng.uniform(0.1, 1.5, n))
    elif choice == 3:
        f = np.full(n, float(rng.uniform(0.05, 0.8)))
    else:
        f = np.zeros(n) if rng.random() < 0.3 else np.full(n, float(rng.uniform(0.8, 3.0)))
    return 0.5 * (f + f[::-1]) if kind == "mirror" else f


def _gaps(rng: np.random.Generator, n: int, ties: bool) -> np.ndarray:
    if rng.random() < 0.6:
        return np.zeros(n)
    size = float(rng.choice([0.0625, 0.25])) if ties else float(rng.uniform(0.01, 0.4))
    if ties:
        return np.where(np.arange(n) % 2 == int(rng.integers(2)), size, 0.0)
    g0 = np.where(rng.random(n) < 0.5, size * rng.random(n), 0.0)
    return g0 - g0.min() if rng.random() < 0.7 else g0


def _loads(rng: np.random.Generator, n: int, loads: int, kind: str) -> np.ndarray:
    r_star = rng.standard_normal((loads, 2 * n))
    if kind == "integer":
        r_star = rng.integers(-2, 3, (loads, 2 * n)).astype(float)
    if kind == "equal":
        r_star = np.repeat(rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], (loads, 2)), n, axis=1)
    if rng.random() < 0.85:
        r_star[0, n:] = np.abs(r_star[0, n:]) + (1.0 if kind in ("integer", "equal") else 0.3)
    if kind == "mirror":
        r_star = 0.5 * (r_star + r_star @ _mirror(n))
    return r_star


def random_history(rng: np.random.Generator, system: rf.ContactSystem, ties: bool) -> rf.History:
    """Return a table: a first load, random corners, closed cycles, at times all unloaded."""
    loads = len(system.load_names)

    def corner() -> np.ndarray:
        if rng.random() < 0.12:
            return np.zeros(loads)
        quarters = rng.integers(-2, 6, loads) / 4.0
        row = quarters if ties else rng.uniform(-0.5, 1.3, loads)
        if rng.random() < 0.5:
            row[0] = abs(row[0]) + (0.5 if ties else rng.uniform(0.2, 1.0))
        return row

    def corners(count: int, last: np.ndarray) -> list[np.ndarray]:
        rows: list[np.ndarray] = []
        while len(rows) < count:
            row = corner()
            if np.any(row != (rows[-1] if rows else last)):
                rows.append(row)
        return rows

    zero = np.zeros(loads)
    first = np.eye(loads)[0] if rng.random() < 0.6 else corners(1, zero)[0]
    path: list[np.ndarray] = [zero, first, *corners(int(rng.integers(3)), first)]
    if rng.random() < 0.3:
        return table(system, path)
    while True:
        loop = [path[-1], *corners(1 + int(rng.integers(3)), path[-1]), path[-1]]
        if np.any(loop[-2] != loop[-1]):
            return table(system, path, loop, 1 + int(rng.integers(3)))


def play(p: Problem, samples: int = SAMPLES) -> rf.Record:
    """Evolve a problem, every cycle kept, with all load steps or so many samples a leg."""
    samples = p.solver.steps_per_leg if p.solver.method == "gauss-seidel" else samples
    return rf.evolve(p.system, p.history, p.solver, rf.OutputOptions(samples, "all"))


def judge(p: Problem) -> Outcome:
    """Play a problem; say what became of it and whether that was right."""
    try:
        record = play(p)
    except rf.InputError as error:
        return Outcome(REFUSED, "InputError", str(error))
    except rf.SolveError as error:
        found, reason = _refusal(p, error, _reason(error))
        if found == FALSE and "softest motion of the body" in str(error) and _is_nearly_loose(p):
            found, reason = UNJUDGED, "nearly loose"
        return Outcome(found, reason, str(error))
    except Exception as error:
        return Outcome(WRONG, "crashed", f"{type(error).__name__}: {error}")
    return verdict(p, record)


def table_of(outcomes: Iterable[Outcome]) -> str:
    """Return how many problems came out how, a line each."""
    counts = Counter((o.verdict, o.reason) for o in outcomes)
    rows = [
        f"{count:6d}  {verdict}: {reason}" for (verdict, reason), count in sorted(counts.items())
    ]
    return "\n".join(rows)


def verdict(p: Problem, record: rf.Record) -> Outcome:
    """Hold an accepted record against the laws."""
    run = replay(p.system, p.history, record)
    if run.found and run.guessed:  # several samples tell whether a free body drifts or has turned
        run = replay(p.system, p.history, play(p, 40 * SAMPLES))
    found = run.found or _silent_jumps(p, run) or _needless_jumps(p, run)
    if found:
        return Outcome(WRONG, found[0].split(": ", 1)[-1].split(" by ")[0], "; ".join(found[:3]))
    return Outcome(ACCEPTED, "with jumps" if record.jumps else "no jump")


def _reason(error: rf.SolveError) -> str:
    """Return the kind of a refusal."""
    words = (
        "lost accuracy|lift-off|gross sliding|overturning|not held|jumped|no equilibrium was found|"
        "no state was found|round-off|frictionless"
    )
    word = re.search(words, str(error))
    return type(error).__name__ + (f": {word[0]}" if word else "")


def _silent_jumps(p: Problem, run: Replay) -> list[str]:
    """Return the load steps that have jumped, where more have than are counted."""
    found = []
    for step in run.steps:
        u_a, u_b = (u.astype(float) for u in step.u)
        k, force = run.body.k, step.leg.force
        way, energy = float(np.abs(k * (u_b - u_a)).max()), force * float(np.abs(u_b - u_a).max())
        if way <= SAME * force or step.lost <= SUSPECT * energy:
            continue
        try:
            ends = follow(p.system, *step.load, u_a, step.state[0], force)
        except TooMany:
            continue
        # where all loads vanish the last part of a way is round-off of the step before
        whole = [float(np.abs(k * (end.u - u_b)).max()) for end in ends if end.s >= 1.0 - SAME]
        if min(whole, default=np.inf) > APART * way:
            load = step.load[1].astype(float).tolist()
            found.append(f"{step.leg.place(0.0)}: a load step jumps silently, to {load}")
    if len(found) <= run.record.jumps or p.solver.steps_per_leg > STEPS:
        return found[run.record.jumps :]
    # an error of a step falls with its length, a jump does not
    fine = replace(p, solver=replace(p.solver, steps_per_leg=8 * STEPS))
    try:
        finer = replay(p.system, p.history, play(fine))
    except rf.SolveError:
        return found
    return found if finer.record.jumps > run.record.jumps else _silent_jumps(fine, finer)


def _needless_jumps(p: Problem, run: Replay) -> list[str]:
    """Return the counted jumps of an exact path where a way on exists."""
    found = []
    for jump in run.jumps:
        leg, rest = jump.leg, max(1.0 - jump.s, SAME)
        if max(leg.noise.max(), jump.doubt) > HIDDEN * leg.force:
            continue  # round-off of far displacements decides whether it jumps
        way = p.system, leg.load(jump.s).astype(float), leg.ends[1], jump.u, jump.state, leg.force
        try:
            # a node may be as little pressed as to seem free where it jumps by as little
            ends = [end for close in (NEAR, *NEARER) for end in follow(*way, close)]
        except TooMany:
            continue
        if not any(end.s <= SAME / rest for end in ends):
            found.append(f"{leg.place(jump.s)}: it jumps though a way on exists")
    return found


def _is_nearly_loose(p: Problem) -> bool:
    """Return whether forces below 1e-7 of the largest decide: those of the softest motion."""
    free = ~p.system.held
    stiffness = np.linalg.eigvalsh(p.system.K[np.ix_(free, free)])[p.system.rigid.shape[1] :]
    return bool(stiffness[0] < 1e-7 * stiffness[-1])


def _is_idle(p: Problem, record: rf.Record) -> bool:
    """Return whether the cycles change the forces by less than 1e-7 of the largest."""
    loop = p.history.loop
    change = np.abs((loop - loop[0]) @ p.system.r_star).max()
    held = np.abs(p.history.path @ p.system.r_star).max()
    ends = record.turning_points
    return bool(change < 1e-7 * max(HELD_SHARE * held, np.abs(ends.P).max(), np.abs(ends.Q).max()))


def _place(error: rf.SolveError, p: Problem, a: np.ndarray, b: np.ndarray) -> float | None:
    """Return the place of the loads that an error names on the leg from a to b, None if off it."""
    loads, way = np.array(named_loads(error, *p.system.load_names)), b - a
    s = float((loads - a) @ way) / float(way @ way or 1.0) if len(loads) == len(a) else np.nan
    off = np.abs(a + s * way - loads).max() if s == s else np.inf
    return s if off <= 1e-8 * np.abs([a, b]).max() and -SAME <= s <= 1.0 + SAME else None


def _refusal(p: Problem, error: rf.SolveError, reason: str) -> tuple[str, str]:
    """Return whether a way on exists where a path is said to end."""
    record = error.record
    if not isinstance(record, rf.Record):
        return UNJUDGED, reason
    if "enlarge the load range" in str(error):
        return (REFUSED if _is_idle(p, record) else FALSE), reason
    n, ends = p.system.n, record.turning_points
    done = len(ends.s)
    cycle, leg, path, first = 0, done, p.history.path, len(p.history.path) - 1
    if done >= first:
        path = p.history.loop
        cycle, leg = divmod(done - first + len(path) - 1, len(path) - 1)
    a, b = path[leg : leg + 2]
    named = _place(error, p, a, b)
    if named is None or not str(error).startswith(f"cycle {cycle}, leg {leg}: "):
        return FALSE, reason + " (off the leg)"
    # statics may know of contact forces just behind that place
    if isinstance(error, rf.NoEquilibrium) and np.any(a != b) and p.system.rigid.shape[1]:
        if not balanced(p.system, a + min(1.0, named + SAME) * (b - a)):
            return REFUSED, reason
    if done:
        u, state = np.concatenate([ends.v[-1], ends.w[-1]]), ends.state[-1].astype(int)
        force = max(np.abs(ends.P).max(), np.abs(ends.Q).max())
    else:
        u, state, force = np.zeros(2 * n), np.where(p.system.g0 > 0.0, OPEN, STICK), 0.0
    try:
        branches = follow(p.system, a, b, u, state, float(force))
    except TooMany:
        return UNJUDGED, reason
    dead = [end.s for end in branches if end.s < 1.0]
    if not dead:
        return FALSE, reason
    if "lost accuracy" in reason or "NotConverged" in reason:
        return MISNAMED, reason
    said = re.findall(r"\(s = (\S+) of the leg\)", str(error))
    if said and p.solver.method == "events":
        s = float(said[-1])
        if any(abs(s - s_dead) <= SAME for s_dead in dead):
            return REFUSED, reason
        if p.solver.on_jump == "stop" or (s > 1.0 - SAME and not np.any(b)):
            return FALSE, reason + " (elsewhere)"
        # a jump has led on to where statics has to decide
        return (UNJUDGED if balanced(p.system, a + (s + SAME) * (b - a)) else REFUSED), reason
    return (REFUSED if len(dead) == len(branches) else UNJUDGED), reason
