"""Kill a run of 500 cycles on two ranks ten times: each resumed run ends with the same bits.

**Problem.** A long run writes checkpoints. Both ranks are killed by SIGKILL at a random cycle, and
the run is resumed from its last checkpoint.

**What to look for.** A table: the cycle of the kill, the cycle from which the run continues, and
how many datasets of ``record.h5`` differ in any bit from those of an undisturbed run: none. The
demo ends with exit code 1 if one does.

The demo shows how to resume a run from Python and how to follow its progress. The cycles are drawn
at random from a fixed seed. The progress of the run itself tells when a cycle is reached, so every
kill hits the evolution, however fast the machine.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import receding_fenicsx as rf

HERE = Path(__file__).resolve()
RANKS = 2
CYCLES = 500
EARLIEST, LATEST = 10, 450
"""Range of the cycles at which the run is killed."""
SEED = 2008


def play(folder: Path, elements: int) -> None:
    """Resume the run in a folder, or start it; all ranks call this together."""
    from mpi4py import MPI

    scene = rf.read_scene(HERE.parents[1] / "block.toml", [f"mesh.contact_elements={elements}"])
    scene = replace(scene, history=replace(scene.history, cycles=CYCLES, until=None))
    for rank in range(MPI.COMM_WORLD.size):
        MPI.COMM_WORLD.Barrier()
        if rank == MPI.COMM_WORLD.rank:
            print("process", os.getpid(), flush=True)
    MPI.COMM_WORLD.Barrier()
    options = rf.RunOptions(
        pictures=False, resume=True, progress=lambda text: print(text, flush=True)
    )
    rf.run(scene, folder, options)


def cycles_of(output: Iterator[str], processes: list[int]) -> Iterator[int]:
    """Yield the number of each finished cycle from the output; note the ranks' processes."""
    for line in output:
        if found := re.match(r"process (\d+)", line):
            processes.append(int(found[1]))
        elif found := re.match(r"evolve: cycle (\d+) of", line):
            yield int(found[1])


def start(folder: Path, elements: int) -> "subprocess.Popen[str]":
    """Start the run, on ranks of its own."""
    beside = Path(sys.executable).with_name("mpiexec")  # PyPI's MPI wants its own
    mpirun = str(beside) if beside.exists() else shutil.which("mpirun.openmpi") or "mpirun"
    command = [mpirun, "-n", str(RANKS), sys.executable, str(HERE), "--play", str(folder)]
    own = {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
        "OMPI_MCA_mpi_yield_when_idle": "1",
    }
    return subprocess.Popen(
        [*command, "--elements", str(elements)],
        env=rf.child_environment() | own,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def finish(folder: Path, elements: int) -> int:
    """Run or resume to the end; return the first cycle that was evolved."""
    with start(folder, elements) as process:
        assert process.stdout is not None
        played = list(cycles_of(process.stdout, []))
    if process.returncode != 0 or not played:
        raise SystemExit(f"the run in {folder} ended with exit code {process.returncode}")
    return played[0]


def kill(folder: Path, elements: int, cycle: int) -> int:
    """Start the run and kill its ranks once a cycle has passed; return the last cycle seen."""
    processes: list[int] = []
    last = 0
    with start(folder, elements) as process:
        assert process.stdout is not None
        for last in cycles_of(process.stdout, processes):
            if len(processes) == RANKS and last >= cycle:
                for number in processes:
                    os.kill(number, signal.SIGKILL)
                processes.clear()
    if process.returncode == 0 or folder.exists():
        raise SystemExit(f"the run was over before it could be killed at cycle {cycle}")
    return last


def differing(folder: Path, undisturbed: Path) -> tuple[list[str], int]:
    """Return the datasets of two records that differ in a bit, and how many there are."""
    import h5py

    def datasets(place: Path) -> dict[str, tuple[object, ...]]:
        found: dict[str, tuple[object, ...]] = {}
        with h5py.File(place / "record.h5") as file:

            def take(name: str, item: object) -> None:
                if isinstance(item, h5py.Dataset):
                    array = item[()]
                    found[name] = (array.shape, str(array.dtype), array.tobytes())

            file.visititems(take)
        return found

    one, other = datasets(folder), datasets(undisturbed)
    names = sorted(one.keys() | other.keys())
    return [name for name in names if one.get(name) != other.get(name)], len(names)


def main(kills: int, elements: int) -> int:
    """Run undisturbed, then kill and resume again and again; print the table."""
    cycles = np.sort(np.random.default_rng(SEED).integers(EARLIEST, LATEST, kills, endpoint=True))
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        whole, out = Path(name) / "whole", Path(name) / "run"
        finish(whole, elements)
        print(f"{CYCLES} cycles, {2 * elements + 1} contact nodes, {RANKS} ranks")
        print("killed after cycle   goes on with cycle   datasets   that differ", flush=True)
        for cycle in cycles:
            last = kill(out, elements, int(cycle))
            first = finish(out, elements)
            names, total = differing(out, whole)
            bad += len(names)
            text = f"{last:18} {first:21} {total:10} {len(names):13}  {', '.join(names)}"
            print(text.rstrip(), flush=True)
            shutil.rmtree(out)
    print("every resumed run ends in the same bits" if not bad else "SOME RUNS DIFFER")
    return 1 if bad else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Kill a run and resume it.")
    parser.add_argument("--kills", type=int, default=10, help="how often (10)")
    parser.add_argument("--elements", type=int, default=80, help="contact elements (80)")
    parser.add_argument("--play", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.play is not None:
        play(options.play, options.elements)
    # bash demos/run.sh starts demos on two ranks: this one starts ranks of its own
    elif not any(os.environ.get(k, "0") != "0" for k in ("OMPI_COMM_WORLD_RANK", "PMI_RANK")):
        sys.exit(main(options.kills, options.elements))
