"""Memory and seconds to condense a large body, by options of MUMPS: in core, out of core, low rank.

The paper's block whole, on equal elements. On a busy machine the clock's time exceeds the
processor's.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).resolve().parents[1] / "block.toml"
OPTIONS = {
    "in core": "",
    "out of core": "-mat_mumps_icntl_22 1",
    "low rank, 1e-12": "-mat_mumps_icntl_35 2 -mat_mumps_cntl_7 1e-12",
    "low rank, 1e-10": "-mat_mumps_icntl_35 2 -mat_mumps_cntl_7 1e-10",
}


def measure(name: str, elements: int, folder: str) -> str:
    """Condense in a process of its own; return a row of the table."""
    changes = {"mesh.contact_elements": elements, "mesh.growth": 1.0, "solver.symmetry": '"none"'}
    words = ["condense", str(SCENE), "--out", f"{folder}/system.h5", "--overwrite"]
    for key, value in changes.items():
        words += ["--set", f"{key}={value}"]
    environment = {"OMP_NUM_THREADS": "1", "MUMPS_OOC_TMPDIR": folder} | os.environ
    environment["PETSC_OPTIONS"] = f"{OPTIONS[name]} -mat_mumps_icntl_4 2"
    begin = time.monotonic()
    with Path(folder, "said").open("w+") as said:
        child = subprocess.Popen(
            [sys.executable, "-m", "receding_fenicsx", *words],
            env=environment,
            stdout=said,
            stderr=subprocess.STDOUT,
        )
        _, status, used = os.wait4(child.pid, 0)
        seconds = time.monotonic() - begin
        said.seek(0)
        lines = said.read().splitlines()
    freedoms = next(int(line.split()[-2]) for line in lines if "JOB, N, NNZ" in line)
    refused = [line for line in lines if "error: " in line]
    assert bool(refused) == (os.waitstatus_to_exitcode(status) != 0)
    end = f"  refused: {refused[0].split('error: ')[1].split(' (')[0]}" if refused else ""
    cpu, memory = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0
    return (
        f"{freedoms:9} {2 * elements + 1:6}  {name:16} {memory:6.0f} {cpu:7.0f} {seconds:7.0f}{end}"
    )


def main() -> None:
    """Print a row for each size and option."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--elements", type=int, nargs="+", default=[660])
    elements = parser.parse_args().elements
    print(" freedoms  nodes  factor               MB   CPU s clock s")
    for number in elements:
        for name in OPTIONS:
            with tempfile.TemporaryDirectory() as folder:
                print(measure(name, number, folder), flush=True)


if __name__ == "__main__":
    main()
