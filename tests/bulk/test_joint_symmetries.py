"""Joints of assemblies: halves, mirror images, ranks, resultants, and curved joints' stiffness."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from images import Image, image_for
from msh import grid, ring, write_msh

import receding_fenicsx as rf
from receding_fenicsx.arrays import Array
from receding_fenicsx.bulk import stack
from receding_fenicsx.bulk.fields import probe_matrix
from receding_fenicsx.bulk.from_scene import bulk_of
from receding_fenicsx.bulk.mesh.meshing import raw_meshes
from receding_fenicsx.bulk.stack import Stack
from receding_fenicsx.timing import Timer

comm = MPI.COMM_WORLD
DEMOS = Path(__file__).parents[2] / "demos"


def demo(name: str, *changes: str) -> Callable[[Path], rf.Scene]:
    """A demo's scene, on a coarse mesh."""
    return lambda folder: rf.read_scene(DEMOS / f"{name}.toml", list(changes))


def bush(folder: Path) -> rf.Scene:
    """A bush of its size in a hole, driven by its bore, whose nodes do not match."""
    bodies = []
    for name, n, low, high in (("i", 24, 0.4, 1.0), ("o", 17, 1.0, 2.5)):
        at = ring(low, high, -0.5 * np.pi)
        bodies.append(rf.Body(name, mesh=grid(folder / f"{name}.msh", at, 2 * n, 5)))
    return rf.Scene(
        body=bodies[0],
        others=(bodies[1],),
        material=rf.Material(1.0, 0.3),
        mesh=rf.MeshOptions(cell="quadrilateral"),
        contacts=(rf.Contact("i.top", against="o.bottom", friction=0.3),),
        loads=(rf.Load("F", "i.bottom", traction=(0.3, -1.0)),),
        supports=(rf.Support("xy", edge="o.top"),),
        history=rf.HistoryOptions("cyclic", load="F", minimum=-0.4, cycles=2),
    )


def coat(folder: Path) -> rf.Scene:
    """A coat tied to a back plate whose nodes do not match, rubbed to and fro."""
    layers = [
        rf.Body(name, mesh=grid(folder / f"{name}.msh", at, n, 3))
        for name, n, at in (
            ("a", 20, lambda s, t: (4.0 * s - 2.0, 0.5 * t)),
            ("b", 13, lambda s, t: (4.0 * s - 2.0, 0.5 + 0.5 * t)),
        )
    ]
    return rf.Scene(
        body=layers[0],
        others=(layers[1],),
        material=rf.Material(2.0, 0.3),
        materials=(rf.Material(0.5, 0.4, name="a"),),
        mesh=rf.MeshOptions(cell="quadrilateral"),
        contacts=(rf.Contact("a.bottom", friction=0.4),),
        ties=(rf.Tie("b.bottom", against="a.top"),),
        loads=(
            rf.Load("p", "b.top", pressure="1 + 0.2*x"),
            rf.Load("q", "b.right", traction=(0.3, 0.1)),
        ),
        history=rf.HistoryOptions("cyclic", load="q", minimum=-1.0, cycles=2, constant={"p": 1.0}),
        probes=(rf.Probe("s", points=((0.3, 0.2), (-2.0, 0.5)), body="a"),),
    )


def corner(folder: Path) -> rf.Scene:
    """A block pushed unevenly into a corner, to and fro."""
    return rf.Scene(
        body=rf.Body(mesh=grid(folder / "c.msh", lambda s, t: (s, t), 10, 10)),
        material=rf.Material(100.0),
        mesh=rf.MeshOptions(cell="quadrilateral"),
        contacts=(rf.Contact("bottom", friction=0.3), rf.Contact("left", friction=0.2)),
        loads=(rf.Load("P", "top", pressure="1 + x"), rf.Load("T", "right", pressure="1 + y")),
        history=rf.HistoryOptions("cyclic", load="T", minimum=0.1, cycles=2, constant={"P": 1.0}),
        probes=(rf.Probe("s", points=((0.31, 0.22), (0.5, 1.0))),),
    )


