"""What can be modelled, but hardly well: said before and after a run."""

from __future__ import annotations

from receding_fenicsx.scene.model import Scene

LOCKING_POISSON = 0.45
"""Poisson's ratio above which elements of order 1 are too stiff: measured on the paper's block
with 81 contact nodes, their dissipation is off by 3 to 8 % at 0.49 and by 11 to 30 % at 0.499, that
of order 2 by 1 %."""


def warnings(scene: Scene) -> list[str]:
    """Return one line for each thing that makes a scene's answer worse than it looks."""
    lines = []
    materials = (scene.material, *scene.materials)
    largest = max(
        (m.poisson for m in materials if m.kinematics != "plane stress"),
        default=0.0,
    )
    if scene.mesh.degree == 1 and largest > LOCKING_POISSON:
        lines.append(
            f"[mesh] degree: elements of order 1 lock near incompressibility (Poisson's ratio "
            f"{largest:g}), which no residual shows; use degree = 2"
        )
    return lines
