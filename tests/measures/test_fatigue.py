"""Fatigue parameters: closed forms of Cattaneo and Mindlin, brute-force searches, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_text import REPORTS, check_area, check_curves, check_words, told
from scipy.optimize import brentq, minimize

import receding_fenicsx as rf
from receding_fenicsx.evolution.record_data import Limit
from receding_fenicsx.measures.fatigue import averaged, fatigue_summary, life, smallest_sphere

pytestmark = pytest.mark.one_rank

CYLINDERS = Path(__file__).parents[2] / "demos" / "half_planes.toml"
PROBES = Path(__file__).with_name("probes.toml").read_text()
P, F, U, R, E, NU = 1.0, 0.5, 0.6, 100.0, 200.0, 0.3
HERTZ = rf.reference.closed_forms.Hertz(P, R, 0.5 * E / (1.0 - NU**2))
A, P0 = HERTZ.a, HERTZ.p0
STICK = A * np.sqrt(1.0 - U)


def cylinders(size: float | None = None, elements: int = 80, bulk: float = 0.0) -> rf.Record:
    """Run the cylinders, the elements at the edges of their contact of some size.

    A bulk stress of the lower one goes to and fro with the shear force.
    """
    changes, more = [f"mesh.contact_elements={elements}"], ""
    if bulk:
        more = f'[[load]]\nname = "B"\nedge = "lower.far"\ntension = {bulk}\n'
        Q = U * F * P
        changes += ['history.columns=["P", "Q", "B"]', f"history.rows=[[1, 0, 0], [1, {Q}, 1]]"]
        changes += [f"history.cycle_rows=[[1, {-Q}, -1], [1, {Q}, 1]]"]
    scene = rf.from_toml(CYLINDERS.read_text() + more + PROBES, changes)
    if size is not None:
        places = tuple(rf.Refinement(size, (s * A - 2 * size, s * A + 2 * size)) for s in (-1, 1))
        scene = replace(scene, mesh=replace(scene.mesh, refine=places))
    return rf.given(rf.run(scene))


def cracked(elements: int) -> rf.Record:
    """Run unlike cylinders, a crack in the lower one."""
    text = PROBES.replace("point = [0.3, -0.4]", "segment = [[1.07, 0], [1.07, -0.6]]\ncount = 30")
    # neither two points nor those beside a segment are a crack
    more = '[[probe]]\nname = "two"\nbody = "lower"\nsegment = [[1.07, 0], [1.07, -1]]\ncount = 2\n'
    more += '[[probe]]\nname = "dots"\nbody = "lower"\npoints = [[0, -1], [0, -2], [1, -2]]\n'
    text = more + text.replace('"inside"', '"crack"') + "threshold = 0.1\nfatigue_limit = 0.2\n"
    text = CYLINDERS.read_text() + text + "average = 0.2\nstrength = 4.0\n"
    changes = [f"mesh.contact_elements={elements}", "material.upper.young=300.0"]
    return rf.given(rf.run(rf.from_toml(text, changes)))


@pytest.fixture(scope="module")
def record_with_a_crack() -> rf.Record:
    return cracked(30)


def slip_amplitude(x: np.ndarray) -> np.ndarray:
    """Return the slip amplitude of Cattaneo and Mindlin's cycle."""
    root = np.sqrt(np.maximum(x**2 - STICK**2, 0.0))
    area = np.abs(x) * root - STICK**2 * np.log(np.maximum(np.abs(x) + root, STICK) / STICK)
    return np.where(np.abs(x) < A, F * P0 / (HERTZ.modulus * A) * area, 0.0)


def test_edge_stress_and_swt_meet_cattaneo_and_mindlin_with_order_one_half() -> None:
    bulk = 0.05
    # the bulk stress moves the stick zone by a bulk / (4 f p0) away from the worst edge
    away = A + A * bulk / (4.0 * F * P0)
    stress = bulk + 2.0 * F * P0 * (1.0 - (away - np.sqrt(away**2 - STICK**2)) / A)
    errors = []
    sizes = (4e-3, 1e-3, 2.5e-4)
    for size in sizes:
        record = cylinders(size, bulk=bulk)
        swt = rf.fatigue(record)["edge"]["swt"]
        k = int(np.argmax(swt.value))
        assert abs(abs(record.probe("edge").points[k, 0]) - A) < 3.0 * size
        assert min(swt.angle[k], 180.0 - swt.angle[k]) < 3.0  # perpendicular to the surface
        errors.append(abs(swt.value[k] / ((1.0 - NU**2) * stress**2 / E) - 1.0))
    assert errors[-1] < 0.06
    # quartered elements: the stress has a cusp of order one half
    assert np.all(np.array(errors[:-1]) / errors[1:] > 1.5)


