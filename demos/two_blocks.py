"""Two blocks pressed together: where the unseparated pair would pull, and where the contact ends.

The paper's Fig. 1 goes back to Filon and to Coker and Filon, who give a contact half width of
about 1.35 block thicknesses under concentrated forces. That is the place x / h = 1.338 where the
stress on the middle plane of one *unseparated* piece of height 2h turns from pressure to tension.
Blocks that can lift off do so further in: the tension that is not there no longer holds them down.

You will see both, for a concentrated force and for uniform loads on |x| < h/2 and |x| < 2h: the
zero of the unseparated pair against its closed form, and the half width of the contact against a
singular integral equation. By symmetry one block on a rigid frictionless plane stands for the two.
The demo shows how to use a condensed system by itself: its reactions with all contact nodes held
(``r_star``) are the pressures of the unseparated pair.
"""

from pathlib import Path

from mpi4py import MPI

from scipy.optimize import brentq

import receding_fenicsx as rf

HERE = Path(__file__).parent
POINT = 0.025
"""Half width over h of the strip that carries a concentrated force."""
INSIDE = (0.5, 3.5)
"""Where the zeros are looked for, x / h."""
ZERO_TOLERANCE, WIDTH_TOLERANCE = 1e-4, 1e-3
"""Relative errors allowed of the zero of the unseparated pair and of the half width."""


def pressed(load: float, *others: str) -> rf.Scene:
    """The scene with a unit force on |x| < load, and other changes."""
    changes = [f"load.F.span=[{-load}, {load}]", f"load.F.pressure={0.5 / load}", *others]
    return rf.read_scene(HERE / "two_blocks.toml", changes)


def zero_of_unseparated(system: rf.ContactSystem) -> float:
    """Where the pressure changes sign when no node may lift off (and all slide freely)."""
    return float(
        brentq(lambda x: rf.traction_at(system.x, system.weight, system.r_star[0], x), *INSIDE)
    )


def both(system: rf.ContactSystem, scene: rf.Scene) -> tuple[float, float]:
    """Zero of the unseparated pair, and half width of the contact with lift-off."""
    record = rf.evolve(system, scene)
    return zero_of_unseparated(system), rf.half_width_estimates(record, -1)[
        "contact_half_width_estimate"
    ]["value"]


def main() -> None:
    """Print the table; assert errors, and that lift-off makes the contact smaller."""
    comm = MPI.COMM_WORLD
    if comm.rank == 0:
        print("loaded on       unseparated: zero x/h  error    lift-off: half width/h  error")
    for load in (POINT, 0.5, 2.0):
        scene = pressed(load)
        system = rf.condense(scene)

        def report(
            load: float = load, scene: rf.Scene = scene, system: rf.ContactSystem | None = system
        ) -> None:
            assert system is not None
            zero, width = both(system, scene)
            exact = brentq(
                lambda x: float(rf.reference.closed_forms.bilateral_pressure(x, load)), *INSIDE
            )
            errors = (
                abs(zero / exact - 1.0),
                abs(width / rf.reference.layer.contact_half_width(load) - 1.0),
            )
            shown = f"{zero:23.5f}  {errors[0]:.1e}  {width:21.5f}  {errors[1]:.1e}"
            print(f"|x| < {load:5.3f} h  {shown}")
            assert errors[0] < ZERO_TOLERANCE, "zero of the unseparated pair"
            assert errors[1] < WIDTH_TOLERANCE, "half width with lift-off"
            assert width < 0.9 * zero, "lift-off must make the contact smaller"
            if load == POINT:
                assert abs(zero - rf.reference.closed_forms.FILON_ZERO) < 1e-3, (
                    "Filon's value is that of the unseparated pair"
                )

        rf.on_root(comm, report)
    if comm.rank == 0:
        print("Filon's 1.338 thicknesses (about 1.35 in Coker and Filon) is the zero of an")
        print("unseparated pair; two blocks that lift off touch over clearly less.")


if __name__ == "__main__":
    main()
