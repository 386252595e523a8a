"""A condensed system put to use for a scene with its own friction, gap and history."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.contact import Array, ContactSystem
from receding_fenicsx.interface.forms import eliminate_tangential
from receding_fenicsx.scene import Contact, Scene, evaluate
from receding_fenicsx.scene_file import from_toml, to_toml


def system_for(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Give a system the friction and the gap of a scene, and the form that the solvers want.

    Body, material, mesh, contact edges, loads and supports of the scene must be those that the
    system was condensed from. Without friction the tangential displacements are eliminated. All
    arrays are laid out as they are when read from a file, so that a saved system gives the same
    answer in every bit.

    Raises:
        InputError: the system has no tangential displacements any more and the scene has friction.
    """
    text = to_toml(scene)
    if text != system.scene_toml:
        old = from_toml(system.scene_toml).contacts
        f = _values(system, system.f, "friction", old, scene)
        f[system.held[system.n :]] = 0.0
        g0 = _values(system, system.g0, "initial_gap", old, scene)
        system = replace(system, f=f, g0=g0)
    system = replace(system, scene_toml=text)
    if system.kind == "frictional" and not np.any(system.f):
        system = eliminate_tangential(system)
    if system.kind == "normal" and np.any(system.f):
        raise InputError(
            "the system has no tangential displacements, being one of a contact without friction; "
            "condense the scene again"
        )
    laid_out: dict[str, Any] = {}
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray):
            laid_out[field.name] = np.ascontiguousarray(value)
    return replace(system, **laid_out)


def _values(
    system: ContactSystem, before: Array, key: str, old: tuple[Contact, ...], scene: Scene
) -> Array:
    """Return a profile's values at the contact nodes, those from before where it is the same."""
    values = before.copy()
    for k, contact in enumerate(scene.contacts):
        if getattr(old[k], key) == getattr(contact, key):
            continue
        on = system.edges == k
        values[on] = evaluate(getattr(contact, key), system.x[on])
    if np.any(values < 0.0):
        i = int(np.argmin(values))
        edge = scene.contacts[system.edges[i]].edge
        raise InputError(
            f"[contact] {key}: is {values[i]:g} at x = {system.x[i]:g} along '{edge}'; it must not "
            "be negative"
        )
    return values
