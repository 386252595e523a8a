"""Where two scenes differ: whether a saved system or an interrupted run belongs to a scene."""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.scene.toml_file import ARRAYS, to_toml

FREE_WHEN_RESUMED = frozenset({"title", "history.cycles", "history.until", "output.cycles"})
"""Keys that may change when a run is gone on with: none changes a bit of the finished cycles."""
FREE_WHEN_FINISHED = frozenset({"history.cycles", "history.until"})
"""Keys whose change alone leaves nothing to do on a run that has gone as far as is asked."""

TABLE_OF = {attribute: name for name, (_, attribute) in ARRAYS.items()}
TABLE_OF |= {"others": "body", "materials": "material"}
"""Names in a scene file of what occurs several times in a scene."""


def difference(a: Any, b: Any, free: frozenset[str] = frozenset(), key: str = "") -> str | None:
    """Return the first key by which two scenes, or tables of them, differ.

    Args:
        a: one of them.
        b: the other.
        free: keys that may differ, "table.key".
        key: where they stand.

    Returns:
        "[table] key" as messages name it, or None.
    """
    if key in free:
        return None
    if dataclasses.is_dataclass(a) and type(a) is type(b):
        for field in dataclasses.fields(a):
            name = TABLE_OF.get(field.name, field.name)
            below = f"{key}.{name}" if key else name
            found = difference(getattr(a, field.name), getattr(b, field.name), free, below)
            if found is not None:
                return found
        return None
    if isinstance(a, tuple) and any(map(dataclasses.is_dataclass, a)) and len(a) == len(b):
        pairs = (difference(x, y, free, key) for x, y in zip(a, b, strict=True))
        return next((found for found in pairs if found is not None), None)
    if a == b:
        return None
    table, _, last = key.rpartition(".")
    return f"[{table}] {last}" if table else key


def condensed_part(scene: Scene) -> Scene:
    """Return the scene without what its condensed system does not depend on.

    Friction and gap are evaluated anew when a system is used; history, solver and output play no
    part in it. A mesh file counts by its content, see :func:`digest`.
    """
    if not scene.others:
        # what is written with a system is the scene of the body alone
        scene = part_of(scene, scene.body)
    bodies = [replace(body, mesh=body.mesh and "file") for body in scene.bodies]
    return Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        material=scene.material,
        materials=scene.materials,
        mesh=scene.mesh,
        contacts=tuple(replace(c, friction=0.0, initial_gap=0.0) for c in scene.contacts),
        loads=scene.loads,
        supports=scene.supports,
    )


def body_difference(a: Scene, b: Scene) -> str | None:
    """Return the first thing by which the condensed bodies of two scenes differ, or None.

    Mesh files of the same path are taken for the same.
    """
    found = difference(condensed_part(a), condensed_part(b))
    if found is None and is_half_meshed(a) != is_half_meshed(b):
        found = "symmetry"
    meshes = [[body.mesh for body in scene.bodies] for scene in (a, b)]
    if found is None and meshes[0] != meshes[1] and digest(a) != digest(b):
        found = "mesh file"
    return found


def digest(scene: Scene) -> str:
    """SHA-256 of all of a scene that its condensed system depends on, mesh files included."""
    whole = scene if scene.others else part_of(scene, scene.body)
    half = is_half_meshed(whole)
    found = hashlib.sha256(f"{half}\n{to_toml(condensed_part(scene))}".encode())
    for body in scene.bodies:
        if body.mesh is not None:
            try:
                found.update(Path(body.mesh).read_bytes())
            except OSError:
                raise InputError(
                    f'[body] mesh: "{body.mesh}": no such file; check the path'
                ) from None
    return found.hexdigest()
