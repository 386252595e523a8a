"""Pictures of the stress field on the deformed body, drawn off-screen by pyvista.

One picture an instant and stress: the body, deformed by a stated factor, its outline before, the
load on top, the plane, the states of the contact nodes in the one colour scheme, and the tractions
p and q drawn below the plane.
"""

from __future__ import annotations

import ctypes.util
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from receding_fenicsx.errors import RecedingError, on_root
from receding_fenicsx.interface.contact import Array, State
from receding_fenicsx.interface.mirror import Mirror, mirror_nodes
from receding_fenicsx.output.collect import Instant
from receding_fenicsx.output.fields import Fields, fields_at
from receding_fenicsx.output.style import (
    GUIDE_COLOUR,
    PRESSURE_COLOUR,
    SHEAR_COLOUR,
    STATE_COLOURS,
    STATE_LABELS,
)

if TYPE_CHECKING:
    from receding_fenicsx.bulk.body import Bulk

RENDERERS = {"OSMesa": "vtkOSOpenGLRenderWindow", "EGL": "vtkEGLRenderWindow"}
"""Libraries that VTK draws with off-screen, and the window that it makes with each."""

PIXELS = (1500, 740)
"""Size of a picture."""

CENTRE_Y, MARGIN = 0.26, 1.13
"""Height of the picture's centre over the body's height, and its width over the body's."""

TINY = float(np.finfo(float).tiny)

EXAGGERATED = 0.06
"""Largest displacement in the picture over the body's height."""

TRACTION_HEIGHT = 0.27
"""Height of the largest traction in the picture over the body's height."""

FRINGES = 12
"""Isochromatic fringes between no shear and the largest shear in the plane."""

BAR = {
    "title": "",
    "vertical": False,
    "position_x": 0.36,
    "position_y": 0.025,
    "width": 0.36,
    "height": 0.075,
    "color": "black",
    "label_font_size": 19,
    "fmt": "%.2g",
    "n_labels": 5,
}
"""The colour bar of a stress."""


@dataclass(frozen=True)
class Quantity:
    """What is drawn: name in ``Fields.stress``, title, colours, whether centred about zero."""

    name: str
    title: str
    colours: str
    centred: bool


QUANTITIES = (
    Quantity("von_mises", "von Mises stress over p0", "viridis", False),
    Quantity("sxx", "stress xx over p0", "RdBu_r", True),
    Quantity("syy", "stress yy over p0", "RdBu_r", True),
    Quantity("sxy", "stress xy over p0", "RdBu_r", True),
    Quantity("max_shear", "fringes of the largest shear in the plane", "gray", False),
)


def snapshot(bulk: Bulk, instant: Instant, folder: Path) -> list[Path] | None:
    """Draw the body at one instant; all ranks call this together.

    Args:
        bulk: the body.
        instant: state of the modelled contact nodes, on rank 0.
        folder: folder of the pictures; the fields for ParaView go to ``fields`` beside it.

    Returns:
        The files made, on rank 0; None elsewhere.

    Raises:
        RecedingError: nothing can be drawn off-screen on this machine.
    """
    comm = bulk.comm
    on_root(comm, lambda: _prepare(folder))
    instant = comm.bcast(instant)
    name = f"cycle{instant.cycle:04d}_leg{instant.leg}_s{instant.s:.3f}"
    xdmf = folder.parent / "fields" / f"{name}.xdmf"
    u = np.concatenate([instant.v, instant.state.w])
    fields = fields_at(bulk, instant.load, u, xdmf)

    def draw() -> list[Path]:
        assert fields is not None
        made = [folder / f"{name}_{quantity.name}.png" for quantity in QUANTITIES]
        scene = _Picture.of(bulk, fields, instant)
        for quantity, file in zip(QUANTITIES, made, strict=True):
            _draw(scene, quantity, file)
        return [*made, xdmf]

    return on_root(comm, draw)


def _prepare(folder: Path) -> None:
    """Make the folders, and refuse before VTK would crash for want of a renderer."""
    found = [name for name in RENDERERS if ctypes.util.find_library(name)]
    if not found:
        raise RecedingError(
            "no off-screen renderer: neither OSMesa nor EGL was found; install libosmesa6"
        )
    # without this VTK looks for a display first, and complains
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", RENDERERS[found[0]])
    folder.mkdir(parents=True, exist_ok=True)
    (folder.parent / "fields").mkdir(exist_ok=True)


