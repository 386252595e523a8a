"""Every array of a record recomputed from the displacements of the modelled nodes by other code."""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from dataclasses import fields, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from problems import FAMILIES, Problem, play, problem
from replay import objections
from small import assert_same_bits, small_system, table

import receding_fenicsx as rf
from receding_fenicsx.evolution.moment import Moment, moment_of
from receding_fenicsx.interface.system import ProbeMatrix, eliminate_tangential

pytestmark = [pytest.mark.one_rank, pytest.mark.once]


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
        scene_toml="that of another path",
        load_compliance=C + C.T,
        load_sign=rng.choice([-1.0, 1.0], loads),
        probes=ProbeMatrix(
            names, rng.standard_normal((3, 2)), rng.standard_normal((3, 6, 2 * n + loads))
        ),
    )
    return replace(p, system=system)


@cache
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


NUMBERS, TABLES = range(5000, 5036), ("turning_points", "samples", "cycles", "events")


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


def test_a_record_shares_nothing_with_what_it_was_made_from() -> None:
    for number, pair in zip(NUMBERS[:9], map(played, NUMBERS), strict=False):
        if pair is not None:
            p = deepcopy(pair[0])
            record = play(p)
            for part in (p.system, p.system.probes, p.history):
                for array in vars(part).values():
                    if isinstance(array, np.ndarray):
                        array[...] = 7
            assert_same_bits(record, pair[1], str(number))


def _check_probes(s: rf.ContactSystem, record: rf.Record) -> None:
    """Check the histories of probes: their instants, and rows @ [v; w; lambda] at each."""
    tables: tuple[Any, ...] = (record.turning_points, record.samples, record.events)
    wanted: dict[tuple[int, int, float], int] = {}
    for kind, part in enumerate(tables):
        for place in zip(part.cycle.tolist(), part.leg.tolist(), part.s.tolist(), strict=True):
            wanted.setdefault(place, kind)
    probes, given_rows = rf.given(record.probes), rf.given(s.probes).rows
    columns = probes.cycle.tolist(), probes.leg.tolist(), probes.s.tolist()
    places = list(zip(*columns, strict=True))
    assert places == sorted(wanted) and probes.kind.tolist() == [wanted[at] for at in places]
    for kind, part in enumerate(tables[:2]):
        rows = [places.index(at) for at in zip(part.cycle, part.leg, part.s, strict=True)]
        values = np.hstack([part.v, part.w, part.load]) @ given_rows.transpose(0, 2, 1)
        found = np.concatenate([probes.displacement[rows], probes.stress[rows]], axis=2)
        mine = probes.kind[rows] == kind
        assert near(found[mine], values.transpose(1, 0, 2)[mine])
        assert np.array_equal(probes.load[rows], part.load)
    at_rest = (probes.cycle == 0) & (probes.leg == 0) & (probes.s == 0.0)
    assert not probes.displacement[at_rest].any() and not probes.stress[at_rest].any()


def test_half_a_contact_is_recorded_as_the_whole_one_that_it_stands_for() -> None:
    """In what the images of scenes lack: jumps, doubts, and supports at several edges."""
    seen = Counter[str]()
    for pair in filter(None, (*map(played, NUMBERS), jumping())):
        (p, a), s, x = pair, pair[0].system, pair[0].system.x
        b = play(replace(p, system=replace(s, half=True)))
        edges = [np.flatnonzero(s.edges == k) for k in np.unique(s.edges)]
        # the modelled node behind each one
        index = np.concatenate([part for on in edges for part in (on[x[on] > 0.0][::-1], on)])
        left, axis = b.x < 0.0, x[index] == 0.0
        side, twice = np.where(left, -1.0, 1.0), np.where(axis, 2.0, 1.0)
        assert np.array_equal(b.x, side * x[index]) and np.array_equal(b.edge, s.edges[index])
        assert near(b.weight, twice * s.weight[index]) and np.array_equal(b.g0, s.g0[index])
        assert (b.modelled_nodes, b.half, b.residual_max) == (s.n, True, a.residual_max)
        # what symmetry holds on the axis is no support
        held = s.held[index] & ~axis
        assert np.array_equal(held, np.zeros(len(held), bool) if b.held is None else b.held)
        for key in ("dissipation_first_loading", "released"):
            assert getattr(b, key) == 2.0 * getattr(a, key), key
        assert (a.jumps, a.sweeps, len(b.events.s)) == (b.jumps, b.sweeps, b.n_events)
        doubts = [rf.given(record.uniqueness).nodes for record in (a, b)]
        assert np.array_equal(doubts[1], np.flatnonzero(np.isin(index, doubts[0])))
        seen += Counter(axis=int(axis.any()), edges=len(edges) - 1, jumps=a.jumps)
        seen["doubts"] += len(doubts[0])
    assert min(seen[key] for key in ("axis", "edges", "jumps", "doubts")) > 0, seen


