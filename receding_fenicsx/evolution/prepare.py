"""Put a condensed system to use for a scene: its friction and gap, and the form of the solvers."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.measures.axis import midside_beside_axis
from receding_fenicsx.interface.normal_form import eliminate_tangential
from receding_fenicsx.interface.system import Array, ContactSystem
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.profiles import evaluate
from receding_fenicsx.scene.toml_file import to_toml

PROFILE_ROUND_OFF = 1e-10
"""Gap or friction, over the largest one along the edge, that is zero but for round-off."""


def with_profiles(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return a system with the friction and the initial gap of a scene at its contact nodes.

    This is the only place where they are evaluated, for a body that has just been condensed and
    for a saved one alike. Body, material, mesh, contact edges, loads and supports of the scene must
    be those that the system was condensed from.

    Raises:
        InputError: friction or gap is negative at a node, or cannot be evaluated there.
    """
    f = _values(scene, system, "friction")
    # what a support carries normal to the plane is no pressure of the contact: no friction there
    f[system.held[system.n :]] = 0.0
    g0 = _laid_on_axis(scene, system, _values(scene, system, "initial_gap"))
    return replace(system, f=f, g0=g0, scene_toml=to_toml(scene))


def system_for(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Give a system the friction and the gap of a scene, and the form that the solvers want.

    Without friction the tangential displacements are eliminated. All arrays are laid out as they
    are when read from a file, so that a saved system gives the same answer in every bit.

    Raises:
        InputError: as :func:`with_profiles`; or the system has no tangential displacements any more
            and the scene has friction.
    """
    system = with_profiles(scene, system)
    if system.kind == "frictional" and not np.any(system.friction.present):
        system = eliminate_tangential(system)
    if system.kind == "normal" and np.any(system.friction.present):
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


def _values(scene: Scene, system: ContactSystem, key: str) -> Array:
    """Return the values (N,) of a profile of the contacts at their nodes, none of them negative."""
    values = np.empty(system.n)
    for k, contact in enumerate(scene.contacts):
        on = system.edges == k
        values[on] = _cleared(evaluate(getattr(contact, key), system.x[on]))
    if np.any(values < 0.0):
        i = int(np.argmin(values))
        edge = scene.contacts[system.edges[i]].edge
        raise InputError(
            f"[contact] {key}: is {values[i]:g} at x = {system.x[i]:g} along '{edge}'; it must not "
            "be negative"
        )
    return values


def _cleared(values: Array) -> Array:
    """Return values without round-off: a node beside x = 0 touches where the gap is x^2."""
    slight = np.abs(values) <= PROFILE_ROUND_OFF * np.abs(values).max(initial=0.0)
    return np.where(slight, 0.0, values)


def _laid_on_axis(scene: Scene, system: ContactSystem, g0: Array) -> Array:
    """Return the gap of a free body of revolution from where it touches on its axis.

    At order 2 the node on the axis has no weight and no contact condition. A free body that touches
    there first would hover above the plane by the gap of the nodes beside it; it is moved along
    the axis by the difference, h^2 / (8 R) for a gap r^2 / (2 R) and elements of length h. As a
    rigid motion that changes no force. A supported body keeps its place.
    """
    if not (system.axisymmetric and system.rigid.shape[1]):
        return g0
    for k, contact in enumerate(scene.contacts):
        first = int(np.argmax(system.edges == k))
        on = system.edges == k
        if not midside_beside_axis(system.x[on], system.weight[on]):
            continue
        lift = system.rigid[system.n :, 0] / system.rigid[system.n + first, 0]
        above = lift > 0.0
        on_axis = float(evaluate(contact.initial_gap, np.zeros(1))[0])
        depth = float((g0[above] / lift[above]).min()) - on_axis
        if depth > 0.0:
            g0 = _cleared(g0 - depth * lift)
    return g0
