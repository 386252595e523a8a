"""Replay a record from K, r*, f and g0 alone; list what contradicts the contact law.

An exact record is replayed leg by leg from its turning points (``replay_exact.py``): its events say
in which states the contact is, the states make the law a linear system (``equations.py``), and what
is linear between two events keeps a law all along where it keeps it at both ends. All kept
instants, the order and the places of the events, slip directions, jumps, dissipation and energy
have to agree with that. A record in load steps is checked step by step (``replay_steps.py``).

Nothing of the package is used, its solvers least of all. Tolerances are forces over the history's
largest so far, and what the rounding of displacements to double precision is worth: eps |K| |u|,
and eps times the condition of the states' equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from equations import BACKWARD, EPS, FORWARD, OPEN, ROUNDINGS, STICK, Array, Body, States

LAW = 1e-11
"""Violation of a law, over the largest force, that is let pass."""
HELD_SHARE = 0.01
"""Part of the held reactions sum lambda r* that counts as force where nothing presses."""
LIMIT = 1e-8
"""Slip of the limit cycle, over the largest displacement, that is let pass."""
ENERGY = 1e-10
"""Error of an energy, over the energies that are moved, that is let pass."""
RELEASED = 1e-6
"""Error of the energy that a jump releases, over it: its place is known as well as that only."""


class Leg(NamedTuple):
    """One leg of a record, and where it starts from."""

    cycle: int
    number: int  # within the cycle
    ends: tuple[Array, Array]  # load factors
    u: Array  # (2N,) displacements at its start
    state: Array  # (N,) states at its start
    row: int  # of its end in the turning points
    rows: Array  # of its samples
    force: float  # largest nodal force up to its end
    noise: Array  # (2N,) worth of rounding in the reactions, anywhere so far: gaps keep theirs

    def load(self, s: float) -> Array:
        """Return the load factors at s."""
        a, b = (np.array(end, np.longdouble) for end in self.ends)
        return (1 - np.longdouble(s)) * a + np.longdouble(s) * b

    def place(self, s: float) -> str:
        """Return a place on the leg in words."""
        return f"cycle {self.cycle}, leg {self.number}, s = {s:.9g}"


@dataclass
class Totals:
    """What the replay sums up over a cycle."""

    dissipation: Array  # (N,) by node
    adrift: Array  # (N,) nodes that slipped in a rigid drift: the share of a node is unknown
    work: float = 0.0  # integral of sum lambda r* . du
    moved: float = 0.0  # the sizes of all energies
    released: float = 0.0  # energy lost in jumps
    jumps: int = 0
    hidden: int = 0  # changes that round-off of former displacements may hide: jumps or none
    unsure: float = 0.0  # energy lost in those
    rounded: float = 0.0  # first-order round-off of the work of contact forces
    known: bool = True  # False where a jump or a drift could not be followed
    largest: float = 0.0  # displacement
    misfit: float = 0.0  # work of the contact forces on what replayed legs end off the record's
    divided: float = 0.0  # energies of load steps that changed states: they may have been divided


class Jump(NamedTuple):
    """A jump: its leg, where laws hold last, displacements and states there."""

    leg: Leg
    s: float
    u: Array
    state: Array
    doubt: float  # round-off of u as a force


class Step(NamedTuple):
    """A load step: its leg, loads, displacements and states at both ends, the energy it lost."""

    leg: Leg
    load: tuple[Array, Array]
    u: tuple[Array, Array]
    state: tuple[Array, Array]
    lost: float


@dataclass
class Replay:
    """A record held against the laws."""

    system: Any  # anything with the arrays K, r_star, f, g0, held, weight of a condensed body
    history: Any  # anything with path, loop, cycles, until_steady
    record: Any  # of the whole contact, all nodes modelled
    found: list[str] = field(default_factory=list)  # what contradicts the laws
    jumps: list[Jump] = field(default_factory=list)  # met on the way (exact records)
    steps: list[Step] = field(default_factory=list)  # load steps (the others)
    guessed: bool = False  # one instant alone has told how a body drifts, taken for a steady drift

    def __post_init__(self) -> None:
        """Prepare the body."""
        self.body = Body(self.system)
        # (2N,) worth of rounding in displacements, as forces, in any states so far
        self.doubt = np.zeros(2 * self.body.n)

    def rounded(self, leg: Leg, here: States, force: Array, way: Array) -> float:
        """Return the first-order round-off of the work of reactions (2N,) on a way (2N,)."""
        reach = here.reach(here.row_errors(leg.noise))
        # both ends of the way may be off
        return float(2.0 * (np.abs(force) + leg.noise) @ reach + leg.noise @ np.abs(way))

    def object(self, place: str, what: str, size: float = 0.0, allowed: float = 0.0) -> None:
        """Note a contradiction."""
        self.found.append(f"{place}: {what}" + (f" by {size:.1e} > {allowed:.1e}" if size else ""))

    def check(
        self, place: str | Callable[[int], str], what: str, over: tuple[Array, Any, Any]
    ) -> None:
        """Object where a quantity is above what is allowed, or NaN.

        Args:
            place: where; for several instants, a function of their number.
            what: what is wrong then.
            over: the quantity by node, (n,), (2n,) or for several instants (k, n), what is allowed,
                and the nodes concerned.
        """
        fine = over[0] <= over[1]
        if np.all(fine | ~np.asarray(over[2])):
            return
        size = np.atleast_2d(np.asarray(over[0], float))
        excess = np.where(over[2] & ~fine, np.nan_to_num(size - over[1], nan=np.inf), -np.inf)
        j, i = np.unravel_index(int(np.argmax(excess)), size.shape)
        node, allowed = int(i) % self.body.n, np.broadcast_to(over[1], size.shape)[j, i]
        where = place if isinstance(place, str) else place(int(j))
        self.object(where, f"{what} (node {node})", float(size[j, i]), float(allowed))


def objections(system: Any, history: Any, record: Any, between: bool = True) -> list[str]:
    """Return what contradicts the laws in a record; nothing where it is right."""
    return replay(system, history, record, between).found


def replay(system: Any, history: Any, record: Any, between: bool = True) -> Replay:
    """Hold a record against the laws; cycles without samples at their turning points only.

    What happens between the kept instants is replayed too, if that is asked for.
    """
    from replay_exact import follow
    from replay_steps import step

    run, ends = Replay(system, history, record), record.turning_points
    body, n = run.body, run.body.n
    if ends.P.shape[1] != n:
        run.object("record", f"it has {ends.P.shape[1]} nodes, the system {n}")
        return run
    _check_places(run)
    u, state = np.zeros(2 * n, np.longdouble), np.where(body.g0 > 0.0, OPEN, STICK)
    force, noise = 0.0, np.zeros(2 * n)
    kept, all_totals = set(record.samples.cycle.tolist()), []
    legs = list(zip(ends.cycle.tolist(), ends.leg.tolist(), strict=True))
    for row, (cycle, number) in enumerate(legs):
        if number == 0:
            if cycle > 0 and record.limit is not None and cycle == record.limit.cycle:
                u, state = _limit_start(run, u, state)
            totals, start = Totals(np.zeros(n), np.zeros(n, dtype=bool)), (u, state)
        leg = _leg(run, (cycle, number), u, state, row, (force, noise))
        force, noise = leg.force, leg.noise
        if cycle in kept:
            if between:
                (follow if record.method == "events" else step)(run, leg, totals)
            _check_instants(run, leg, record.samples, leg.rows)
        _check_instants(run, leg, ends, np.array([row]))
        u = np.concatenate([ends.v[row], ends.w[row]]).astype(np.longdouble)
        state = ends.state[row].astype(int)
        if between and cycle in kept and (row + 1 == len(legs) or legs[row + 1][1] == 0):
            _check_cycle(run, leg, totals, start, (u, state))
            all_totals.append(totals)
    if len(all_totals) == len(set(ends.cycle.tolist())):
        _check_sums(run, all_totals)
    return run


def _limit_start(run: Replay, u: Array, state: Array) -> tuple[Array, Array]:
    """Return where the limit cycle starts: where it ends, less a rigid walk, after a jump."""
    record, ends = run.record, run.record.turning_points
    if not record.limit.jumped:
        return u, state
    slip, rigid = record.cycles.slip_increment[-1], run.system.rigid
    back = np.concatenate([slip, np.zeros(len(slip))])
    # of open nodes the record tells no slip: they move with the body
    known = np.concatenate([ends.state[-1] != OPEN, np.full(len(slip), True)])
    walk = rigid @ np.linalg.lstsq(rigid[known], back[known], rcond=None)[0]
    size = float(np.abs(walk - back)[known].max(initial=0.0))
    if size > LIMIT * float(np.abs([ends.v, ends.w]).max()):
        run.object("the limit", "its cycle does not repeat itself", size)
    back[~known] = walk[~known]
    return np.concatenate([ends.v[-1], ends.w[-1]]).astype(np.longdouble) - back, ends.state[-1]


def _leg(
    run: Replay, at: tuple[int, int], u: Array, state: Array, row: int, so_far: tuple[float, Array]
) -> Leg:
    """Return a leg with its scales: the largest force so far, the round-off of its largest u."""
    ends, samples, body = run.record.turning_points, run.record.samples, run.body
    line = run.history.path if at[0] == 0 else run.history.loop
    corners = line[at[1]], line[at[1] + 1]
    rows = np.flatnonzero((samples.cycle == at[0]) & (samples.leg == at[1]))
    force = max(so_far[0], HELD_SHARE * float(np.abs(np.array(corners) @ run.system.r_star).max()))
    noise = np.maximum(so_far[1], body.round_off(np.array(corners[0]), u))
    for table, kept in ((ends, [row]), (samples, rows)):
        for j in kept:
            at_j = np.concatenate([table.v[j], table.w[j]])
            # with the reactions of supports, which the record does not show
            r_j = table.load[j] @ run.system.r_star + run.system.K @ at_j
            force = max(force, float(np.abs(r_j).max(initial=0.0)))
            noise = np.maximum(noise, body.round_off(table.load[j], at_j))
    return Leg(*at, corners, u, state, row, rows, force, noise)


def _check_places(run: Replay) -> None:
    """Check that all loads are the history's, and that the turning points are its corners."""
    record, history = run.record, run.history
    for name in ("turning_points", "samples", "events"):
        table = getattr(record, name)
        for cycle, leg in sorted(set(zip(table.cycle.tolist(), table.leg.tolist(), strict=True))):
            line = history.path if cycle == 0 else history.loop
            here = (table.cycle == cycle) & (table.leg == leg)
            s = table.s[here][:, None]
            apart = np.abs(table.load[here] - ((1.0 - s) * line[leg] + s * line[leg + 1]))
            if not np.all((apart <= 8 * EPS * np.abs(line).max()) & (s >= 0.0) & (s <= 1.0)):
                place = f"cycle {cycle}, leg {leg}"
                run.object(place, f"a load of the {name} is not the history's")
    samples = record.samples
    sampled = np.stack([samples.cycle, samples.leg], axis=1)
    counts = np.unique(sampled, axis=0, return_counts=True)[1]
    if len(set(counts.tolist())) > 1:
        run.object("record", "some sampled legs have more samples than others")
    legs = [(0, leg) for leg in range(len(history.path) - 1)]
    loop = range(len(history.loop) - 1)
    legs += [(cycle, leg) for cycle in range(1, history.cycles + 1) for leg in loop]
    ends = record.turning_points
    found = list(zip(ends.cycle.tolist(), ends.leg.tolist(), strict=True))
    early = history.until_steady or (record.limit is not None and record.limit.reached)
    cut = len(found) < len(legs) and not early
    if found != legs[: len(found)] or cut or np.any(ends.s != 1.0):
        run.object("record", "its turning points are not the ends of the history's legs")


