"""Random stacks of blocks whose joints do not match, as problems of ``problems.py``."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import problems
from problems import Problem

import receding_fenicsx as rf
from receding_fenicsx.evolution.problem import system_for


def scene_of(number: int) -> rf.Scene:
    """Two to four blocks, each narrower than the one below and beside its middle.

    They touch or are tied; the lowest touches a plane or stands on a support.
    """
    rng = np.random.default_rng([number, 1908])
    count = 2 + int(rng.integers(3))
    bodies, contacts, ties, materials, x, y, width = [], [], [], [], 0.0, 0.0, 4.0
    for k in range(count):
        name = f"b{k}"
        height = float(rng.uniform(0.3, 1.2))
        bodies.append(rf.Body(name, width=width, height=height, position=(x, y)))
        poisson = float(rng.uniform(0.0, 0.45))
        materials.append(rf.Material(float(10.0 ** rng.uniform(-1.0, 1.0)), poisson, name=name))
        # the last joint is always a contact
        tied = k < count - 1 and rng.random() < 0.3
        if k == 0 and not tied and rng.random() < 0.5:
            contacts.append(rf.Contact("b0.bottom", friction=float(rng.uniform(0.2, 1.2))))
        elif k:
            edges = f"{name}.bottom", f"b{k - 1}.top"
            gap = "0.02*x**2" if rng.random() < 0.2 else 0.0
            friction = float(rng.uniform(0.1, 1.2))
            if tied:
                ties.append(rf.Tie(edges[0], against=edges[1], slave="edge"))
            else:
                contacts.append(
                    rf.Contact(
                        edges[0], friction=friction, initial_gap=gap, against=edges[1], slave="edge"
                    )
                )
        y += height
        room = width * float(rng.uniform(0.05, 0.3))
        x += float(rng.uniform(-0.45, 0.45)) * room
        width -= room
    on_plane = any(contact.against is None for contact in contacts)
    top = bodies[-1].name
    loads = (
        rf.Load("p", f"{top}.top", pressure=1.0),
        rf.Load("q", f"{top}.top", traction=(float(rng.uniform(-0.3, 0.3)), 0.0)),
        rf.Load("s", f"b0.{rng.choice(['left', 'right'])}", pressure=float(rng.uniform(0.02, 0.2))),
    )
    degree, cell = 1 + int(rng.random() < 0.3), str(rng.choice(["triangle", "quadrilateral"]))
    return rf.Scene(
        body=bodies[0],
        others=tuple(bodies[1:]),
        materials=tuple(materials),
        mesh=rf.MeshOptions(4, cell, degree, growth=1.6),
        contacts=tuple(contacts),
        ties=tuple(ties),
        loads=loads,
        supports=() if on_plane else (rf.Support("xy", edge="b0.bottom"),),
        solver=rf.SolverOptions(symmetry="none"),
        history=rf.HistoryOptions(
            kind="table", columns=("p", "q", "s"), rows=((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
        ),
    )


def stacked(p: Problem) -> Problem:
    """Return the problem of a stack, with the solver of a problem of the same number."""
    scene = scene_of(p.number)
    system = system_for(scene, rf.given(rf.condense(scene, MPI.COMM_SELF)))
    rng = np.random.default_rng([p.number, 12])
    tags = (f"{len(scene.bodies)} bodies", "tied" if scene.ties else "")
    return Problem(p.number, system, problems.random_history(rng, system, False), p.solver, tags)


FAMILIES = {**problems.FAMILIES, "stack": stacked}
"""What becomes of the problem of a number, by name, with the stacks that take the FEM."""