SCENES: dict[str, Callable[[Path], rf.Scene]] = {
    "pin": demo("pin", "mesh.contact_elements=40", "history.cycles=2"),
    "bush": bush,
    "corner": corner,
    "press fit": demo("press_fit", "mesh.contact_elements=12"),
    "coat": coat,
    "moving load": demo("moving_load", "mesh.contact_elements=16", "load.wheel.steps=6"),
    "rolling": demo("rolling", "mesh.contact_elements=40"),
}


def condensed(scene: rf.Scene, on: MPI.Comm) -> tuple[Stack, rf.ContactSystem | None]:
    """The bodies of a scene, distributed over the ranks however small they are, and its system."""
    bodies = bulk_of(scene, on, Timer(None))
    system = stack.condense(bodies)
    probes = probe_matrix(bodies, scene) if scene.probes else None
    return bodies, system and replace(system, probes=probes)


def played(scene: rf.Scene) -> tuple[rf.ContactSystem, rf.Record]:
    system = rf.given(condensed(scene, MPI.COMM_SELF)[1])
    return system, rf.evolve(system, scene)


@pytest.mark.parametrize("name", SCENES)
def test_any_number_of_ranks_gives_the_same_system_and_history(
    name: str, shared_tmp_path: Path
) -> None:
    scene = SCENES[name](shared_tmp_path)
    bodies, together = condensed(scene, comm)
    contacts = [part.contact for part in bodies.parts]
    bodies.destroy()
    motions = sum(G @ c.modes for G, c in zip(bodies.relative.on, contacts, strict=True))
    if len(contacts) > 1:
        # what all bodies do together moves nothing: resultants and moments pass the joints
        free = [0, 1, 2] if name not in ("press fit", "coat") else [1]
        rows = len(bodies.relative.joint) if name != "coat" else 0
        assert np.abs(motions[:rows, free]).max(initial=0.0) < 1e-13

    def compare() -> None:
        system, record = played(scene)
        assert together is not None
        for key in ("x", "points", "weight", "K", "r_star", "load_compliance", "rigid"):
            known = getattr(system, key)
            size = np.abs(known).max(initial=0.0)
            assert getattr(together, key) == pytest.approx(known, abs=1e-11 * size), key
        Image().check(rf.evolve(together, scene), record, 1e-9)

    rf.on_root(comm, compare)


def on_meshes(scene: rf.Scene, meshes: list[Any], image: Image, folder: Path) -> rf.Scene:
    """A scene on the images of its meshes."""
    folder.mkdir()
    bodies = []
    for body, mesh in meshes:
        points = np.array([image.place(point) for point in mesh.points])
        edges = {image.edge(k): facets for k, facets in mesh.edges.items() if len(facets)}
        path = folder / f"{body.name}.msh"
        write_msh(path, points, [mesh.cells[:, :: image.sign]], edges)
        bodies.append(rf.Body(body.name, mesh=str(path)))
    return replace(scene, body=bodies[0], others=tuple(bodies[1:]))


@pytest.mark.one_rank
@pytest.mark.parametrize("name", [name for name in SCENES if name != "moving load"])
def test_the_image_of_a_joint_has_the_image_of_its_history(name: str, tmp_path: Path) -> None:
    scene = SCENES[name](tmp_path)
    if name == "pin":
        scene = replace(scene, loads=(replace(scene.loads[0], body_force=(1e-3, -3e-3)),))
    image = image_for(scene, 0)
    turned = image.of(scene)
    if scene.body.mesh is not None:
        meshes = [*zip(scene.bodies, raw_meshes(scene, False), strict=True)]
        scene = on_meshes(scene, meshes, Image(), tmp_path / "own")
        turned = on_meshes(turned, meshes, image, tmp_path / "image")
    image.check(played(turned)[1], played(scene)[1], 1e-9)


