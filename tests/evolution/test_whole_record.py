"""Every array of a record recomputed from the displacements of the modelled nodes by other code."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from equations import BACKWARD, FORWARD, OPEN
from problems import FAMILIES, Problem, play, problem
from replay import objections

import receding_fenicsx as rf
from receding_fenicsx.interface.system import ProbeMatrix, eliminate_tangential

pytestmark = pytest.mark.one_rank

SWAPPED = np.array([0, 1, OPEN, BACKWARD, FORWARD])
"""State of the mirror image of a node."""


def dressed(number: int) -> Problem | None:
    """Return a random problem with all that a contact may carry; None for a nearly singular one.

    Unequal weights, one or two edges, conjugate displacements, probes, and friction that differs in
    the two directions. Where the first node is held tangentially it lies at x = 0.
    """
    p = FAMILIES[("plain", "directed")[number % 2]](problem(number))
    if "near-singular" in p.tags:
        return None
    rng, s = np.random.default_rng([number, 11]), p.system
    n, loads = s.n, len(s.load_names)
    edge = np.arange(n) // (n if number % 3 else max(1, n // 2))
    x = np.sort(rng.uniform(0.2, 3.0, n))
    held = s.held.copy()
    held[0] |= number % 4 == 0 and s.rigid.shape[1] == 0
    x[0] *= not held[0]
    C = rng.standard_normal((loads, loads))
    names = ("a", "b", "a")
    system = replace(
        s,
        x=x,
        held=held,
        points=np.column_stack([x, rng.standard_normal(n)]),
        weight=rng.uniform(0.5, 2.0, n),
        edge=edge,
        edge_names=("one", "two", "three")[: edge[-1] + 1],
        load_compliance=C + C.T,
        load_sign=rng.choice([-1.0, 1.0], loads),
        probes=ProbeMatrix(
            names, rng.standard_normal((3, 2)), rng.standard_normal((3, 6, 2 * n + loads))
        ),
    )
    return replace(p, system=system)


def played(number: int) -> tuple[Problem, rf.Record] | None:
    p = dressed(number)
    try:
        return None if p is None else (p, play(p))
    except rf.SolveError:
        return None


def near(found: Any, wanted: Any, size: float = 0.0) -> bool:
    """Whether arrays agree to round-off of the largest, or of a size."""
    found, wanted = np.asarray(found, float), np.asarray(wanted, float)
    assert found.shape == wanted.shape
    scale = max(np.abs(wanted).max(initial=0.0), size)
    return bool(np.abs(found - wanted).max(initial=0.0) <= 1e-9 * scale)


NUMBERS = range(5000, 5036)


def test_a_record_is_what_follows_from_its_displacements() -> None:
    seen: set[str] = set()
    for number in NUMBERS:
        if (pair := played(number)) is None:
            continue
        (p, record), s = pair, pair[0].system
        seen |= {record.method, record.steady.kind}
        # reactions, tractions, states, events, dissipation, slips, jumps and sums of the whole
        assert objections(s, p.history, record) == [], number
        for name in ("x", "points", "weight", "g0", "f", "edge"):
            assert np.array_equal(getattr(record, name), getattr(s, name)), name
        assert (record.edge_names, record.load_names) == (s.edge_names, s.load_names)
        both = None if s.f_backward is None else s.f_backward.tolist()
        assert (None if record.f_backward is None else record.f_backward.tolist()) == both
        held = s.held[: s.n]
        assert (record.held is not None) == held.any()
        assert record.held is None or np.array_equal(record.held, held)
        assert (record.modelled_nodes, record.modelled_dofs) == (s.n, np.sum(~s.held))
        assert np.array_equal(record.load_sign, s.load_sign) and record.scene_toml == ""
        assert (record.method, record.half) == (p.solver.method, False)
        assert (record.sweeps > 0) == (record.method == "gauss-seidel")
        assert 0.0 <= record.residual_max < 1e-9 and record.limit is record.doubling is None
        for part in (record.turning_points, record.samples):
            u = np.hstack([part.v, part.w])
            moved = part.load @ s.load_compliance.T + s.load_sign * (u @ s.r_star.T)
            assert near(part.load_displacement, moved, np.abs(u).max(initial=0.0)), number
        cycles, ends = record.cycles, record.turning_points
        assert near(cycles.dissipation, cycles.dissipation_density @ s.weight, 1e-6)
        # change of the reactions, those of supports too, over the last cycle
        last = [np.flatnonzero(ends.cycle == c)[-1] for c in range(len(cycles.dissipation) + 1)]
        every = ends.load @ s.r_star + np.hstack([ends.v, ends.w]) @ s.K
        r, open_ = every[last], 1e-2 * np.abs(ends.load @ s.r_star).max()
        for c, change in enumerate(record.steady.change, 1):
            size = np.abs(r[c]).max()
            if size > 1e-2 * max(np.abs(every).max(), open_):
                assert change == pytest.approx(np.abs(r[c] - r[c - 1]).max() / size, abs=1e-9)
        assert record.steady.reached == (record.steady.kind != "not reached")
        _check_probes(s, record)
    assert {"events", "gauss-seidel", "cyclic slip", "shakedown", "not reached"} <= seen


def _check_probes(s: rf.ContactSystem, record: rf.Record) -> None:
    """Check the histories of probes: their instants, and rows @ [v; w; lambda] at each."""
    tables: tuple[Any, ...] = (record.turning_points, record.samples, record.events)
    wanted: dict[tuple[int, int, float], int] = {}
    for kind, part in enumerate(tables):
        for place in zip(part.cycle.tolist(), part.leg.tolist(), part.s.tolist(), strict=True):
            wanted.setdefault(place, kind)
    probes = record.probes
    assert probes is not None and s.probes is not None
    columns = probes.cycle.tolist(), probes.leg.tolist(), probes.s.tolist()
    places = list(zip(*columns, strict=True))
    assert places == sorted(wanted) and probes.kind.tolist() == [wanted[at] for at in places]
    for kind, part in enumerate(tables[:2]):
        rows = [places.index(at) for at in zip(part.cycle, part.leg, part.s, strict=True)]
        values = np.hstack([part.v, part.w, part.load]) @ s.probes.rows.transpose(0, 2, 1)
        found = np.concatenate([probes.displacement[rows], probes.stress[rows]], axis=2)
        mine = probes.kind[rows] == kind
        assert near(found[mine], values.transpose(1, 0, 2)[mine])
        assert np.array_equal(probes.load[rows], part.load)
    at_rest = (probes.cycle == 0) & (probes.leg == 0) & (probes.s == 0.0)
    assert not probes.displacement[at_rest].any() and not probes.stress[at_rest].any()
    assert record.probe("a").points.tolist() == s.probes.points[[0, 2]].tolist()
    assert np.array_equal(record.probe("b").stress[:, 0], probes.stress[:, 1])


def test_a_probe_at_an_event_is_that_of_a_path_that_ends_there() -> None:
    compared = 0
    for number in NUMBERS:
        if (pair := played(number)) is None or pair[0].solver.method != "events":
            continue
        (p, record), e = pair, pair[1].events
        for j in np.flatnonzero((e.cycle == 0) & (e.s > 1e-6) & (e.s < 1.0 - 1e-6))[::5]:
            if record.jumps:
                continue
            path = np.vstack([p.history.path[: e.leg[j] + 1], e.load[j]])
            short = play(replace(p, history=replace(p.history, path=path, loop=path[:0], cycles=0)))
            a, b = record.probes, short.probes
            assert a is not None and b is not None
            k = int(np.flatnonzero((a.cycle == 0) & (a.leg == e.leg[j]) & (a.s == e.s[j]))[-1])
            assert near(a.stress[k], b.stress[-1], np.abs(a.stress).max()), number
            compared += a.kind[k] == 2
    assert compared > 5


def test_without_friction_tangential_displacements_may_be_eliminated() -> None:
    compared = 0
    for number in NUMBERS:
        p = dressed(number)
        if p is None or p.system.rigid.size:
            continue
        s = replace(p.system, f=0.0 * p.system.f, f_backward=None)
        try:
            models = (s, eliminate_tangential(s))
            full, small = (play(replace(p, system=model)) for model in models)
        except rf.SolveError:
            continue
        compared, size = compared + 1, np.abs(full.turning_points.v).max()
        assert small.modelled_dofs == np.sum(~s.held[s.n :])
        for name in ("turning_points", "samples"):
            a, b = getattr(full, name), getattr(small, name)
            assert not b.Q.any()
            for key in ("P", "p", "v", "w", "load_displacement"):
                assert near(getattr(b, key), getattr(a, key), size), (number, key)
        kept = [record.probes for record in (full, small) if record.probes is not None]
        kinds = [probes.kind < 2 for probes in kept]
        a, b = (probes.stress[kind] for probes, kind in zip(kept, kinds, strict=True))
        assert near(b, a)
    assert compared > 5


def image_of(s: rf.ContactSystem) -> tuple[np.ndarray, np.ndarray]:
    """Return the modelled node behind each node of the whole of a half, and its side, 1 or -1."""
    index, sign = [], []
    for k in dict.fromkeys(s.edges.tolist()):
        own = [i for i in range(s.n) if s.edges[i] == k]
        left = [i for i in own[::-1] if s.x[i] > 0.0]
        index += [*left, *own]
        sign += [-1] * len(left) + [1] * len(own)
    return np.array(index), np.array(sign)


@pytest.mark.parametrize("kind", ["half", "axisymmetric"])
def test_the_whole_of_a_half_or_a_radian_is_reflected_or_turned(kind: str) -> None:
    held = 0
    for number in NUMBERS:
        if (pair := played(number)) is None:
            continue
        (p, one), s = pair, pair[0].system
        model = replace(s, half=kind == "half", axisymmetric=kind != "half")
        whole = play(replace(p, system=model))
        held += bool(s.held[0])
        if kind == "half":
            index, sign = image_of(s)
            times = np.where(s.x[index] == 0.0, 2.0, 1.0)
            factor, side = 2.0, sign * (s.x[index] > 0.0)
        else:
            index, sign = np.arange(s.n), np.ones(s.n, dtype=int)
            side, times, factor = sign, np.full(s.n, 2.0 * np.pi), 2.0 * np.pi
        assert np.array_equal(whole.x, sign * s.x[index])
        assert np.array_equal(whole.points, s.points[index] * np.column_stack([sign, sign * sign]))
        assert near(whole.weight, times * s.weight[index])
        assert np.array_equal(whole.g0, s.g0[index]) and np.array_equal(whole.edge, s.edges[index])
        friction = s.friction
        for found, (ahead, back) in (
            (whole.friction.forward, (friction.forward, friction.backward)),
            (whole.friction.backward, (friction.backward, friction.forward)),
        ):
            assert np.array_equal(found, np.where(sign > 0, ahead[index], back[index]))
        off_axis = s.x[index] > 0.0 if kind == "half" else np.ones(s.n, dtype=bool)
        held_there = s.held[: s.n][index] & off_axis
        assert (whole.held is None) == (not held_there.any())
        assert whole.held is None or np.array_equal(whole.held, held_there)
        assert (whole.modelled_nodes, whole.modelled_dofs) == (s.n, np.sum(~s.held))
        for name in ("turning_points", "samples"):
            a, b = getattr(one, name), getattr(whole, name)
            for key in ("cycle", "leg", "s", "load"):
                assert np.array_equal(getattr(a, key), getattr(b, key)), key
            turned = np.where(sign > 0, a.state[:, index], SWAPPED[a.state[:, index]])
            assert np.array_equal(turned, b.state)
            for key, factors in (
                ("P", times), ("Q", side * times), ("v", side), ("w", 1.0), ("p", 1.0),
                ("q", side),
            ):  # fmt: skip
                assert near(getattr(b, key), factors * getattr(a, key)[:, index]), (number, key)
            assert near(b.load_displacement, factor * a.load_displacement)
        for key, factors in (("dissipation_density", 1.0), ("slip_increment", side)):
            a, b = getattr(one.cycles, key), getattr(whole.cycles, key)
            assert near(b, factors * a[:, index]), key
        assert near(whole.cycles.dissipation, factor * one.cycles.dissipation)
        for key in ("dissipation_first_loading", "released"):
            assert near(getattr(whole, key), factor * getattr(one, key)), key
        assert (whole.jumps, whole.steady.kind) == (one.jumps, one.steady.kind)
        assert whole.energy_error_max == one.energy_error_max
        _check_events(one, whole, index, sign)
        unique, alone = whole.uniqueness, one.uniqueness
        assert unique is not None and alone is not None
        images = np.flatnonzero(np.isin(index, alone.nodes))
        assert np.array_equal(unique.nodes, images)
        for key in ("certified", "solutions", "cycle", "leg", "s", "first_loading"):
            assert getattr(unique, key) == getattr(alone, key), key
    assert held > 1


def _check_events(one: rf.Record, whole: rf.Record, index: np.ndarray, sign: np.ndarray) -> None:
    """Check that each event happens at all images of its node, with turned directions."""
    rows = []
    for j, node in enumerate(one.events.node.tolist()):
        for k in np.flatnonzero(index == node):
            change = one.events.old[j], one.events.new[j]
            turned = change if sign[k] > 0 else SWAPPED[list(change)]
            rows.append((j, int(k), *map(int, turned)))
    e = whole.events
    assert [row[1:] for row in rows] == list(zip(e.node, e.old, e.new, strict=True))
    for key in ("cycle", "leg", "s", "load"):
        assert np.array_equal(getattr(e, key), getattr(one.events, key)[[row[0] for row in rows]])
    assert whole.n_events == len(e.s)


def test_the_record_of_an_edge_is_that_of_its_nodes() -> None:
    several = 0
    for number in NUMBERS:
        if (pair := played(number)) is None or len(set(pair[1].edge.tolist())) < 2:
            continue
        record = pair[1]
        several += 1
        for k, (name, part) in enumerate(record.by_edge().items()):
            nodes = np.flatnonzero(record.edge == k)
            assert name == record.edge_names[k]
            for table in ("turning_points", "samples", "cycles"):
                for f in fields(getattr(part, table)):
                    mine = getattr(getattr(part, table), f.name)
                    all_ = getattr(getattr(record, table), f.name)
                    shared = f.name in ("cycle", "leg", "s", "load", "load_displacement")
                    shared |= f.name == "dissipation"
                    assert np.array_equal(mine, all_ if shared else all_[:, nodes]), f.name
            for key in ("x", "points", "f", "g0", "weight", "edge", "f_backward", "held"):
                all_ = getattr(record, key)
                mine = getattr(part, key)
                assert (all_ is None and mine is None) or np.array_equal(mine, all_[nodes]), key
            here = np.isin(record.events.node, nodes)
            assert np.array_equal(nodes[part.events.node], record.events.node[here])
            assert np.array_equal(part.events.new, record.events.new[here])
    assert several > 3
