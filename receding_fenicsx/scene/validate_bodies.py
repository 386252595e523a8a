"""Checks of a scene's bodies, materials and mesh options.

Every message is one line: the table and key, what is wrong, what to do.
"""

from __future__ import annotations

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import (
    HORIZONTAL,
    OF_RECTANGLES,
    Body,
    Material,
    MeshOptions,
    Scene,
    is_cylinder,
)
from receding_fenicsx.scene.toml_values import unknown_name

LEAST_CONTACT_ELEMENTS = 4
"""Fewer elements on the contact edge cannot show stick, slip and separation side by side."""
MOST_CONTACT_ELEMENTS = 20000
"""The condensed stiffness of more would fill tens of gigabytes."""
LEAST_HOLE = 1e-6
"""Radius of a ring's hole, over its width, up to which the ring reaches the axis."""
SLENDEREST = 1e5
"""Largest depth of a rectangle below its contact edge, over the length of that edge."""
FARTHEST = 1e4
"""Largest coordinate of a rectangle's position, over its smaller side: beyond, round-off shows."""
MOST_CELLS = 1e8
"""Cells of a rectangle, about, that no machine meshes and factors."""
THINNEST = 0.01
"""Smallest depth of a rectangle below its contact edge, over the size of an element there."""
LARGEST, SMALLEST = 1e50, 1e-50
"""Sizes of numbers whose products and quotients, of up to six of them, are still numbers."""


def check_size(value: float, where: str) -> None:
    """Raise InputError for a number that arithmetic would make infinite."""
    if not abs(value) <= LARGEST:
        raise InputError(
            f"{where}: {value:g} is beyond {LARGEST:g}; choose units in which it is nearer to 1"
        )


def check_positive(value: float, where: str) -> None:
    """Raise InputError for a value that is not positive."""
    if not value > 0.0:
        raise InputError(f"{where}: must be positive, not {value:g}")
    if value < SMALLEST:
        raise InputError(
            f"{where}: {value:g} is below {SMALLEST:g}; choose units in which it is nearer to 1"
        )


def check_count(value: int, most: int, where: str) -> None:
    """Raise InputError for a number of things that is not positive, or more than ``most``."""
    check_positive(value, where)
    if value > most:
        raise InputError(f"{where}: must be at most {most}, not {value}")


def check_choice(value: object, choices: tuple[str, ...], where: str) -> None:
    """Raise InputError for a value that is none of the choices."""
    if value not in choices:
        raise InputError(f'{where}: "{value}" is unknown; use one of {", ".join(choices)}')


def check_bodies(scene: Scene) -> None:
    """Check names, shapes and materials of the bodies."""
    names = [body.name for body in scene.bodies]
    if len(names) > 2:
        raise InputError(f"[[body]]: the scene has {len(names)}, two at most can be modelled")
    for name in names:
        if scene.others and not name.strip():
            raise InputError("[[body]] name: is missing; give each body a name")
        if "." in name:
            raise InputError(f'[[body]] name: "{name}" holds a dot; leave it out')
        if names.count(name) > 1:
            raise InputError(
                f"body '{name}': {names.count(name)} bodies have this name; rename one"
            )
    known = [material.name for material in scene.materials]
    for body in scene.bodies:
        label = f"body '{body.name}'" if scene.others else "[body]"
        _check_body(body, label)
        if body.material is not None and body.material not in known:
            unknown_name(body.material, known, f"{label} material", "material")
    used = [scene.material_of(body) for body in scene.bodies]
    for material in scene.materials:
        if material not in used:
            raise InputError(
                f"[material.{material.name}]: no body is made of it; name it in a [[body]]"
            )
    for material in used:
        _check_material(material)
    if len({material.kinematics for material in used}) > 1:
        raise InputError(
            "[material] kinematics: differs from body to body; use the same for all of them"
        )
    for body in scene.bodies:
        if scene.axisymmetric and body.mesh is None:
            _check_radii(scene, body, f"body '{body.name}'" if scene.others else "[body]")