def test_ruiz_and_slip_amplitude_meet_the_closed_form() -> None:
    errors = []
    for elements in (80, 160):
        record = cylinders(elements=elements)
        found, probe = rf.fatigue(record)["edge"], record.probe("edge")
        x = probe.points[:, 0]
        tension = np.maximum(probe.stress[..., 0].max(axis=0), 0.0)
        tau = np.where(np.abs(x) < A, F * HERTZ.pressure(x), 0.0)
        slips = np.abs(x) > STICK + 0.03
        known = tension * tau * slip_amplitude(x)
        errors.append(np.abs(found["ruiz_f1"].value - known)[slips].max() / known[slips].max())
        # both are largest at the reversal, where the edge is stretched most
        assert np.all(found["ruiz_f2"].value <= found["ruiz_f1"].value * (1.0 + 1e-12))
    assert errors[1] < 0.06 and errors[1] < 0.7 * errors[0]


def test_parameters_are_those_of_a_brute_force_search() -> None:
    rng = np.random.default_rng(7)
    options = rf.FatigueOptions(None, 0.4, 0.2, 1.5, yield_stress=2.0)
    material = rf.Material(young=3.0, poisson=0.3)
    stress = rng.normal(size=(12, 5, 4))
    stress[:, 4, :3] -= 9.0  # pressed together all the time
    found = rf.fatigue_at(stress, material, options)
    theta = np.radians(np.arange(0.0, 180.0, 0.02))
    n = np.array([np.cos(theta), np.sin(theta)])
    t = np.array([-n[1], n[0]])
    for k in range(5):
        tensor = np.zeros((12, 3, 3))
        tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 2, 2] = stress[:, k, :3].T
        tensor[:, 0, 1] = tensor[:, 1, 0] = stress[:, k, 3]
        trace = np.trace(tensor, axis1=1, axis2=2)
        strain = (1.3 * tensor - 0.3 * trace[:, None, None] * np.eye(3)) / 3.0
        plane = tensor[:, :2, :2]
        s_n = np.einsum("ap,iab,bp->ip", n, plane, n)
        e_n = np.einsum("ap,iab,bp->ip", n, strain[:, :2, :2], n)
        gamma = 2.0 * np.einsum("ap,iab,bp->ip", n, strain[:, :2, :2], t)
        opening = np.maximum(s_n.max(axis=0), 0.0)
        swt = opening * np.ptp(e_n, axis=0) / 2.0
        assert found["swt"].value[k] == pytest.approx(swt.max(), rel=1e-6)
        socie = np.ptp(gamma, axis=0) / 2.0 * (1.0 + 1.5 * opening / 2.0)
        assert found["fatemi_socie"].value[k] == pytest.approx(socie.max(), rel=1e-6)
        # Dang Van: the centre of the sphere by minimising the largest distance
        deviator = tensor - trace[:, None, None] / 3.0 * np.eye(3)

        def largest(c: np.ndarray, deviator: np.ndarray = deviator) -> float:
            centre = np.array([[c[0], c[2], 0], [c[2], c[1], 0], [0, 0, -c[0] - c[1]]])
            return float(np.linalg.norm(deviator - centre, axis=(1, 2)).max())

        search = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000}
        c = np.zeros(3)
        for _ in range(4):
            c = minimize(largest, c, method="Nelder-Mead", options=search).x
        crossland = largest(c) / np.sqrt(2.0) + 0.2 * trace.max() / 3.0
        assert found["crossland"].value[k] == pytest.approx(crossland, rel=1e-5)
        centre = np.array([[c[0], c[2], 0], [c[2], c[1], 0], [0, 0, -c[0] - c[1]]])
        tresca = np.ptp(np.linalg.eigvalsh(deviator - centre), axis=1) / 2.0
        dang_van = (tresca + 0.4 * trace / 3.0).max()
        assert found["dang_van"].value[k] == pytest.approx(dang_van, rel=1e-3)


def test_spheres_hold_all_points_and_touch_enough_of_them() -> None:
    rng = np.random.default_rng(3)
    for n in range(1, 61):
        points = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.0 if n == 5 else 1.0]
        centre, radius = smallest_sphere(points)
        away = np.linalg.norm(points - centre, axis=1)
        assert away.max() <= radius + 1e-9
        on = points[away > radius - 1e-8] - centre
        # no direction leads the centre away from none of the points that it touches
        directions = rng.normal(size=(2000, 3))
        assert n == 1 or np.all((on @ directions.T).min(axis=0) <= 1e-6)


