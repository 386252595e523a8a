"""Comparison of scenes: whether a saved system or an interrupted run belongs to a scene."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from receding_fenicsx.errors import InputError
from receding_fenicsx.scene.model import TABLE_OF, Scene
from receding_fenicsx.scene.one_body import part_of
from receding_fenicsx.scene.options import OutputOptions
from receding_fenicsx.scene.symmetry import is_half_meshed
from receding_fenicsx.scene.toml_file import to_toml


def difference(a: Any, b: Any, free: frozenset[str] = frozenset(), key: str = "") -> str | None:
    """Return the first key, "[table] key", in which parts of scenes differ, but for ``free``."""
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
    """Return a scene reduced to the data, but mesh files, that determine its condensed system."""
    ties = scene.ties
    if not scene.others:
        # a system file stores the scene of its single body
        scene = part_of(replace(scene, ties=()), scene.body)
    bodies = [replace(body, mesh=body.mesh and "file") for body in scene.bodies]
    kept = ("material", "materials", "mesh", "loads", "supports", "springs")
    return Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        **{name: getattr(scene, name) for name in kept},
        contacts=tuple(
            replace(c, friction=0.0, initial_gap=0.0, shear_limit=None, cohesion=None)
            for c in scene.contacts
        ),
        ties=ties,
        bolts=tuple(
            replace(bolt, shortening=0.0, preload=None, tightening=()) for bolt in scene.bolts
        ),
        # the default was explicit when the first systems were saved, whose digests it enters
        output=OutputOptions(samples_per_leg=40),
    )


def body_difference(a: Scene, b: Scene) -> str | None:
    """Return the first difference of two condensed bodies; mesh files of one path are equal."""
    found = difference(condensed_part(a), condensed_part(b))
    if found is None and is_half_meshed(a) != is_half_meshed(b):
        found = "symmetry"
    meshes = [[body.mesh for body in scene.bodies] for scene in (a, b)]
    if found is None and meshes[0] != meshes[1] and digest(a) != digest(b):
        found = "mesh file"
    return found


def digest(scene: Scene) -> str:
    """Return the SHA-256 of the data that determine the condensed system, mesh files included."""
    half = is_half_meshed(scene if scene.others else part_of(scene, scene.body))
    found = hashlib.sha256(f"{half}\n{to_toml(condensed_part(scene))}".encode())
    for body in (body for body in scene.bodies if body.mesh is not None):
        try:
            first, *more = (file.read_bytes() for file in mesh_files(Path(str(body.mesh))))
        except (OSError, ValueError):  # it cannot be read, or is none
            raise InputError(f'[body] mesh: "{body.mesh}": no such file') from None
        found.update(b"".join([first, *more]))
    return found.hexdigest()


def mesh_files(path: Path) -> list[Path]:
    """Return a mesh file and the files that it includes, those that there are, each once."""
    found, todo = list[Path](), [path]
    while todo:
        file = todo.pop()
        if file in found or not file.is_file():
            continue
        found.append(file)
        if file.suffix == ".geo":
            names = re.findall(r'(?:Include|Merge)\s*"([^"]+)"', geo_text(file))
            todo += [(file.parent / name).resolve() for name in names]
    return found


def geo_text(path: Path) -> str:
    """Return the text of a .geo file without comments."""
    text = path.read_text(encoding="utf-8", errors="replace")
    return re.sub(r'(?s)("[^"]*")|//[^\n]*|/\*.*?\*/', r"\1", text)  # strings may hold //


def body_of(scene: Scene) -> str:
    """Return the digest of what determines a condensed system, which holds its probes too."""
    return hashlib.sha256(f"{digest(scene)}\n{scene.probes!r}".encode()).hexdigest()


def identity_of(scene: Scene, *more: Any) -> str:
    """Return the digest of a scene but for its title, of its mesh files, and of further values."""
    text = "\n".join([body_of(scene), to_toml(replace(scene, title="")), *map(repr, more)])
    return hashlib.sha256(text.encode()).hexdigest()
