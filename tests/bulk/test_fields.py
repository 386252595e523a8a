"""Fields of pictures against probes, which take their values by another way."""

from dataclasses import replace
from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
from pictured import instant_of_row, small_block

import receding_fenicsx as rf
from receding_fenicsx.bulk.fields import Fields, fields_at
from receding_fenicsx.pictures import picture_body

pytestmark = pytest.mark.one_rank

UNIFORM = rf.MeshOptions(contact_elements=8, growth=1.0)
"""Pictures have no finer mesh."""


def half_planes(upside_down: bool) -> rf.Scene:
    """A cylinder pressed and pushed askew on a stretched half-plane."""
    edges = ("top", "bottom") if upside_down else ("bottom", "top")
    down = 1.0 if upside_down else -1.0
    return rf.Scene(
        body=rf.Body("a", shape="half-plane", width=2.4),
        others=(rf.Body("b", shape="half-plane", width=2.4, window=(3.0, 2.0)),),
        material=rf.Material(200.0, 0.3),
        mesh=rf.MeshOptions(contact_elements=30),
        contacts=(rf.Contact(f"a.{edges[0]}", against=f"b.{edges[1]}", initial_gap="x**2/200"),),
        loads=(
            rf.Load("P", "a.far", platen=True, force=(0.2, down)),
            rf.Load("S", "b.far", tension=2.0),
        ),
        supports=(rf.Support(edge="b.far", fix="xy"),),
        history=rf.HistoryOptions("table", columns=("P", "S"), rows=((1.0, 0.0), (1.0, 1.0))),
    )


def two_blocks() -> rf.Scene:
    """A block on a wider one of another material, pushed to the right."""
    return rf.Scene(
        body=rf.Body("a", width=2.0, position=(0.0, 1.0)),
        others=(rf.Body("b", width=4.0),),
        material=rf.Material(3.0, 0.3),
        materials=(rf.Material(1.0, 0.2, name="b"),),
        mesh=UNIFORM,
        contacts=(rf.Contact("a.bottom", against="b.top", friction=0.4),),
        loads=(rf.Load("p", "a.top", traction=(0.1, -1.0)),),
        supports=(rf.Support(edge="b.bottom", fix="xy"),),
        history=rf.HistoryOptions("monotonic"),
    )


def fields_of(scene: rf.Scene) -> tuple[rf.Record, Fields]:
    """The record of a scene, and its fields at the end of the first loading."""
    record, now = instant_of_row(scene, len(scene.history.rows or (1,)) - 1)
    with picture_body(scene, MPI.COMM_SELF) as bulk:
        found = fields_at(bulk, now.load, np.concatenate([now.v, now.state.w]))
    assert found is not None
    return record, found


SCENES = {
    "half-planes": half_planes(upside_down=False),
    "half-planes, upside down": half_planes(upside_down=True),
    "two blocks": two_blocks(),
    "half of a block": replace(small_block(), mesh=UNIFORM),
}


@cache
def pictured(name: str) -> Fields:
    return fields_of(SCENES[name])[1]


@pytest.mark.parametrize("name", SCENES)
def test_fields_of_pictures_are_those_of_probes(name: str) -> None:
    scene, found = SCENES[name], pictured(name)
    bodies = np.zeros(len(found.points), int) if found.body is None else found.body
    chosen: list[np.ndarray] = []
    probes = []
    for k, body in enumerate(scene.bodies):
        own = np.flatnonzero(bodies == k)
        x, y = found.points[own].T
        # away from the contact's line, where stresses of half-planes are singular at nodes
        inside = own[np.abs(y - y[np.argmin(np.abs(y - 1.0 * (k == 0)))]) > 0.2 * np.ptp(y)]
        chosen.append(inside[np.linspace(0, len(inside) - 1, 7).astype(int)])
        points = tuple(map(tuple, found.points[chosen[-1]].tolist()))
        probes.append(rf.Probe(f"of {k}", points=points, body=body.name if scene.others else None))
        assert np.ptp(x) > 0.0
    record, again = fields_of(replace(scene, probes=tuple(probes)))
    np.testing.assert_array_equal(found.displacement, again.displacement)
    for k, own in enumerate(chosen):
        probe = record.probe(f"of {k}")
        row = np.flatnonzero((probe.kind == "turning point") & (probe.cycle == 0))[-1]
        size = np.abs(found.displacement).max()
        assert np.abs(probe.displacement[row] - found.displacement[own]).max() < 1e-9 * size
        if "planes" not in name:
            continue  # in elements stresses are averages
        for n, part in enumerate(("sxx", "syy", "szz", "sxy")):
            largest = np.abs(probe.stress[row]).max()
            assert np.abs(probe.stress[row, :, n] - found.stress[part][own]).max() < 1e-9 * largest
        assert np.allclose(probe.von_mises[row], found.stress["von_mises"][own], rtol=1e-9)
        sxx, syy, _, sxy = probe.stress[row].T
        shear = np.hypot(0.5 * (sxx - syy), sxy)
        assert np.allclose(shear, found.stress["max_shear"][own], rtol=1e-9)


def test_windows_of_half_planes_are_where_and_as_large_as_asked_for() -> None:
    for name, upper in (("half-planes", 0), ("half-planes, upside down", 1)):
        found = pictured(name)
        for body, size in ((0, (4.8, 2.4)), (1, (3.0, 2.0))):
            x, y = found.points[found.body == body].T
            assert [x.min(), x.max()] == pytest.approx([-0.5 * size[0], 0.5 * size[0]])
            ends = [0.0, size[1]] if body == upper else [-size[1], 0.0]
            assert [y.min(), y.max()] == pytest.approx(ends)
