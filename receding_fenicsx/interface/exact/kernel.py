"""The event loop of the exact path, compiled: from event to event along one leg.

:func:`follow` is steps 3 to 6 of :mod:`receding_fenicsx.interface.exact` in one loop. It stands at
a place s of a leg, with quantities y = [v, gap, A, B] and states, and repeats

1. the rates of the present states are looked up among those that have been met, or made by
   exchanges in the tableau (:func:`made`);
2. quantities on their limit that are driven across it change the states of their nodes, all at
   first, then the worst one (:func:`turned`);
3. the next event is the first quantity that falls to zero (:func:`looked`). Where these states have
   been left by an event before, that one is tried first: it is the next one if all margins and gaps
   stay positive up to it;
4. y, dissipation and work are carried there (:func:`advanced`), and its node changes state.

What it cannot do by itself it returns as a request, and goes on where it stopped once that has been
answered. Signs, states and exchanges are those of the modules that know them. What is called at
every event takes single arrays: of a named tuple each call copies all fields.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from inspect import getsource
from types import CellType, FunctionType
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from receding_fenicsx.arrays import Array, Ints
from receding_fenicsx.interface import law, tolerances
from receding_fenicsx.interface.exact import consistency, kernel_data, legs, pivot_matrix, tableau
from receding_fenicsx.interface.exact.kernel_data import (
    ASKED,
    BEGUN,
    CHOSEN,
    ENTRY,
    EVENTS,
    FIRST,
    GIVEN,
    HERE,
    HIT,
    ROUNDS,
    SAMPLES,
    STOPS,
    TIES,
    Contact,
    Memory,
    Path,
    Way,
)
from receding_fenicsx.interface.exact.legs import EVENTS_WITHOUT_PROGRESS
from receding_fenicsx.interface.exact.pivot_matrix import Matrix
from receding_fenicsx.interface.exact.tableau import A, B, V
from receding_fenicsx.interface.law import BACKWARD, FORWARD, SEPARATION, STICK
from receding_fenicsx.interface.tolerances import END_TOLERANCE, SIMULTANEOUS

F = TypeVar("F", bound=Callable[..., Any])

DONE, RATES, PENDING, MEMORY, ROOM, BALANCE, UNDECIDED, CHOICE, UNLOADING, ENDLESS = range(10)
"""What :func:`follow` returns: the end is reached; or what it asks for: rates in the present
states, pending updates of the tableau to be applied, a larger memory, room for more events,
round-off to be removed, a decision where states follow one another without end, a choice among
several continuations, whether unloading ends here; or that events follow one another without
progress."""

HALF_WAY = 0
"""State in the tableau of a node whose exchanges could be made by half only."""

SOURCES = tuple(
    sha256(getsource(module).encode()).hexdigest()
    for module in (consistency, kernel_data, legs, pivot_matrix, tableau, law, tolerances)
)
"""Other modules whose functions and constants are compiled into the machine code."""


def compiled(function: F) -> F:
    """Compile a function at its first call; keep the machine code on disk where that is allowed.

    Numba takes it from there while this file, and what the function encloses, are the same.
    """
    code = function.__code__.replace(co_freevars=("sources",))
    enclosing = FunctionType(code, function.__globals__, closure=(CellType(SOURCES),))
    enclosing.__doc__ = function.__doc__
    try:
        made: F = njit(cache=True, error_model="numpy", _nrt=False)(enclosing)
    except RuntimeError:  # neither the package nor the user's cache folder can be written
        made = njit(error_model="numpy", _nrt=False)(enclosing)
    return made


state_after = compiled(consistency.state_after)


@compiled
def exchanged(matrix: Matrix, out: int, into: int) -> int:
    """Exchange an output with an input; return DONE, or RATES where it is singular or left out.

    Room for one more pending update is the caller's concern.
    """
    T, U, V, row_of, column_of = matrix.T, matrix.U, matrix.V, matrix.row_of, matrix.column_of
    i, j, k = row_of[out], column_of[into], matrix.counts[0]
    if j < 0:
        return RATES
    column, row = U[k], V[k]
    for a in range(len(column)):
        column[a] = T[a, j]
    for b in range(len(row)):
        row[b] = T[i, b]
    for past in range(k):
        on_column, on_row = V[past, j], U[past, i]
        for a in range(len(column)):
            column[a] += on_column * U[past, a]
        for b in range(len(row)):
            row[b] += on_row * V[past, b]
    pivot = row[j]
    if abs(pivot) <= matrix.singular:
        return RATES
    column[i] += 1.0
    row[j] -= 1.0
    scale, rate, now = -1.0 / pivot, matrix.rate, matrix.rate[i]
    for a in range(len(column)):
        column[a] *= scale
        rate[a] += now * column[a]
    matrix.row_label[i], matrix.column_label[j] = into, out
    row_of[into], row_of[out] = i, -1
    column_of[out], column_of[into] = j, -1
    matrix.counts[0] += 1
    matrix.counts[1] += 1
    return DONE


@compiled
def carried_to(contact: Contact, matrix: Matrix, state: NDArray[np.int8]) -> int:
    """Bring the tableau to the given states by single exchanges; return DONE or a request."""
    n = len(state)
    for i in range(n):
        old, new = matrix.state[i], state[i]
        if old == new or not (contact.frictional[i] or contact.smooth[i]):
            continue
        kinds = contact.exchanges[1 if contact.frictional[i] else 0, old, new]
        # both exchanges of a node, or none
        if matrix.counts[0] + 2 > len(matrix.U):
            return PENDING
        if matrix.counts[1] > matrix.oldest:
            return RATES
        for pair in range(2):
            if kinds[2 * pair] >= 0:
                request = exchanged(matrix, kinds[2 * pair] * n + i, kinds[2 * pair + 1] * n + i)
                if request != DONE:
                    if pair:
                        matrix.state[i] = HALF_WAY
                    return request
        matrix.state[i] = new
    return DONE


@compiled
def found(memory: Memory, mark: np.uint64, state: NDArray[np.int8]) -> int:
    """Return the entry of a set of states; -1 - its place in the table where there is none."""
    last = len(memory.table) - 1
    place = np.int64(mark & np.uint64(last))
    while True:
        entry = memory.table[place]
        if entry < 0:
            return int(-1 - place)
        if memory.mark[entry] == mark:
            same = True
            for i in range(len(state)):
                same &= memory.state[entry, i] == state[i]
            if same:
                return int(entry)
        place = (place + 1) & last


@compiled
def reversed_slips(
    state: NDArray[np.int8], q: Array, weight: Array, threshold: float, violated: Ints
) -> int:
    """Note the slipping nodes whose rate contradicts their state; return their number."""
    against = 0
    for i in range(len(state)):
        slip = q[i] * weight[i]
        if (state[i] == FORWARD and slip < -threshold) or (
            state[i] == BACKWARD and slip > threshold
        ):
            violated[i] |= 1 << V
            against += 1
    return against


@compiled
def filled(contact: Contact, memory: Memory, way: Way, path: Path) -> bool:
    """Complete the next free entry, its rates given; return whether these are in balance."""
    state, n, entry = path.state, len(path.state), memory.used[0]
    q, weight = memory.rates[entry], contact.weight
    displacements = forces = 0.0
    for a in range(2 * n):
        displacements += (q[a] * weight[a]) ** 2
    for a in range(2 * n, 4 * n):
        forces += (q[a] * weight[a]) ** 2
    size = np.sqrt(displacements + forces)
    threshold = contact.rate_tolerance * size
    worst = 0.0
    for k in range(len(contact.sums_of_y)):
        error = 0.0
        for a in range(4 * n):
            error += contact.sums_of_y[k, a] * q[a]
        for load in range(len(way.direction)):
            error += contact.sums_of_load[k, load] * way.direction[load]
        memory.imbalance[entry, k] = error
        worst = max(worst, abs(error))
    for load in range(len(way.direction)):
        stroke = 0.0
        for a in range(2 * n):
            stroke += contact.r_star[load, a] * q[a]
        memory.stroke[entry, load] = stroke
    resting = 0
    for i in range(n):
        if contact.frictional[i] and state[i] == STICK:
            resting += 1
        elif contact.frictional[i] or contact.smooth[i]:
            resting += 2  # a smooth node has no B
    memory.resting[entry] = resting
    memory.threshold[entry] = threshold
    memory.reversed_nodes[entry] = reversed_slips(state, q, weight, threshold, path.violated)
    memory.hit[entry] = -1
    for i in range(n):
        memory.state[entry, i] = state[i]
    of_all, of_forces = contact.imbalances
    return bool(worst <= max(of_all * size, of_forces * np.sqrt(forces)))


@compiled
def kept(memory: Memory, mark: np.uint64, state: NDArray[np.int8]) -> None:
    """Keep the entry that has been completed last."""
    entry = memory.used[0]
    memory.mark[entry] = mark
    memory.table[-1 - found(memory, mark, state)] = entry
    memory.used[0] += 1


@compiled
def made(
    contact: Contact, matrix: Matrix, memory: Memory, way: Way, path: Path, mark: np.uint64
) -> int:
    """Make the rates of the present states, the next entry of the memory, or return a request.

    Where the loads turn back the rates do so too.
    """
    n, entry = len(path.state), memory.used[0]
    if entry == len(memory.rates):
        return MEMORY
    if way.asks_rates:
        return RATES
    q = memory.rates[entry]
    back = found(memory, mark ^ way.mark ^ way.back, path.state)
    if back >= 0:
        for a in range(4 * n):
            q[a] = 0.0 - memory.rates[back, a]
    else:
        T, columns, rate = matrix.T, len(matrix.column_label), matrix.rate
        if matrix.counts[2] == 0:
            for a in range(len(rate)):
                rate[a] = 0.0
                for load in range(len(way.direction)):
                    rate[a] += T[a, columns + load] * way.direction[load]
            for past in range(matrix.counts[0]):
                moved = 0.0
                for load in range(len(way.direction)):
                    moved += matrix.V[past, columns + load] * way.direction[load]
                for a in range(len(rate)):
                    rate[a] += moved * matrix.U[past, a]
            matrix.counts[2] = 1
        request = carried_to(contact, matrix, path.state)
        if request != DONE:
            return request
        for a in range(4 * n):
            q[a] = 0.0
        for a in range(len(rate)):
            label = matrix.row_label[a]
            if label < 2 * n:
                q[label] = rate[a] / matrix.unit
            elif label < 4 * n:
                q[label] = rate[a]
    if not filled(contact, memory, way, path):
        return RATES
    kept(memory, mark, path.state)
    return DONE


@compiled
def passed(y: Array, q: Array, h: float, hit: int) -> bool:
    """Return whether a margin or gap, that of the event at h left out, is below zero after h."""
    n, below = len(y) // 4, 0
    # views from 0 on are compiled to vector instructions
    limited, rates = y[n:], q[n:]
    for a in range(len(limited)):
        below += limited[a] + h * rates[a] < 0.0
    if hit >= 0:
        below -= y[hit] + h * q[hit] < 0.0
    return below > 0


@compiled
def looked(
    y: Array, q: Array, weight: Array, on_limit: Array, threshold: float, violated: Ints
) -> tuple[int, float, int]:
    """Look at gaps and margins; note those on their limit that are driven across it.

    Returns:
        Label of the first to reach zero, -1 for none, the way to there, the number of violations.
    """
    n, label, first, violations = len(violated), -1, np.inf, 0
    for i in range(n):
        violated[i] = 0
    for a in range(n, 4 * n):
        if q[a] * weight[a] < -threshold:
            time = -y[a] / q[a]
            if time < first:
                label, first = a, time
            if y[a] <= on_limit[a]:
                violated[a % n] |= 1 << (a // n)
                violations += 1
    return label, first, violations


@compiled
def put_in(rows: Ints, k: int, count: int, first: int, second: int, third: int) -> None:
    """Put a row before row k of the first ``count`` ones."""
    for later in range(count, k, -1):
        for part in range(3):
            rows[later, part] = rows[later - 1, part]
    rows[k, 0], rows[k, 1], rows[k, 2] = first, second, third


@compiled
def noted(event: Ints, first: int, last: int, i: int, old: int, new: int) -> int:
    """Note a change of state among the events of an instant: the net change of each node, by node.

    Returns:
        Number of events after it; the state that is undone is left beyond the last one.
    """
    k = first
    while k < last and event[k, 0] < i:
        k += 1
    if k == last or event[k, 0] != i:
        put_in(event, k, last, i, old, new)
        return last + 1
    undone = event[k, 2]
    event[k, 2] = new
    if event[k, 1] != new:
        return last
    for later in range(k, last - 1):
        for part in range(3):
            event[later, part] = event[later + 1, part]
    event[last - 1, 0], event[last - 1, 1], event[last - 1, 2] = i, new, undone
    return last - 1


@compiled
def drop(y: Array, on: Array, label: int, sums_of_y: Array, imbalance: Array) -> None:
    """Set a quantity to zero; where it was not on its limit, what it was is imbalance."""
    left = y[label]
    y[label] = 0.0
    if left > on[label]:
        for k in range(len(imbalance)):
            imbalance[k] -= sums_of_y[k, label] * left


@compiled
def put(contact: Contact, way: Way, path: Path, i: int, new: int, mark: np.uint64) -> np.uint64:
    """Change the state of a node; what the new one fixes is zero. Return the new hash."""
    y, on, old, n = path.y, way.on_limit, path.state[i], len(path.state)
    a, b = A * n + i, B * n + i
    if new == SEPARATION or y[a] <= on[a]:
        drop(y, on, a, contact.sums_of_y, path.imbalance)
    if new == SEPARATION or y[b] <= on[b]:
        drop(y, on, b, contact.sums_of_y, path.imbalance)
    path.state[i] = new
    count, last = path.counts, path.counts[EVENTS]
    count[EVENTS] = noted(path.event, count[FIRST], last, i, old, new)
    if count[EVENTS] > last:
        path.event_at[last] = path.place[0]
    elif count[EVENTS] < last:  # it might have gone the other way all the same
        tie = count[TIES]
        path.tie_at[tie] = path.place[0]
        copied(path.tie[tie], path.event[last - 1])
        count[TIES] += 1
    return mark ^ contact.marks[i, old] ^ contact.marks[i, new]


@compiled
def turned(
    contact: Contact, memory: Memory, way: Way, path: Path, entry: int, mark: np.uint64
) -> np.uint64:
    """Change the states of the nodes whose quantities are violated; return the new hash.

    All of them in the first rounds, later the one with the largest rate.
    """
    n, q, weight, worst = len(path.state), memory.rates[entry], contact.weight, -1
    if path.counts[ROUNDS] > consistency.SIMULTANEOUS_ROUNDS:
        largest, kind = 0.0, 0
        for i in range(n):
            for k in range(4):
                if path.violated[i] & 1 << k and abs(q[k * n + i]) * weight[k * n + i] > largest:
                    largest, worst, kind = abs(q[k * n + i]) * weight[k * n + i], i, k
        if worst >= 0:
            path.violated[worst] = 1 << kind
    for i in range(n):
        if path.violated[i] and (worst < 0 or i == worst):
            new = state_after(path.state[i], path.violated[i], contact.frictional[i], 0.0)
            mark = put(contact, way, path, i, new, mark)
    return mark


@compiled
def slid(dissipation: Array, y: Array, q: Array, share: tuple[Array, Array], ds: float) -> None:
    """Add the dissipation of each node on a way ds."""
    n, (share_A, share_B) = len(y) // 4, share
    margin_A, margin_B, rate_A, rate_B = y[2 * n : 3 * n], y[3 * n :], q[2 * n : 3 * n], q[3 * n :]
    for i in range(n):
        Q = share_A[i] * margin_A[i] - share_B[i] * margin_B[i]
        rate = share_A[i] * rate_A[i] - share_B[i] * rate_B[i]
        dissipation[i] -= (Q + 0.5 * ds * rate) * (ds * q[i])


@compiled
def copied(target: NDArray[Any], source: NDArray[Any]) -> None:
    """Copy one array into another."""
    for a in range(len(source)):
        target[a] = source[a]


@compiled
def carried(y: Array, q: Array, ds: float) -> None:
    """Carry quantities on by ds."""
    for a in range(len(y)):
        y[a] += ds * q[a]


@compiled
def advanced(contact: Contact, memory: Memory, way: Way, path: Path, entry: int, ds: float) -> None:
    """Carry quantities, dissipation, work and imbalance on by ds."""
    q, middle = memory.rates[entry], path.place[0] + 0.5 * ds
    slid(path.dissipation, path.y, q, (contact.share_A, contact.share_B), ds)
    carried(path.y, q, ds)
    for load in range(len(path.work)):
        factor = way.start[load] + middle * way.direction[load]
        path.work[load] += ds * memory.stroke[entry, load] * factor
    carried(path.imbalance, memory.imbalance[entry], ds)


@compiled
def sampled(memory: Memory, way: Way, path: Path, entry: int, s_to: float) -> None:
    """Store the samples up to a place."""
    k = path.counts[SAMPLES]
    while k < len(way.sample_at) and way.sample_at[k] <= s_to:
        copied(path.sample[k], path.y)
        carried(path.sample[k], memory.rates[entry], way.sample_at[k] - path.place[0])
        copied(path.sample_state[k], path.state)
        k += 1
    path.counts[SAMPLES] = k


@compiled
def stopped(path: Path, label: int, q: Array) -> None:
    """Note a stop: its quantities, and where the path is traced how it has come there."""
    k = path.counts[STOPS]
    path.stop_at[k] = path.place[0]
    for a in range(len(q)):
        path.stop[k, a] = path.y[a]
    if len(path.stop_label):
        path.stop_label[k] = label
        for i in range(len(path.state)):
            path.stop_state[k, i] = path.state[i]
        for a in range(len(q)):
            path.stop_rate[k, a] = q[a]
    path.counts[STOPS] += 1


@compiled
def on_limits(y: Array, on: Array) -> int:
    """Return the number of gaps and margins on their limit."""
    n, count = len(y) // 4, 0
    limited, up_to = y[n:], on[n:]
    for a in range(len(limited)):
        count += limited[a] <= up_to[a]
    return count


@compiled
def reach(y: Array, weight: Array) -> float:
    """Return the largest displacement, as a force."""
    largest = 0.0
    for a in range(len(y) // 2):
        largest = max(largest, abs(y[a]) * weight[a])
    return largest


@compiled
def tied(contact: Contact, way: Way, path: Path, hit: int) -> None:
    """Note nodes on a limit besides the one that has reached its own, see ``segments.tied``."""
    n, y, on, state = len(path.state), path.y, way.on_limit, path.state
    for i in range(n):
        on_A, on_B = y[A * n + i] <= on[A * n + i], y[B * n + i] <= on[B * n + i]
        opened, stuck = state[i] == SEPARATION, state[i] == STICK
        touches = y[n + i] <= on[n + i] if opened else on_A and on_B
        if not (touches or (stuck and (on_A or on_B) and contact.frictional[i])):
            continue
        # the change of the one that has reached its limit is an event
        if not (contact.frictional[i] or contact.smooth[i]) or (
            i == hit and not (stuck and touches)
        ):
            continue
        k = path.counts[TIES]
        path.tie_at[k] = path.place[0]
        path.tie[k, 0], path.tie[k, 1] = i, state[i]
        path.tie[k, 2] = SEPARATION if touches else FORWARD if on_A else BACKWARD
        path.counts[TIES] += 1


@compiled
def follow(contact: Contact, matrix: Matrix, memory: Memory, way: Way, path: Path) -> int:
    """Follow a leg up to its end; return DONE or a request."""
    n, y, state, count = len(path.state), path.y, path.state, path.counts
    mark = way.mark
    for i in range(n):
        mark ^= contact.marks[i, state[i]]
    if not count[BEGUN]:
        tied(contact, way, path, -1)
        count[BEGUN] = 1
    while True:
        most = max(count[EVENTS], count[TIES], count[STOPS])
        if most + 2 * n > len(path.event_at):
            return ROOM
        given, label = count[GIVEN] > 0, -1
        entry = count[GIVEN] - 1 if given else found(memory, mark, state)
        if entry < 0:
            request = made(contact, matrix, memory, way, path, mark)
            if request != DONE:
                return request
            entry = found(memory, mark, state)
        if not given:
            label = memory.hit[entry]
        count[ENTRY] = entry
        q, s = memory.rates[entry], path.place[0]
        left, first = way.end - s, np.inf
        if label >= 0:
            first = -y[label] / q[label]
        if (
            given
            or way.asks_choice
            or memory.reversed_nodes[entry]
            or not first >= SIMULTANEOUS
            or passed(y, q, min(first, left), label if first < left else -1)
        ):
            threshold, weight, violated = memory.threshold[entry], contact.weight, path.violated
            label, first, violations = looked(y, q, weight, way.on_limit, threshold, violated)
            if memory.reversed_nodes[entry]:
                violations += reversed_slips(state, q, weight, threshold, violated)
            if violations and not given:
                count[ROUNDS] += 1
                if count[ROUNDS] > n + consistency.SIMULTANEOUS_ROUNDS:
                    return UNDECIDED
                mark = turned(contact, memory, way, path, entry, mark)
                continue
            if way.asks_choice and not count[CHOSEN]:
                return CHOICE
        for k in range(len(path.imbalance)):
            if abs(path.imbalance[k]) > path.place[3]:
                return BALANCE
        ends = first >= left - END_TOLERANCE
        if not ends and left - first <= way.unloading and not count[ASKED]:
            path.place[2] = first
            return UNLOADING
        ds = left if ends else max(first, 0.0)
        sampled(memory, way, path, entry, way.end if ends else s + ds)
        advanced(contact, memory, way, path, entry, ds)
        path.place[0] = way.end if ends else s + ds
        if not given:
            memory.hit[entry] = -1 if ends else label
        if len(path.stop_label) or (len(path.stop_at) and not ends):
            stopped(path, -1 if ends else label, q)
        if ends:
            return DONE
        if path.place[0] - path.place[1] > SIMULTANEOUS:
            path.place[1], count[HERE] = path.place[0], 0
        count[HERE] += 1
        if count[HERE] > EVENTS_WITHOUT_PROGRESS * n:
            return ENDLESS
        i, kind = label % n, label // n
        if on_limits(y, way.on_limit) != memory.resting[entry] + 1:
            tied(contact, way, path, i)
        count[FIRST], count[HIT], count[ROUNDS], count[GIVEN] = count[EVENTS], label, 0, 0
        count[CHOSEN] = count[ASKED] = 0
        y[label] = 0.0
        if path.place[3] > way.accepted and reach(y, contact.weight) < 0.1 * path.place[4]:
            # the round-off of far larger displacements before is none here
            path.place[3] = way.accepted
        new = state_after(state[i], 1 << kind, contact.frictional[i], q[i])
        mark = put(contact, way, path, i, new, mark)