def _check_instants(run: Replay, leg: Leg, table: Any, rows: Array) -> None:
    """Check equilibrium, Signorini's and Coulomb's law at kept instants of a leg."""
    body, n = run.body, run.body.n
    k, weight = body.k[n:], run.system.weight
    error = LAW * leg.force + leg.noise
    e_t, e_n = error[:n], error[n:]
    cone, e_gap = body.cone_error(error), e_n + ROUNDINGS * EPS * k * body.g0 + run.doubt[n:]
    law, loose = ~body.carried, ~body.held[:n]
    u = np.concatenate([table.v[rows], table.w[rows]], axis=1).astype(np.longdouble)
    Q, P, state = table.Q[rows], table.P[rows], table.state[rows]
    r = table.load[rows].astype(np.longdouble) @ body.r_star + u @ body.K
    gap = (body.g0 + u[:, n:]) * k
    e_gap = np.tile(e_gap, (len(rows), 1))
    for j in np.flatnonzero((gap < -e_gap).any(axis=1)):
        # soft springs move by the round-off of forces
        here = body.states(state[j].astype(int))
        e_gap[j] += (k * here.reach(here.row_errors(leg.noise))[n:]).astype(float)
    out, touches = law & (state == OPEN), law & (state != OPEN)
    slip = np.where(state == FORWARD, 1.0, 0.0) - np.where(state == BACKWARD, 1.0, 0.0)
    off, slips = body.off_limit(Q, P, slip), body.rubs & (slip != 0.0)
    p_off, q_off = np.abs(table.p[rows] * weight - P), np.abs(table.q[rows] * weight - Q)
    for what, over in {
        "equilibrium fails": (np.abs(r - np.concatenate([Q, P], axis=1)), error, ~body.held),
        "a support's reaction is shown": (np.abs(np.hstack([Q, P])), 0.0, body.held),
        "a node is pulled": (-P, e_n, law),
        "a node penetrates": (-gap, e_gap, law),
        "an open node is pressed": (P, e_n, out),
        "an open node is sheared": (np.abs(Q), e_t, out & loose),
        "a touching node has a gap": (gap, e_gap, touches),
        "friction's limit is passed": (body.beyond(Q, P), cone, touches & loose),
        "a slipping node is off its limit": (off, cone, slips),
        "a free node is sheared": (np.abs(Q), e_t, body.carried & loose),
        "a held freedom moves": (np.abs(u), 0.0, body.held),
        "p is not P over weight": (p_off, 4 * EPS * np.abs(P), law),
        "q is not Q over weight": (q_off, 4 * EPS * np.abs(Q), law),
        "a state is none of the four": (np.abs(state - 2.5), 1.5, True),
    }.items():
        run.check(lambda j: leg.place(table.s[rows[j]]), what, over)