def test_means_and_lives_are_those_of_known_functions() -> None:
    x = np.linspace(0.0, 1.0, 21)
    points = np.column_stack([x, 0.0 * x])
    assert averaged(2.0 * x, points, 0.2).max() == pytest.approx(1.8, rel=1e-12)
    assert averaged(0.0 * x + 3.0, points, 5.0) == pytest.approx(np.full(21, 3.0))
    exponents: dict[str, Any] = {"strength_exponent": -0.1, "ductility_exponent": -0.7}
    options = rf.FatigueOptions(strength=900.0, ductility=0.3, **exponents)
    cycles = 2.3e5
    twice = 2.0 * cycles
    swt = 900.0**2 / 2e5 * twice**-0.2 + 900.0 * 0.3 * twice**-0.8
    assert life(swt, 2e5, options) == pytest.approx(cycles, rel=1e-9)
    assert life(0.0, 2e5, options) == np.inf and life(1e9, 2e5, options) == 0.1
    assert life(swt, 2e5, rf.FatigueOptions()) is None


def test_parameters_along_a_crack_are_those_of_its_body_and_drawn_over_its_depth(
    record_with_a_crack: rf.Record,
) -> None:
    swt = rf.fatigue(record_with_a_crack)["crack"]["swt"].value
    probe, last = record_with_a_crack.probe("crack"), len(record_with_a_crack.cycles.dissipation)
    stress = probe.stress[probe.cycle == last]
    lower = rf.fatigue_at(stress, rf.Material(E, NU), rf.FatigueOptions())
    assert swt == pytest.approx(lower["swt"].value, rel=1e-9)
    drawn = rf.figures.fatigue_along(record_with_a_crack, "crack").axes[0]
    check_curves(drawn, (np.linspace(0.0, 0.6, 30), swt))


def test_pylife_has_the_lives_of_the_same_line(record_with_a_crack: rf.Record) -> None:
    pytest.importorskip("pylife")
    record, b = record_with_a_crack, -0.09
    line = {"k_1": -1.0 / b, "k_2": -1.0 / b, "ND": 1e6, "SD": 4.0 * 2e6**b}
    found = rf.life_by_pylife(record, line)
    for name, parameters in rf.fatigue(record).items():
        swt, options = parameters["swt"].value, rf.FatigueOptions(strength=4.0)
        known = np.array([life(value, E, options) for value in swt], dtype=float)
        finite = np.isfinite(known)
        assert found[name][finite] == pytest.approx(known[finite], rel=1e-6)
        assert np.all(found[name][~finite] >= 1e15)


def test_figures_and_numbers_of_a_crack_are_what_is_known(record_with_a_crack: rf.Record) -> None:
    record = record_with_a_crack
    (crack,) = rf.short_cracks(record).values()
    names = "fatigue_edge", "fatigue_crack", "crack_crack"
    drawn = dict(rf.figures.draw_all(record))
    shown = [line for name in names for line in told(drawn[name], name)]
    # 0 and 180 degrees are one plane
    check_words([line for line in shown if " None . " not in line], REPORTS / "crack.txt")
    (dots,) = drawn["fatigue_crack"].axes[1].lines
    swt = rf.fatigue(record)["crack"]["swt"]
    tells = swt.value > 1e-3 * swt.value.max()
    assert np.array_equal(np.asarray(dots.get_ydata()), swt.angle[tells])
    known = fatigue_summary(record)["fatigue"]["parameters"]
    assert all(row["estimate"] is None for row in known.values())
    found = fatigue_summary(record, cracked(16))["fatigue"]
    found["parameters"]["fatemi_socie"]["angle"] %= 90.0  # planes across each other shear alike
    rows = [*found["parameters"].items(), *found["cracks"].items()]
    check_words([json.dumps(row) for row in rows], REPORTS / "fatigue.txt")
    ranges = [k(axis=0) for values in (crack.k_i, crack.k_ii) for k in (values.max, values.min)]
    guides = ([crack.arrest] * 2, [0.0, 1.0]), ([0.0, 1.0], [0.0, 0.0])
    lines = ((crack.depth, values) for values in [*ranges, crack.threshold])
    (axes,) = drawn["crack_crack"].axes
    check_curves(axes, *lines, *guides)
    for area, high, low in zip(axes.collections, ranges[::2], ranges[1::2], strict=True):
        check_area(area, crack.depth, low, high)
    assert 0.0 < crack.arrest < crack.depth[-1]


