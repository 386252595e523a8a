"""Titles, labels and units of the figures of scenes of several loads."""

from functools import cache, partial
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from drawn_text import REPORTS, check_curves, check_figures

import receding_fenicsx as rf
from receding_fenicsx.output.plots.figures import draw_all
from receding_fenicsx.output.plots.zone_map import zone_map

pytestmark = pytest.mark.one_rank

SHORT = ("P", "Q", "bulk")
LONG = ("normal pressure on top", "tangential force of the actuator", "bulk stress (remote)")
MM = rf.Units("mm", "MPa", "N/mm")
WIDEST = rf.Units("millimetres.", "megapascals.", "kilonewtons.")
PHASE, AMPLITUDE = 20.0, 0.3


@cache
def fretting(
    kind: str, names: tuple[str, ...] = SHORT, units: rf.Units = MM, limit: float | None = None
) -> rf.Record:
    """Return a record of two half-planes under a normal force, a shear force and a tension.

    The friction of harmonic loads depends on the direction of slip.
    """
    P, Q, bulk = names
    start, cycle = ((1.0, 0.4, 0.3),), ((1.2, -0.1, 0.1), (1.1, -0.4, -0.3), (1.0, 0.4, 0.3))
    history = rf.HistoryOptions("table", columns=names, rows=start, cycle_rows=cycle, cycles=3)
    if kind == "harmonic":
        harmonic = {Q: rf.Harmonic(amplitude=0.4), bulk: rf.Harmonic(0.1, AMPLITUDE, PHASE)}
        history = rf.HistoryOptions(
            kind, constant={P: 1.0}, harmonic=harmonic, cycles=3, corners=16
        )
    friction: Any = 0.4 if kind == "table" else {"forward": 0.4, "backward": 0.45}
    contact = rf.Contact(
        "pad.bottom",
        against="specimen.top",
        friction=friction,
        initial_gap="x**2/400",
        shear_limit=limit,
    )
    points = (-1.6, -0.1), (0.0, -0.2), (1.6, -0.1)
    scene = rf.Scene(
        body=rf.Body("pad", shape="half-plane", width=4.4),
        others=(rf.Body("specimen", shape="half-plane", width=4.4),),
        material=rf.Material(210000.0, 0.3),
        mesh=rf.MeshOptions(contact_elements=30),
        contacts=(contact,),
        loads=(
            rf.Load(P, "pad.far", platen=True, force=(0.0, -800.0)),
            rf.Load(Q, "pad.far", platen=True, force=(320.0, 0.0)),
            rf.Load(bulk, "specimen.far", tension=100.0),
        ),
        supports=(rf.Support(edge="specimen.far", fix="xy"),),
        probes=(
            rf.Probe("corner", point=points[0], body="specimen"),
            rf.Probe("path", points=points, body="specimen"),
        ),
        history=history,
        output=rf.OutputOptions(samples_per_leg=40),
        units=units,
    )
    return rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)


@pytest.mark.parametrize(
    ("kind", "units", "limit"),
    [("table", WIDEST, None), ("harmonic", WIDEST, None), ("table", rf.Units(), 50.0)],
)
def test_figures_draw_what_is_known_with_all_texts_on_the_page(
    kind: str, units: rf.Units, limit: float | None
) -> None:
    drawn = draw_all(fretting(kind, LONG, units, limit))
    if limit is not None:
        drawn = ((name, figure) for name, figure in drawn if name.startswith("tra"))
    check_figures(drawn, REPORTS / f"{kind if limit is None else 'limited'}.txt")


def test_curves_have_the_values_of_the_record() -> None:
    """Those of the legends' names, as the known texts tell."""
    found, check = fretting("table"), partial(check_curves, guides=False)
    moment, d, used = found.at(3, leg=0), found.cycles.dissipation_density, found.weight > 0.0
    x, nodes = found.x[used], [7, 20]
    check(rf.figures.tractions(found, moment).axes[1], (x, moment.p[used]), (x, moment.q[used]))
    density = rf.figures.dissipation_density(found).axes[0]
    check(density, (x, d[0][used]), (x, d[-1][used]))
    loops = [rf.loop_of(found, cycle) for cycle in range(4)]
    figure = rf.figures.hysteresis(found, range(4))
    for k, (left, right) in enumerate(zip(figure.axes[::2], figure.axes[1::2], strict=True)):
        # a tension of the far field does its work on the conjugate's negative
        size, unit = ((800.0, 800.0), (320.0, 320.0), (100.0, -100.0))[k]
        load = [loop.load[:, k] * size for loop in loops]
        moved = [loop.displacement[:, k] / unit for loop in loops]
        check(left, *zip(moved, load, strict=True))
        # less the straight line between the extreme loads of the last loop; no first loading
        ends = [load[-1].argmin(), load[-1].argmax()]
        chord = np.polyfit(load[-1][ends], moved[-1][ends], 1)
        bent = [(u - np.polyval(chord, one), one) for u, one in zip(moved, load, strict=True)]
        check(right, *bent[1:])
    above = rf.figures.trajectories(found, nodes, range(4)).axes
    (low, high), w = above[2].get_ylim(), np.vstack([loop.w[:, nodes] for loop in loops])
    assert low < w.min() and w.max() < high
    for n, node in enumerate(nodes):
        check(above[n], *((loop.q[:, node], loop.p[:, node]) for loop in loops))
        check(above[n + 2], *((loop.v[:, node], loop.w[:, node]) for loop in loops))
    corner, path = found.probe("corner"), found.probe("path")
    stress = [np.dstack([one.stress, one.von_mises]) for one in (corner, path)]
    panels = rf.figures.probe_stresses(found, "corner").axes
    for axes, cycle in zip(panels, (0, 1, 3), strict=True):
        rows = np.flatnonzero(corner.cycle == cycle)
        begun = np.append(0.0, (corner.leg + corner.s)[rows])
        before = stress[0][rows[0] - 1, 0] if cycle else np.zeros(5)
        drawn = np.vstack([before, stress[0][rows, 0]]).T
        check(axes, *((begun, values) for values in drawn))
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path.points, axis=0).T)))
    (end,) = np.flatnonzero((path.cycle == 3) & (path.leg == 2) & (path.s == 1.0))
    panel = rf.figures.probe_stresses(found, "path").axes[-1]
    check(panel, *((along, values) for values in stress[1][end].T))