@dataclass(frozen=True)
class _Picture:
    """What all pictures of one instant share, lengths over the body's height.

    Attributes:
        points, moved: (n, 3) vertices before and after the exaggerated deformation.
        faces: VTK's list of cells.
        stress: stresses over the load's nominal pressure.
        factor: exaggeration of displacements.
        x, state, p, q: the contact nodes of the whole contact.
        spans: ends of the loaded parts of the top edge.
        share: load factor over 1, for the length of the arrows.
        caption: cycle, leg and load.
    """

    points: Array
    moved: Array
    faces: Any
    stress: dict[str, Array]
    factor: float
    x: Array
    state: Any
    p: Array
    q: Array
    spans: list[tuple[float, float]]
    share: float
    caption: str

    @classmethod
    def of(cls, bulk: Bulk, fields: Fields, instant: Instant) -> _Picture:
        scene, contact = bulk.scene, bulk.contact
        h = scene.body.height
        mirror: Mirror = mirror_nodes(contact.x, bulk.body.half)
        weight = mirror.total(contact.weight)
        nominal = max(abs(float(instant.load[0])), TINY)
        pressure = scene.loads[0].pressure
        if isinstance(pressure, float | int) and pressure != 0:
            nominal *= abs(float(pressure))
        largest = float(np.abs(fields.displacement).max())
        factor = _round(EXAGGERATED * h / largest) if largest > 0.0 else 1.0
        moved = fields.points + factor * fields.displacement
        width = fields.cells.shape[1]
        counted = np.hstack([np.full((len(fields.cells), 1), width), fields.cells]).ravel()
        half_width = 0.5 * scene.body.width
        spans = [
            load.span or (-half_width, half_width) for load in scene.loads if load.edge == "top"
        ]
        shown = ", ".join(
            f"{name} = {value:.3g}"
            for name, value in zip(bulk.load_names, instant.load, strict=True)
        )
        place = "first loading" if instant.cycle == 0 else f"cycle {instant.cycle}"
        return cls(
            _flat(fields.points / h),
            _flat(moved / h),
            counted,
            {name: value / nominal for name, value in fields.stress.items()},
            factor,
            np.where(mirror.left, -1.0, 1.0) * contact.x[mirror.index] / h,
            mirror.states(instant.state.state),
            mirror.total(instant.state.P) / np.where(weight > 0.0, weight, np.inf) / nominal,
            mirror.odd(instant.state.Q) / np.where(weight > 0.0, weight, np.inf) / nominal,
            [(a / h, b / h) for a, b in spans],
            abs(float(instant.load[0])) / max(scene.history.maximum, TINY),
            f"{place}, leg {instant.leg}, s = {instant.s:.3g}:  load factor {shown}",
        )


def _flat(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])


def _round(value: float) -> float:
    """Return the nearest number below of the series 1, 2, 5, 10."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value))


def _draw(picture: _Picture, quantity: Quantity, file: Path) -> None:
    """Draw one stress into a PNG file."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(PIXELS))
    plotter.set_background("white")
    body = pv.PolyData(picture.moved, faces=picture.faces)
    values = picture.stress[quantity.name]
    limits = _limits(values, quantity.centred)
    title = f"{quantity.title}"
    if quantity.name == "max_shear":
        body = _subdivided(body)
        heights = np.column_stack([picture.moved[:, :2], values])
        fine = np.asarray(_subdivided(pv.PolyData(heights, faces=picture.faces)).points)[:, 2]
        order = fine / (limits[1] or 1.0) * FRINGES
        body.point_data["light"] = np.cos(np.pi * order) ** 2
        plotter.add_mesh(
            body,
            scalars="light",
            cmap="gray",
            clim=(0.0, 1.0),
            lighting=False,
            show_scalar_bar=False,
            interpolate_before_map=True,
        )
        title = f"{title}, {limits[1] / FRINGES:.2g} p0 apart"
    else:
        body.point_data["stress"] = values
        plotter.add_mesh(
            body,
            scalars="stress",
            cmap=quantity.colours,
            clim=limits,
            lighting=False,
            n_colors=256,
            scalar_bar_args=BAR,
        )
    plotter.add_text(
        title, position=(0.36 * PIXELS[0], 0.105 * PIXELS[1]), font_size=12, color="black"
    )
    _draw_surroundings(plotter, picture)
    width = MARGIN * float(np.ptp(picture.points[:, 0]))
    plotter.camera_position = "xy"
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = (0.0, CENTRE_Y, 0.0)
    plotter.camera.position = (0.0, CENTRE_Y, 10.0)
    plotter.camera.parallel_scale = 0.5 * width * PIXELS[1] / PIXELS[0]
    plotter.screenshot(str(file))
    plotter.close()


def _subdivided(body: Any) -> Any:
    """Return a mesh of triangles fine enough for narrow fringes."""
    return body.triangulate().subdivide(3)


def _limits(values: Array, centred: bool) -> tuple[float, float]:
    """Return colour limits without the few values beside singular points."""
    if centred:
        high = float(np.percentile(np.abs(values), 99.0))
        return -high, high
    return 0.0, float(np.percentile(values, 99.5))


def _draw_surroundings(plotter: Any, picture: _Picture) -> None:
    """Draw outlines, plane, load, states and tractions."""
    import pyvista as pv

    undeformed = pv.PolyData(picture.points, faces=picture.faces)
    for mesh, colour, width in (
        (undeformed, GUIDE_COLOUR, 1.5),
        (pv.PolyData(picture.moved, faces=picture.faces), "black", 2.0),
    ):
        edges = mesh.clean(tolerance=1e-9).extract_feature_edges(
            boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False
        )
        plotter.add_mesh(edges, color=colour, line_width=width)
    _draw_load(plotter, picture)
    _draw_states(plotter, picture)
    _draw_tractions(plotter, picture)
    plotter.add_text(picture.caption, position=(30, PIXELS[1] - 45), font_size=13, color="black")
    plotter.add_text(
        f"displacements x {picture.factor:g}",
        position=(PIXELS[0] - 300, PIXELS[1] - 45),
        font_size=11,
        color="black",
    )