def _check_cycle(
    run: Replay, leg: Leg, totals: Totals, start: tuple[Array, Array], end: tuple[Array, Array]
) -> None:
    """Check the dissipation, the slip and the energy identity of a cycle that ends with a leg."""
    record, body, cycle, u_start, u = run.record, run.body, leg.cycle, start[0], end[0]
    name, largest = f"cycle {cycle}", float(np.abs(np.array([u_start, u])).max())
    if cycle > 0:
        touches = (start[1] != OPEN) & (end[1] != OPEN)
        slip = np.where(touches, (u - u_start)[: body.n], 0.0).astype(float)
        apart = np.abs(record.cycles.slip_increment[cycle - 1] - slip)
        run.check(name, "a slip increment is not v's", (apart, 4 * EPS * largest, True))
    if not totals.known:
        return
    stored = 0.5 * float((u - u_start) @ body.K @ (u + u_start))
    allowed = ENERGY * (totals.moved + abs(stored)) + totals.divided + totals.rounded
    # slips are as far off the record's as the displacements
    allowed += totals.misfit + LAW * leg.force * max(largest, totals.largest)
    first = record.dissipation_first_loading
    D = record.cycles.dissipation[cycle - 1] if cycle else first
    errors = {"dissipation is off": (D - float(totals.dissipation.sum()), allowed)}
    if cycle > 0:
        nodes = record.cycles.dissipation_density[cycle - 1] * run.system.weight
        off = nodes - totals.dissipation
        off[totals.adrift] = off[totals.adrift].sum()
        run.check(name, "dissipation is off", (np.abs(off), allowed, True))
    if record.method == "events":
        error = D + stored + totals.work + totals.released
        errors["the energy identity fails"] = error, allowed + totals.unsure + totals.misfit
    for what, (error, allowed) in errors.items():
        if not abs(error) <= allowed + RELEASED * abs(totals.released):
            run.object(name, what, abs(error), allowed)


def _check_sums(run: Replay, cycles: list[Totals]) -> None:
    """Check what a record says of the whole history; all its cycles have been replayed."""
    record = run.record
    if len(record.events.s) != record.n_events:
        run.object("record", f"counts {record.n_events} events, lists {len(record.events.s)}")
    if record.method != "events" or not all(cycle.known for cycle in cycles):
        return
    jumps, released = (sum(getattr(c, name) for c in cycles) for name in ("jumps", "released"))
    if not jumps <= record.jumps <= jumps + sum(c.hidden for c in cycles):
        run.object("record", f"counts {record.jumps} jumps, there are {jumps}")
    error = abs(released - record.released)
    allowed = RELEASED * sum(abs(c.released) for c in cycles) + sum(
        ENERGY * c.moved + c.unsure for c in cycles
    )
    if not error <= allowed:
        run.object("record", "released energy is off", error, allowed)
