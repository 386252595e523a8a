"""What the pictures of a run cost: the paper's study with and without them, beside each other.

**Problem.** `receding-fenicsx run demos/block.toml` solves 160 cycles of the block, then draws its
figures and the stress field at five instants, and writes the report. The solution takes a few
seconds; the pictures should not take much longer.

**What to look for.** Both commands run in turn, some times, from the start of the program to its
end. The table shows for each the shortest wall time, and the processor time of all its processes.
The default takes at most twice the processor time without pictures.

    python demos/benchmarks/benchmark_pictures.py [--rounds 3] [--film]

Where other programs use the cores, wall times tell little.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).parents[1] / "block.toml"


def main() -> None:
    """Time the commands, print the table, check the ratio."""
    parser = argparse.ArgumentParser(description="Cost of the pictures of a run.")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each command")
    parser.add_argument("--film", action="store_true", help="time a film too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = ["run", str(SCENE), "--overwrite", "--out"]
        commands = {
            "without pictures": [*run, f"{folder}/none", "--pictures", "none"],
            "default": [*run, f"{folder}/all"],
        }
        if options.film:
            commands["film of a cycle"] = ["animate", f"{folder}/all", "--cycle", "9"]
        wall, cpu = measure(commands, options.rounds)
    print(f"{'command':18} {'wall, s':>8} {'processor, s':>13}")
    for name in commands:
        print(f"{name:18} {wall[name]:8.1f} {cpu[name]:13.1f}")
    ratio = wall["default"] / wall["without pictures"]
    work = cpu["default"] / cpu["without pictures"]
    print(f"default over without pictures: wall {ratio:.2f}, processor {work:.2f}")
    assert work <= 2.0


def measure(
    commands: dict[str, list[str]], rounds: int
) -> tuple[dict[str, float], dict[str, float]]:
    """Run the commands in turn; return the shortest wall and processor time of each."""
    wall = dict.fromkeys(commands, float("inf"))
    cpu = dict.fromkeys(commands, float("inf"))
    for _ in range(rounds):
        for name, arguments in commands.items():
            before, begin = processor_time(), time.perf_counter()
            program = [sys.executable, "-m", "receding_fenicsx", *arguments]
            subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
            wall[name] = min(wall[name], time.perf_counter() - begin)
            cpu[name] = min(cpu[name], processor_time() - before)
    return wall, cpu


def processor_time() -> float:
    """Return the processor time of all ended child processes and of their children."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
