"""Validate the arrays of a `ContactSystem` and the range of its numbers."""

from __future__ import annotations

import numpy as np

from receding_fenicsx.arrays import Array, brief, check_types
from receding_fenicsx.errors import InputError
from receding_fenicsx.interface.system import ContactSystem, ProbeMatrix

UNSYMMETRIC = 1e-8
"""Difference between K and its transpose, over the largest entry of K, up to which it is round-off
of the condensation."""

LARGEST, SMALLEST = 1e150, 1e-150
"""Range of forces, stiffnesses and energies: products of two of them are numbers of all digits."""

KINDS = {"held": ("b", "booleans"), "edge": ("iu", "whole numbers")}
"""NumPy's kinds of the arrays that may not hold any number, and their name."""


def check_system(system: ContactSystem) -> None:
    """Raise InputError where an array has the wrong shape or values without meaning."""
    optional = ("f_backward", "edge", "slip_map", "cohesion", "shear_limit")
    arrays = ("x", "points", "weight", "K", "r_star", "f", "g0", "held", "rigid")
    for name in (*arrays, *optional, "load_compliance", "load_sign"):
        value, (kinds, what) = getattr(system, name), KINDS.get(name, ("bfiu", "numbers"))
        numbers = isinstance(value, np.ndarray) and value.dtype.kind in kinds
        if not numbers and not (value is None and name in optional):
            raise InputError(
                f"{name} of the contact system has to be an array of {what}, not {brief(value)}"
            )
    names = {key: (getattr(system, key), tuple) for key in ("load_names", "edge_names")}
    flags = {key: (getattr(system, key), bool, np.bool_) for key in ("half", "axisymmetric")}
    probes, text = system.probes, (system.scene_toml, str)
    check_types(
        "contact system", scene_toml=text, probes=(probes, ProbeMatrix, None), **names, **flags
    )
    if system.kind not in ("frictional", "normal") or system.x.ndim != 1:
        raise InputError('the contact system needs kind = "frictional" or "normal", and x (N,)')
    n, loads = system.n, len(system.load_names)
    m = 2 * n if system.kind == "frictional" else n
    nodal = ("weight", "f", "f_backward", "cohesion", "shear_limit", "g0", "edge")
    shapes: dict[str, tuple[int, ...]] = {
        "points": (n, 2),
        "K": (m, m),
        "r_star": (loads, m),
        "held": (2 * n,),
        "slip_map": (n, n + loads),
        # as many motions as it has columns
        "rigid": (2 * n, system.rigid.size // max(2 * n, 1)),
        **dict.fromkeys(nodal, (n,)),
    }
    if system.load_compliance.size:  # empty, there are no conjugate displacements
        shapes |= {"load_compliance": (loads, loads), "load_sign": (loads,)}
    found = [(name, getattr(system, name), shape) for name, shape in shapes.items()]
    if probes is not None:
        k = len(probes.names)
        found += [("probes.points", probes.points, (k, 2))]
        found += [("probes.rows", probes.rows, (k, 6, 2 * n + loads))]
    for name, array, shape in found:
        if array is not None and array.shape != shape:
            raise InputError(
                f"{name} of the contact system has shape {array.shape}, expected {shape}: "
                f"{n} nodes, {loads} loads"
            )
    for name in ("x", "weight", "f", "g0", "f_backward", "cohesion", "shear_limit"):
        if (values := getattr(system, name)) is None:
            continue
        wrong = ~(np.abs(values) <= LARGEST) | ((name != "x") & (values < 0.0))
        if name == "shear_limit":
            wrong &= values != np.inf  # none
        if name in ("f", "f_backward", "weight"):
            # they divide
            wrong |= (values != 0.0) & (np.abs(values) < SMALLEST)
        if np.any(wrong):
            i = int(np.argmax(wrong))
            need = "finite" if name == "x" else "finite and not negative"
            raise InputError(
                f"{name} of the contact system is {values[i]} at node {i} (x = {system.x[i]:.6g}); "
                f"it has to be {need}, 0 or of a size from {SMALLEST:g} to {LARGEST:g}"
            )
    for name in ("f", "f_backward", "cohesion"):
        values = getattr(system, name)
        if values is not None and np.any(values[system.held[n:]] != 0.0):
            i = int(np.argmax(system.held[n:] & (values != 0.0)))
            raise InputError(
                f"{name} of the contact system at node {i}: has to be 0, as a support holds the "
                "node normally and carries the force there"
            )
    step = np.diff(system.edges)
    back = (step < 0) | (np.diff(system.x) < 0.0) & (step == 0)
    if np.any(back):
        i = int(np.argmax(back))
        raise InputError(
            f"x of the contact system falls from node {i} to node {i + 1}; sort the nodes along x "
            "on each edge, edge by edge"
        )
    for name in ("K", "r_star", "rigid"):
        if not np.all(np.abs(getattr(system, name)) <= LARGEST):
            raise InputError(
                f"{name} of the contact system has entries that are not finite, or beyond "
                f"{LARGEST:g}"
            )
    K, largest = system.K, float(np.abs(system.K).max(initial=0.0))
    if float(np.abs(K - K.T).max(initial=0.0)) > UNSYMMETRIC * largest:
        raise InputError("K of the contact system is not symmetric")
    if system.rigid.size:
        rows = slice(2 * n - m, None)
        force = np.where(system.held[rows, None], 0.0, K @ system.rigid[rows])
        if float(np.abs(force).max()) > 1e-8 * largest * float(np.abs(system.rigid).max()):
            raise InputError(
                "rigid of the contact system holds a motion that its K resists: K @ rigid has to "
                "vanish"
            )


def check_range(system: ContactSystem, factors: Array) -> None:
    """Raise InputError where forces or energies would leave the range of the numbers.

    ``factors`` are the (n, n_loads) load factors that the body is to bear.
    """
    with np.errstate(over="ignore"):
        force = float((np.abs(factors) @ np.abs(system.r_star)).max(initial=0.0))
    stiffness = float(np.abs(system.K).max(initial=0.0))
    if not force or not stiffness:
        return
    sizes = {"forces": force, "stiffnesses": stiffness, "energies": force * (force / stiffness)}
    for name, size in sizes.items():
        if not SMALLEST < size < LARGEST:
            raise InputError(
                f"the contact system has {name} of about {size:.0e}, beyond the range of the "
                "computer's numbers; choose units in which they are nearer to 1"
            )