def _draw_load(plotter: Any, picture: _Picture) -> None:
    import pyvista as pv

    top = float(picture.points[:, 1].max())
    length = 0.2 * max(picture.share, 0.05)
    for a, b in picture.spans:
        inside = np.linspace(a, b, 9)
        beneath = np.interp(inside, *_top_edge(picture))
        for x, y in zip(inside, beneath, strict=True):
            arrow = pv.Arrow(
                start=(x, y + length + 0.01, 0.0),
                direction=(0.0, -1.0, 0.0),
                scale=length,
                tip_length=0.05 / length if length > 0.1 else 0.5,
                tip_radius=0.018 / length,
                shaft_radius=0.006 / length,
            )
            plotter.add_mesh(arrow, color="#222222", lighting=False)
        line = pv.Line((a, top + length + 0.012, 0.0), (b, top + length + 0.012, 0.0))
        plotter.add_mesh(line, color="#222222", line_width=2.5)


def _top_edge(picture: _Picture) -> tuple[Array, Array]:
    """Return x and y of the deformed top edge, x increasing."""
    on = picture.points[:, 1] >= picture.points[:, 1].max() * (1.0 - 1e-9)
    x, y = picture.moved[on, 0], picture.moved[on, 1]
    order = np.argsort(x)
    return x[order], y[order]


def _draw_states(plotter: Any, picture: _Picture) -> None:
    """Draw the plane, and on it the state of each node as a band."""
    import pyvista as pv

    x = picture.x
    borders = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    plotter.add_mesh(
        pv.Line((1.08 * x[0], -0.008, 0.0), (1.08 * x[-1], -0.008, 0.0)),
        color="black",
        line_width=3,
    )
    for state in State:
        here = np.flatnonzero(picture.state == state)
        corners = np.array([(borders[j], y, 0.0) for i in here for j, y in _corners(int(i))])
        _draw_squares(plotter, corners, state)
    _draw_legend(plotter, picture)


def _draw_squares(plotter: Any, corners: Array, state: State) -> None:
    """Fill quadrilaterals given by four corners each with a state's colour."""
    import pyvista as pv

    n = len(corners) // 4
    if n:
        faces = np.hstack([np.full((n, 1), 4), np.arange(4 * n).reshape(-1, 4)])
        body = pv.PolyData(corners, faces=faces.ravel())
        plotter.add_mesh(body, color=STATE_COLOURS[state], lighting=False)


def _draw_legend(plotter: Any, picture: _Picture) -> None:
    """Explain the states' colours at the lower left."""
    import pyvista as pv

    width = MARGIN * float(np.ptp(picture.points[:, 0]))
    unit = width / PIXELS[0]
    left, low = -0.5 * width, CENTRE_Y - 0.5 * unit * PIXELS[1]
    for row, state in enumerate(State):
        x, y = 40, 118 - 29 * row
        box = np.array([(x, y, 0), (x + 34, y, 0), (x + 34, y + 19, 0), (x, y + 19, 0)], float)
        corners = box * unit + [left, low, 0.0]
        _draw_squares(plotter, corners, state)
        outline = pv.lines_from_points(np.vstack([corners, corners[:1]]))
        plotter.add_mesh(outline, color="black", line_width=1.0)
        plotter.add_text(STATE_LABELS[state], position=(x + 46, y - 4), font_size=11, color="black")


def _corners(i: int) -> tuple[tuple[int, float], ...]:
    """Return border numbers and heights of the four corners of node i's part of the band."""
    low, high = -0.075, -0.018
    return ((i, low), (i + 1, low), (i + 1, high), (i, high))


def _draw_tractions(plotter: Any, picture: _Picture) -> None:
    """Draw p downwards from a base line below the plane, and q with it."""
    import pyvista as pv

    base = -0.21
    scale = TRACTION_HEIGHT / max(float(np.abs(picture.p).max()), TINY)
    plotter.add_mesh(
        pv.Line((picture.x[0], base, 0.0), (picture.x[-1], base, 0.0)),
        color=GUIDE_COLOUR,
        line_width=1.5,
    )
    for values, colour, text in ((picture.p, PRESSURE_COLOUR, "p"), (picture.q, SHEAR_COLOUR, "q")):
        points = np.column_stack([picture.x, base - scale * values, np.zeros(len(values))])
        plotter.add_mesh(pv.lines_from_points(points), color=colour, line_width=3)
        # the label stands below the curve, where it is lowest
        k = int(np.argmax(values)) if np.any(values > 0.0) else 0
        plotter.add_point_labels(
            points[[k]] + [0.0, -0.055, 0.0],
            [text],
            font_size=22,
            text_color=colour,
            shape=None,
            show_points=False,
            italic=True,
        )