def test_parameters_of_a_cycle_depend_on_it_and_on_its_start_alone(
    record_with_a_crack: rf.Record,
) -> None:
    record, last = record_with_a_crack, len(record_with_a_crack.cycles.dissipation)
    played, jumped = (
        replace(record, limit=Limit(True, last, last, 0.0, 1, "", jumps)) for jumps in (False, True)
    )
    for known, kept in ((record, 1), (played, 1), (jumped, 0)):
        probes, points = rf.given(known.probes), known.turning_points
        early, rows = np.flatnonzero(probes.cycle < last), np.flatnonzero(points.cycle < last)
        for keep in (kept, 0):
            stress, v = probes.stress.copy(), points.v.copy()
            stress[early[: len(early) - keep]], v[rows[: len(rows) - keep]] = 100.0, 1.0
            spoilt = replace(points, v=v), replace(probes, stress=stress)
            found = rf.fatigue(replace(known, turning_points=spoilt[0], probes=spoilt[1]))["edge"]
            for name, parameter in rf.fatigue(known)["edge"].items():
                same = np.array_equal(found[name].value, parameter.value)
                assert same == (keep == kept), name
    none = {name: values[:0] for name, values in vars(record.cycles).items()}
    plain = rf.to_toml(replace(rf.given(record.scene), fatigue=None))
    texts = [replace(record, scene_toml=text) for text in ("", plain)]
    for other in (replace(record, cycles=replace(record.cycles, **none)), *texts):
        assert rf.fatigue(other) == rf.short_cracks(other) == fatigue_summary(other) == {}


def test_a_node_slips_that_touches_at_one_instant_of_the_cycle(
    record_with_a_crack: rf.Record,
) -> None:
    record = record_with_a_crack
    known = rf.fatigue(record)["edge"]["ruiz_f1"].value
    samples, points = (replace(t, P=0.0 * t.P) for t in (record.samples, record.turning_points))
    away = replace(record, samples=samples, turning_points=points)
    assert not rf.fatigue(away)["edge"]["ruiz_f1"].value.any()
    samples.P[-2] = record.samples.P[-2]
    found = rf.fatigue(away)["edge"]["ruiz_f1"].value
    assert found.any() and np.array_equal(found[found > 0.0], known[found > 0.0])
    # a traction has the same effect in either direction
    samples, points = (replace(t, Q=-t.Q) for t in (record.samples, record.turning_points))
    turned = rf.fatigue(replace(record, samples=samples, turning_points=points))["edge"]
    assert np.array_equal(turned["ruiz_f1"].value, known)


def test_edge_cracks_have_the_tabulated_stress_intensities() -> None:
    # Tada, Paris and Irwin: 1.1215 in uniform stress, 0.683 and 0.5255 in ones that grow from 0 at
    # the mouth as x and x^2
    x = np.linspace(0.0, 2.0, 31)
    t = np.array([np.cos(1.1), -np.sin(1.1)])  # a slanted line in stresses turned with it
    n = np.array([-t[1], t[0]])
    # between the points stresses are straight: of the bent ones the deepest crack alone counts
    profiles = (0.0 * x + 1.0, 1.1215, 0), (x, 0.683 * x, 0), (x**2, 0.5255 * x**2, 30)
    for profile, factor, first in profiles:
        tensor = np.outer(n, n) + np.outer(t, n) + np.outer(n, t)
        stress = np.zeros((2, 31, 4))
        stress[1] = np.outer(profile, [tensor[0, 0], tensor[1, 1], 0.0, tensor[0, 1]])
        crack = rf.edge_crack(stress, np.outer(x, t), rf.FatigueOptions())
        known = factor * np.sqrt(np.pi * x)
        for found in (crack.k_i[1], crack.k_ii[1], crack.delta_k):
            assert found[first:] == pytest.approx(known[first:], rel=1e-3 if first == 0 else 2e-3)


def test_cracks_arrest_where_the_threshold_is_not_met() -> None:
    x = np.linspace(0.0, 1.6, 400)
    options = rf.FatigueOptions(threshold=1.0, fatigue_limit=1.0)
    short = 1.0 / (np.pi * 1.1215**2)

    def arrest(profile: np.ndarray) -> float:
        stress = np.zeros((2, len(x), 4))
        stress[0, :, 0], stress[1, :, 0] = profile, -5.0 * profile  # closed at the other end
        return rf.edge_crack(stress, np.column_stack([0.0 * x, -x]), options).arrest

    assert arrest(0.0 * x + 1.01) == np.inf and arrest(0.0 * x + 0.99) == 0.0

    def lack(a: float) -> float:
        K = 1.5 * (1.1215 - 0.683 * a) * np.sqrt(np.pi * a)
        return float(K - np.sqrt(a / (a + short)))

    assert arrest(1.5 * (1.0 - x)) == pytest.approx(brentq(lack, 0.8, 1.6), rel=2e-3)