def test_a_state_between_turning_points_is_found_again() -> None:
    """By both methods, in all kinds of histories, of which the record keeps the samples."""
    compared = Counter[str]()
    for number in NUMBERS:
        if (pair := played(number)) is None or pair[1].jumps:
            continue
        p, record = pair
        if record.uniqueness is None or not record.uniqueness.certified:
            continue
        corners, samples, free = record.turning_points, record.samples, ~p.system.held
        size, force = np.abs([corners.v, corners.w]).max(), np.abs(p.system.r_star).max()
        rng = np.random.default_rng(number)
        for pick, kept in product(rng.integers(1 << 30, size=3), (samples, corners)):
            row = pick % len(kept.s)
            where = int(kept.cycle[row]), int(kept.leg[row]), float(kept.s[row])
            found = rf.state_at(record, p.system, p.history, p.solver, where)
            now = found.state
            assert near(found.v, kept.v[row], size) and near(now.w, kept.w[row], size)
            assert near(now.r[free], np.append(kept.Q[row], kept.P[row])[free], force)
            assert np.array_equal(now.state, kept.state[row]), (number, where)
            compared[record.method] += 1
    assert min(compared["events"], compared["gauss-seidel"]) > 5, compared


def jumping() -> tuple[Problem, rf.Record]:
    """Return a node with a probe that jumps on its second leg."""
    K, loads = [[2.0, 1.5], [1.5, 2.0]], {"a": [1.0, 1.0], "b": [0.0, -1.0]}
    rows = np.random.default_rng(1).standard_normal((1, 6, 4))
    probes = ProbeMatrix(("a",), np.zeros((1, 2)), rows)
    system = replace(small_system(K, loads, 2.0), x=np.ones(1), probes=probes)
    history = table(system, [[0, 0], [1, 0], [0.25, 1]])
    p = Problem(0, system, history, rf.SolverOptions(on_jump="static"), ())
    return p, play(p)


def test_a_probe_at_an_event_is_that_of_a_path_that_ends_there() -> None:
    compared = 0
    for pair in (*map(played, NUMBERS), jumping()):
        if pair is None or pair[0].solver.method != "events":
            continue
        (p, record), e = pair, pair[1].events
        every = np.flatnonzero((e.cycle == 0) & (e.s > 1e-6) & (e.s < 1.0 - 1e-6))
        for j in every if record.jumps else every[::5]:
            path = np.vstack([p.history.path[: e.leg[j] + 1], e.load[j]])
            short = play(replace(p, history=replace(p.history, path=path, loop=path[:0], cycles=0)))
            a, b = (rf.given(one.probes) for one in (record, short))
            k = int(np.flatnonzero((a.cycle == 0) & (a.leg == e.leg[j]) & (a.s == e.s[j]))[-1])
            assert near(a.stress[k], b.stress[-1], np.abs(a.stress).max()), p.number
            compared += a.kind[k] == 2
    assert record.jumps == 1 and compared > 5


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
        # events at one place may be told in another order, at which nothing moves
        a, b = (probes.stress for probes in kept)
        assert near(b, a)
    assert compared > 5


def test_the_record_of_an_edge_is_that_of_its_nodes() -> None:
    several = 0
    for number in NUMBERS:
        if (pair := played(number)) is None or len(set(pair[1].edge.tolist())) < 2:
            continue
        record = replace(pair[1], cohesion=pair[1].weight, shear_limit=pair[1].x)
        several += 1
        for k, (name, part) in enumerate(record.by_edge().items()):
            nodes = np.flatnonzero(record.edge == k)
            assert name == record.edge_names[k]
            for which in TABLES:
                mine, all_ = part.to_table(which), record.to_table(which)
                mine["node"], on = nodes[mine["node"]], np.isin(all_["node"], nodes)
                for key, column in all_.items():
                    assert np.array_equal(mine[key], column[on]), key
            keys = "x points f g0 weight edge f_backward held cohesion shear_limit"
            for key in keys.split():
                all_, own = getattr(record, key), getattr(part, key)
                assert (all_ is None and own is None) or np.array_equal(own, all_[nodes]), key
    assert several > 3


