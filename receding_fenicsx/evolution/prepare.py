"""Prepare a condensed system for a scene: friction and gap of the nodes, form of the solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from receding_fenicsx.arrays import Array
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.measures.zones import begins_on_axis
from receding_fenicsx.interface.normal_form import eliminate_tangential
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.model import Scene
from receding_fenicsx.scene.profiles import Profile, directions, evaluate, evaluate_checked
from receding_fenicsx.scene.toml_file import known_scene, to_toml

PROFILE_ROUND_OFF = 1e-10
"""Gap or friction, over the largest one along the edge, below which it is round-off of zero."""


def with_profiles(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return a system with the friction and the initial gap of a scene at its contact nodes.

    They are evaluated here only, for a newly condensed body and for a saved one. Body, material,
    mesh, contact edges, loads and supports of the scene must be those that the system was condensed
    from. Probes of another scene are dropped.

    Raises:
        InputError: friction or gap is negative at a node, or cannot be evaluated there.
    """
    pairs = [directions(contact.friction) for contact in scene.contacts]
    f, f_backward = (_values(scene, system, "friction", p) for p in zip(*pairs, strict=True))
    # a support carries the normal force there, not the contact: no friction
    f[system.held[system.n :]] = f_backward[system.held[system.n :]] = 0.0
    gaps = [contact.initial_gap for contact in scene.contacts]
    return replace(
        system,
        f=f,
        g0=_shifted_to_axis(scene, system, _values(scene, system, "initial_gap", gaps)),
        scene_toml=to_toml(scene),
        f_backward=None if np.array_equal(f, f_backward) else f_backward,
        probes=system.probes if scene.probes and has_probes_of(scene, system) else None,
    )


def has_probes_of(scene: Scene, system: ContactSystem) -> bool:
    """Return whether a system has the probes of a scene, for which it need not be condensed."""
    if not scene.probes or system.probes is None or not system.scene_toml:
        return not scene.probes
    return known_scene(system.scene_toml).probes == scene.probes


def system_for(scene: Scene, system: ContactSystem) -> ContactSystem:
    """Return a system with the friction and the gap of a scene, in the form that is evolved.

    Without friction the tangential displacements are eliminated. All arrays are made contiguous, as
    they are when read from a file, so that a saved system gives the same answer bit by bit.

    Raises:
        InputError: as :func:`with_profiles`; or the scene has friction and the system has no
            tangential displacements.
    """
    system = with_profiles(scene, system)
    if system.kind == "frictional" and not np.any(system.friction.present):
        system = eliminate_tangential(system)
    if system.kind == "normal" and np.any(system.friction.present):
        raise InputError(
            "the system has no tangential displacements, since it was condensed without friction; "
            "condense the scene again"
        )
    arrays: dict[str, Any] = {}
    for field in fields(system):
        value = getattr(system, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = np.ascontiguousarray(value)
    return replace(system, **arrays)


def _values(scene: Scene, system: ContactSystem, key: str, profiles: Sequence[Profile]) -> Array:
    """Return the values (N,) of the contacts' profiles at their nodes; refuse negative ones."""
    values = np.empty(system.n)
    for k, profile in enumerate(profiles):
        on = system.edges == k
        found = evaluate_checked(profile, system.x[on], None, f"[contact] {key}")
        values[on] = _without_round_off(found)
    if np.any(values < 0.0):
        i = int(np.argmin(values))
        edge = scene.contacts[system.edges[i]].edge
        raise InputError(
            f"[contact] {key}: is {values[i]:g} at x = {system.x[i]:g} along '{edge}'; it must not "
            "be negative"
        )
    return values


def _without_round_off(values: Array) -> Array:
    """Return values with round-off set to 0, so that a node near x = 0 touches for a gap x^2."""
    is_zero = np.abs(values) <= PROFILE_ROUND_OFF * np.abs(values).max(initial=0.0)
    return np.where(is_zero, 0.0, values)


def _shifted_to_axis(scene: Scene, system: ContactSystem, g0: Array) -> Array:
    """Return the gap of a free body of revolution, shifted so that the body touches on its axis.

    At order 2 the node on the axis has no weight and no contact condition. A free body that touches
    there first would stay above the plane by the gap of the next nodes. It is shifted along the
    axis by the difference, h^2 / (8 R) for a gap r^2 / (2 R) and elements of length h. This rigid
    motion changes no force. A supported body is not shifted; in a stack all bodies above are.
    """
    if not (system.axisymmetric and system.rigid.shape[1]):
        return g0
    for k, contact in enumerate(scene.contacts):
        first = int(np.argmax(system.edges == k))
        on = system.edges == k
        radius = system.points[on, 0]
        if not begins_on_axis(radius, system.weight[on]):
            continue
        # the smallest motion that opens this contact by 1
        w = system.rigid[system.n :]
        share = np.linalg.pinv(w.T @ w) @ w[first]
        if not w[first] @ share > 0.0:
            continue
        lift = _without_round_off(w @ share / (w[first] @ share))
        above = lift > 0.0
        on_axis = float(evaluate(contact.initial_gap, np.zeros(1))[0])
        depth = float((g0[above] / lift[above]).min()) - on_axis
        if depth > 0.0:
            g0 = _without_round_off(g0 - depth * lift)
    return g0