def _check_body(body: Body, label: str) -> None:
    if body.mesh is not None:
        default = Body()
        for key in OF_RECTANGLES:
            if getattr(body, key) != getattr(default, key):
                raise InputError(f"{label} {key}: is that of a rectangle; leave out it or mesh")
        return
    for key in ("surface", "parameters"):
        if getattr(body, key):
            raise InputError(f"{label} {key}: needs a mesh file; give mesh, or leave it out")
    check_choice(body.shape, ("rectangle",), f"{label} shape")
    check_positive(body.width, f"{label} width")
    check_positive(body.height, f"{label} height")
    if max(map(abs, body.position)) > FARTHEST * min(body.width, body.height):
        raise InputError(
            f"{label} position: [{body.position[0]:g}, {body.position[1]:g}] is more than "
            f"{FARTHEST:g} times the body's size from the origin; put it nearer"
        )


def _check_radii(scene: Scene, body: Body, label: str) -> None:
    """Refuse a ring that reaches the axis."""
    x = body.position[0]
    if not is_cylinder(scene, body) and not x - 0.5 * body.width > LEAST_HOLE * body.width:
        raise InputError(
            f"{label} position: x = {x:g} and width {body.width:g} make a ring from "
            f"r = {x - 0.5 * body.width:g} to {x + 0.5 * body.width:g}; keep it off the axis "
            "r = 0, or put a cylinder (its width is the diameter) at x = 0"
        )


def _check_material(material: Material) -> None:
    where = f"[material.{material.name}]" if material.name else "[material]"
    check_positive(material.young, f"{where} young")
    choices = ("plane strain", "plane stress", "axisymmetric")
    check_choice(material.kinematics, choices, f"{where} kinematics")
    if not -1.0 < material.poisson < material.poisson_limit:
        raise InputError(
            f"{where} poisson: must lie above -1 and below {material.poisson_limit:g} in "
            f"{material.kinematics}, "
            f"not {material.poisson:g}"
        )


def check_mesh(scene: Scene) -> None:
    """Check the options of the mesh."""
    mesh = scene.mesh
    n = mesh.contact_elements
    if not LEAST_CONTACT_ELEMENTS <= n <= MOST_CONTACT_ELEMENTS:
        raise InputError(
            f"[mesh] contact_elements: {n} is too "
            f"{'few' if n < LEAST_CONTACT_ELEMENTS else 'many'}; "
            f"use {LEAST_CONTACT_ELEMENTS} to {MOST_CONTACT_ELEMENTS}"
        )
    if n % 2 and any(body.mesh is None for body in scene.bodies):
        raise InputError(
            f"[mesh] contact_elements: {n} is odd; use an even number, half of them on each side "
            "of x = 0"
        )
    check_choice(mesh.cell, ("triangle", "quadrilateral"), "[mesh] cell")
    if mesh.degree not in (1, 2):
        raise InputError(f"[mesh] degree: {mesh.degree} is not available; use 1 or 2")
    if not 1.0 <= mesh.growth <= 3.0:
        raise InputError(
            f"[mesh] growth: {mesh.growth:g} is no size ratio of layers; use 1 (uniform) to 3"
        )


def count_cells(mesh: MeshOptions, slenderness: float) -> float:
    """Return about how many triangles fill a rectangle.

    Args:
        mesh: how it is meshed.
        slenderness: its depth below the contact edge over the length of that edge.
    """
    layers = mesh.contact_elements * slenderness
    if mesh.growth > 1.0:
        # a layer of size dx growth^k has n / growth^k elements side by side
        layers = min(layers, mesh.growth / (mesh.growth - 1.0))
    return 2.0 * mesh.contact_elements * layers


def check_elements(mesh: MeshOptions, body: Body, edge: str) -> None:
    """Refuse a rectangle that elements of its contact edge's size cannot fill well."""
    flat = edge in HORIZONTAL
    depth, length = (body.height, body.width) if flat else (body.width, body.height)
    size = length / mesh.contact_elements
    key = "height" if flat else "width"
    if depth < THINNEST * size:
        raise InputError(
            f"[body] {key}: {depth:g} is less than {THINNEST:g} of an element of the contact edge "
            f"({size:.3g}); enlarge it, or mesh.contact_elements"
        )
    if depth > SLENDEREST * length:
        raise InputError(
            f"[body] {key}: {depth:g} is more than {SLENDEREST:g} times the contact edge's length; "
            "shorten it, what lies so far away has no effect"
        )
    cells = count_cells(mesh, depth / length)
    if cells > MOST_CELLS:
        raise InputError(
            f"[mesh] growth: {mesh.growth:g} would fill the body with about {cells:.0e} cells; "
            "enlarge it, or use fewer contact_elements"
        )