def tractions(r: tuple[float, float], at: int, m: int, nu: float, young: float) -> Array:
    """Tractions [srr, srt] on one side of a ring, plane stress, free on the other one.

    For the displacements u_r = a cos(m t), u_t = b sin(m t) of that side, by Kolosov's potentials
    phi = A z^(m+1) + C z^(1-m), psi = B z^(m-1) + D z^(-m-1).

    Returns:
        The matrix (2, 2) from [a, b] to the coefficients of cos(m t) and sin(m t).
    """
    kappa, G = (3.0 - nu) / (1.0 + nu), young / (2.0 * (1.0 + nu))

    def rows(r: float) -> Array:
        u, s = np.zeros((2, 4, 2))
        powers = ((m + 1, True), (m - 1, False), (1 - m, True), (-m - 1, False))
        for k, (n, of_phi) in enumerate(powers):
            # coefficients of exp(i m t) and exp(-i m t) in 2 G (u_r + i u_t) and srr - i srt
            plus = int(k >= 2)
            if of_phi:
                u[k, plus] += kappa * r**n
                u[k, 1 - plus] -= n * r**n
                s[k] += n * r ** (n - 1)
                s[k, plus] -= n * (n - 1) * r ** (n - 1)
            else:
                u[k, 1 - plus] -= r**n
                s[k, plus] -= n * r ** (n - 1)
        u /= 2.0 * G
        return np.array([u.sum(1), u[:, 0] - u[:, 1], s.sum(1), s[:, 1] - s[:, 0]])

    here, there = rows(r[at]), rows(r[1 - at])
    constants = np.linalg.solve(np.vstack([here[:2], there[2:]]), np.eye(4)[:, :2])
    return np.asarray(here[2:] @ constants)


@pytest.mark.one_rank
@pytest.mark.parametrize("counts", [(48, 48), (48, 35)])
@pytest.mark.parametrize("m", [2, 3])
def test_stiffness_of_a_curved_joint_couples_tangent_and_normal_as_kolosov_has_it(
    m: int, counts: tuple[int, int], tmp_path: Path
) -> None:
    """K^-1 is the sum of both rings' compliances, also in its coupling of w = cos and v = sin."""
    nu = (0.3, 0.1)
    inside, outside = (
        tractions(r, at, m, n, young)
        for r, at, n, young in (((1.0, 2.0), 1, nu[0], 2.0), ((2.0, 3.0), 0, nu[1], 3.0))
    )
    exact = np.linalg.inv(np.linalg.inv(inside) - np.linalg.inv(outside))
    errors = []
    for factor in (1, 2):
        bodies = [
            rf.Body(k, mesh=grid(tmp_path / f"{k}.msh", ring(1.0 + j, 2.0 + j), factor * n, 8))
            for j, (k, n) in enumerate(zip("io", counts, strict=True))
        ]
        scene = rf.Scene(
            body=bodies[0],
            others=(bodies[1],),
            materials=tuple(
                rf.Material(young, n, "plane stress", name=k)
                for k, n, young in zip("io", nu, (2.0, 3.0), strict=True)
            ),
            mesh=rf.MeshOptions(cell="quadrilateral", degree=2),
            contacts=(rf.Contact("i.top", against="o.bottom", interference=0.01),),
            history=rf.HistoryOptions("monotonic"),
        )
        system = rf.given(condensed(scene, MPI.COMM_SELF)[1])
        angle = np.arctan2(system.points[:, 1], system.points[:, 0])
        shapes = np.cos(m * angle), np.sin(m * angle)
        # n = -e_r, t = e_t
        u = np.zeros((2 * system.n, 2))
        u[system.n :, 0], u[: system.n, 1] = -shapes[0], shapes[1]
        Q, P = np.split(system.K @ u, 2)
        found = np.array(
            [
                shape @ force / (system.weight @ shape**2)
                for shape, force in zip(shapes, (-P, Q), strict=True)
            ]
        )
        errors.append(np.abs(found - exact).max() / np.abs(exact).max())
    assert abs(exact[0, 1]) > 0.1 * abs(exact[0, 0])
    assert errors[1] < 0.4 * errors[0] < 0.02
