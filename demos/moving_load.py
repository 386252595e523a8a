"""Strip that creeps under a passing load: ratchetting in the direction of travel.

**Problem.** A strip lies on a plane with friction by its weight. A pressure passes over it from
left to right, is taken off, and passes again. All loads are normal; nothing pushes the strip along.

**Equations.** Below the load the strip is pressed wide and lengthens, while friction holds it
there; in front it slips forward, and behind it catches up. The path of the load p(x - s) is a
polyline in the space of unit loads p(x - s_k): between two positions the load is interpolated, with
an error that falls with the square of their distance, and so does the error of the creep.

**What to look for.** Every pass moves the whole strip by the same step, in the direction of travel,
and passes the other way move it back by the same. Passing there and back leaves what putting the
load on and off does, at one of the ends. A heavier and rougher strip does not creep: it shakes
down.

The demo shows the key ``travel`` of a load and the history of the same name.
"""

from pathlib import Path

import numpy as np

import receding_fenicsx as rf

SCENE = Path(__file__).with_suffix(".toml")


def creep(changes: list[str]) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the displacement of the strip's middle in each pass, and the dissipation."""
    record = rf.run(rf.read_scene(SCENE, changes))
    if record is None:
        return None
    table = record.turning_points
    cycles = range(int(table.cycle.max()) + 1)
    middle = np.array([table.v[table.cycle == c][-1, len(record.x) // 2] for c in cycles])
    assert record.energy_error_max < 1e-10
    return np.diff(middle), record.cycles.dissipation


def main() -> None:
    """Print the creep for several numbers of steps and ways; assert direction and steadiness."""
    print("steps  creep of each pass                       dissipation of the last")
    for steps in (12, 24, 48, 96):
        found = creep([f"load.wheel.steps={steps}"])
        if found is None:  # on the other ranks
            continue
        step, D = found
        print(f"{steps:5d}  {'  '.join(f'{part:.5e}' for part in step)}  {D[-1]:.5e}")
        assert np.allclose(step, step[0], rtol=1e-6) and step[0] > 0.0
    right, left, both, heavy = (
        creep(changes)
        for changes in (
            [],
            ["load.wheel.travel=[3.0, -3.0]"],
            ["load.wheel.travel=[-3.0, 3.0, -3.0]", "load.wheel.steps=48"],
            ["load.weight.body_force=[0.0, -0.2]", "contact.friction=0.5", "history.cycles=8"],
        )
    )
    if right is None or left is None or both is None or heavy is None:
        return
    print(f"to the right {right[0][-1]:+.5e}, to the left {left[0][-1]:+.5e}")
    assert np.allclose(left[0], -right[0], rtol=1e-9)
    print(f"there and back {both[0][-1]:+.5e}")
    print(f"heavy and rough: creep {heavy[0][-1]:.1e}, dissipation over the first", end="")
    print(f" {heavy[1][-1] / heavy[1][0]:.3f}")
    assert heavy[0][-1] == 0.0


if __name__ == "__main__":
    main()
