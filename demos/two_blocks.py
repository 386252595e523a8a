"""Two blocks pressed together: zero of the bonded pair and contact with lift-off (Filon).

**Problem.** Two equal blocks of height h are pressed together by opposite forces on |x| < b (Fig. 1
of Ahn & Barber 2008). By symmetry one block on a rigid frictionless plane stands for the pair.

**Equations.** If the blocks could not separate, the normal traction on their common plane would be
that of one piece of height 2h: the condensed reactions r_star with all contact nodes held. It
turns from pressure to tension at x/h = 1.338 under concentrated forces (Filon; about 1.35 in Coker
and Filon). With separation, P >= 0 and w >= 0, the contact ends further in.

**What to look for.** For a concentrated force and uniform loads on |x| < h/2 and |x| < 2h: the zero
of the bonded pair against its closed form, and the half width of the contact with lift-off against
a singular integral equation. Lift-off makes the contact clearly smaller than Filon's value.

The demo shows how to use a condensed system by itself (``system.r_star``) and with a scene.
"""

from functools import partial
from pathlib import Path

from mpi4py import MPI

from scipy.optimize import brentq

import receding_fenicsx as rf

HERE = Path(__file__).parent
bilateral_pressure = rf.reference.closed_forms.bilateral_pressure
POINT = 0.025
"""Half width over h of the strip that carries a concentrated force."""
INSIDE = (0.5, 3.5)
"""Interval of x / h that is searched for zeros."""
ZERO_TOLERANCE, WIDTH_TOLERANCE = 1e-4, 1e-3
"""Relative errors allowed of the zero of the bonded pair and of the half width."""


def pressed(load: float, *others: str) -> rf.Scene:
    """Return the scene with a unit force on |x| < load, and other changes."""
    changes = [f"load.F.span=[{-load}, {load}]", f"load.F.pressure={0.5 / load}", *others]
    return rf.read_scene(HERE / "two_blocks.toml", changes)


def zero_of_bonded(system: rf.ContactSystem) -> float:
    """Return where the pressure changes sign if no node may lift off (and all slide freely)."""
    held = system.r_star[0]
    return float(brentq(lambda x: rf.traction_at(system.x, system.weight, held, x), *INSIDE))


def both(system: rf.ContactSystem, scene: rf.Scene) -> tuple[float, float]:
    """Return the zero of the bonded pair, and the half width of the contact with lift-off."""
    record = rf.evolve(system, scene)
    width = rf.half_width_estimates(record, -1)["contact_half_width_estimate"]["value"]
    return zero_of_bonded(system), width


def compare(load: float, system: rf.ContactSystem | None, scene: rf.Scene) -> None:
    """Print a row of the table; assert the errors, and that lift-off makes the contact smaller."""
    zero, width = both(rf.given(system), scene)
    exact = brentq(lambda x: float(bilateral_pressure(x, load)), *INSIDE)
    known = rf.reference.layer.contact_half_width(load)
    errors = abs(zero / exact - 1.0), abs(width / known - 1.0)
    print(f"|x| < {load:5.3f} h  {zero:18.5f}  {errors[0]:.1e}  {width:21.5f}  {errors[1]:.1e}")
    assert errors[0] < ZERO_TOLERANCE, "zero of the bonded pair"
    assert errors[1] < WIDTH_TOLERANCE, "half width with lift-off"
    assert width < 0.9 * zero, "lift-off must make the contact smaller"
    if load == POINT:
        filon = rf.reference.closed_forms.FILON_ZERO
        assert abs(zero - filon) < 1e-3, "Filon's value is that of the bonded pair"


def main() -> None:
    """Print the table for three loads."""
    comm = MPI.COMM_WORLD
    if comm.rank == 0:
        print("loaded on       bonded: zero x/h  error    lift-off: half width/h  error")
    for load in (POINT, 0.5, 2.0):
        scene = pressed(load)
        system = rf.condense(scene)
        rf.on_root(comm, partial(compare, load, system, scene))


if __name__ == "__main__":
    main()