def test_moments_and_tables_tell_what_the_record_holds() -> None:
    for pair in filter(None, map(played, NUMBERS[:18])):
        record = replace(pair[1], cohesion=pair[1].weight, shear_limit=pair[1].x)
        n, names, table = len(record.x), record.load_names, record.turning_points
        for which in TABLES:
            part, columns, m = getattr(record, which), record.to_table(which), n
            known = {f.name: getattr(part, f.name) for f in fields(part)}
            for key in {"load", "load_displacement"} & known.keys():
                values = known.pop(key)
                known |= {f"{key}.{name}": values[:, k] for k, name in enumerate(names)}
            if which == "cycles":
                known["cycle"] = np.arange(len(part.dissipation)) + 1
            if which == "events":
                m = 1
            else:
                known |= {"node": np.arange(n)[None], "x": record.x[None]}
            _check_columns(columns, known, m)
            if which == "events":
                continue
            data = record.to_xarray(which)
            del columns["node"]
            named = {key: data[key].values for key in columns}
            named = {k: a[None] if data[k].dims == ("node",) else a for k, a in named.items()}
            _check_columns(columns, named, m)
            for key in ("f", "weight", "f_backward", "cohesion", "shear_limit"):
                assert np.array_equal(data.coords.get(key), getattr(record, key)), key
            if len(record.edge_names) > 1:
                assert data["edge"].values.tolist() == [record.edge_names[k] for k in record.edge]
        for row, f in product(range(len(table.s)), fields(Moment)):
            mine, own = getattr(moment_of(record, table, row), f.name), getattr(table, f.name, None)
            mine = [mine[name] for name in names] if isinstance(mine, dict) else mine
            wanted = getattr(record, f.name) if own is None else own[row]
            assert np.array_equal(mine, wanted), f.name
        probes = rf.given(record.probes)
        for name in ("a", "b"):
            own, columns = np.array(probes.names) == name, record.probe(name).to_table()
            m = np.count_nonzero(own)
            known = {key: getattr(probes, key) for key in ("cycle", "leg", "s")}
            kinds = np.array(["turning point", "sample", "event"])
            known["kind"] = kinds[probes.kind]
            known |= {f"load.{name}": probes.load[:, k] for k, name in enumerate(names)}
            x, y = probes.points[own].T
            known |= {"point": np.arange(m)[None], "x": x[None], "y": y[None]}
            values = np.concatenate([probes.displacement, probes.stress], axis=2)[:, own]
            keys = "ux uy sxx syy szz sxy".split()
            known |= {key: values[..., k] for k, key in enumerate(keys)}
            largest = int(np.argmax(columns.pop("von_mises")))
            _check_columns(columns, known, m)
            point, cycle, leg, s = (columns[key][largest] for key in ("point", "cycle", "leg", "s"))
            points, instants, stress = repr(record.probe(name)).splitlines()
            assert stress.endswith(f"point {point}, cycle {cycle}, leg {leg}, s = {s:.6g}")
            counts = [f"{np.count_nonzero(probes.kind == k)} {kinds[k]}s" for k in range(3)]
            told, first, last = ", ".join(counts), probes.cycle[0], probes.cycle[-1]
            assert instants == f"  instants   {told}, cycles {first} to {last}"
            places = [tuple(place) for place in probes.points[own].tolist()]
            where = f"point {places[0]}" if m == 1 else f"{places[0]} to {places[1]}"
            assert points == f"Probe {name}: {m} point(s), {where}"


def _check_columns(columns: dict[str, Any], known: dict[str, Any], m: int) -> None:
    """Compare a table with arrays over its rows (k,), its m nodes or points (1, m), or both."""
    assert columns.keys() == known.keys()
    for key, a in known.items():
        whole = np.broadcast_to(a[:, None] if a.ndim == 1 else a, (len(known["cycle"]), m))
        assert np.array_equal(columns[key], whole.ravel()), key