def test_figures_of_harmonic_loads_are_drawn_over_their_phase() -> None:
    found = fretting("harmonic")
    zones, loads = rf.figures.cycle_maps(found, 3).axes
    assert sum(zones.get_xlim()) == 0.0  # both halves, which differ
    at = np.asarray(loads.lines[0].get_ydata())
    Q, bulk = (np.cos(np.radians(at - phase)) for phase in (0.0, PHASE))
    # the tension is over its largest, 0.1 + 0.3
    parts = 1.0, Q, (0.1 + AMPLITUDE * bulk) / 0.4
    check_curves(loads, *((part, at) for part in parts), (0.0, [0.0, 1.0]))
    # what is drawn at the phase of a turning point are its states
    table = found.turning_points
    drawn = zone_map(found, 3)
    for row in np.flatnonzero(table.cycle == 3)[:-1]:
        before, after = (drawn.states(table.leg[row] + 1.0 + d) for d in (-1e-7, 1e-7))
        assert np.all((table.state[row] == before) | (table.state[row] == after))


def test_titles_leave_out_an_interference_once_it_is_closed() -> None:
    scene = rf.Scene(
        material=rf.Material(10.0, 0.3),
        mesh=rf.MeshOptions(contact_elements=8, degree=1),
        contacts=(rf.Contact("top", friction=0.3, interference=0.01),),
        supports=(rf.Support("xy", "bottom"),),
        loads=(rf.Load("P", "left", (-0.2, 0.2), pressure=0.1),),
        history=rf.HistoryOptions(cycles=1),
    )
    found = rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)
    instants = found.at(0, leg=0, s=0.5), found.at(0, leg=1, s=0.5), found.at(1, "minimum")
    titles = [rf.figures.tractions(found, moment).axes[0].get_title() for moment in instants]
    assert ["interference" in title for title in titles] == [True, False, False]
    assert all("$P = " in title for title in titles)
    last = rf.figures.tractions(found, found.at(1, "maximum")).axes[0].get_title()
    assert last.startswith("cycle 1, leg 1")


def test_the_unit_of_forces_is_for_unit_thickness_in_the_plane_only() -> None:
    for units, plane, round_ in (
        (rf.Units("mm", "MPa"), "MPa mm", "MPa mm²"),
        (rf.Units("mm", "MPa", "N"), "N/mm", "N"),
        (MM, "N/mm", "MPa mm²"),
        (rf.Units("m", None, "kN m⁻¹"), "kN m⁻¹", ""),
        (rf.Units(force="N/m"), "N/m", ""),
    ):
        assert [units.of_force(around) for around in (False, True)] == [plane, round_]


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
def test_the_force_of_a_prescribed_displacement_is_that_of_the_contact(kinematics: str) -> None:
    scene = rf.Scene(
        body=rf.Body(width=2.0),
        material=rf.Material(10.0, 0.3, kinematics),
        mesh=rf.MeshOptions(contact_elements=8, degree=1),
        contacts=(rf.Contact("top", friction=0.0, initial_gap="x**2"),),
        loads=(rf.Load("d", "bottom", displacement=(0.0, 0.02)),),
        history=rf.HistoryOptions(maximum=2.0, minimum=0.5, cycles=1),
    )
    found = rf.evolve(rf.given(rf.condense(scene, MPI.COMM_SELF)), scene)
    summary = rf.summarise(found)
    # the body is in equilibrium: of the whole edge, or of the full circle
    resultant = found.turning_points.P.sum(axis=1)
    assert summary["forces"] == {"d": pytest.approx(resultant.tolist(), rel=1e-9)}
    assert f"displacement d {resultant.min():.4g} to" in rf.run_table(summary)
    axes = rf.figures.hysteresis(found, 1).axes[0]
    assert axes.get_title(loc="left") == "(a) force on the edge"
    last = np.asarray(axes.lines[0].get_xydata())[-1]
    assert last == pytest.approx([1.0, resultant[-1]], rel=1e-9)
    # the record holds the conjugate of the load factor
    assert found.at(1, "maximum").load_displacement["d"] == pytest.approx(0.02 * resultant[-1])
