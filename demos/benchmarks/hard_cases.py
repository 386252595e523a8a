"""Hard cases: expected outcome, outcome, and violation of the laws.

**Problem.** About 110 cases that are hard for a contact solver. Their expected outcomes were
written down before any run (``tests/hard.py``). Only overturning, gross sliding, a pulling load, a
body that touches nowhere, and jumps that an enumeration of all states confirms may be refused.

**What to look for.** One row for each case: expected and actual outcome, and the message. Accepted
records are replayed by code that shares nothing with the solvers; what contradicts a law is WRONG.
A ``!`` marks an outcome that was not expected.
"""

import argparse
import csv
import sys
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc  # noqa: F401 - starts on all ranks together

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from hard import CASES, judge

import receding_fenicsx as rf

HEADS = ("case", "expected", "outcome", "said")


def play(folder: Path, fast: bool, only: str) -> None:
    """Run the cases, print and write the table."""
    rows, unexpected = [], []
    for case in CASES:
        if (fast and not case.fast) or only not in case.name:
            continue
        outcome, said, as_expected = judge(case)
        rows.append([case.name, case.expected, outcome + " !" * (not as_expected), said])
        cells = [cell.ljust(width) for cell, width in zip(rows[-1], (48, 38, 11), strict=False)]
        print("".join(cells) + said[:120], flush=True)
        if not as_expected:
            unexpected.append(case.name)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "hard_cases.csv").open("w") as file:
        csv.writer(file).writerows([HEADS, *rows])
    lines = ["| " + " | ".join(cells) + " |" for cells in (HEADS, ["---"] * len(HEADS), *rows)]
    (folder / "hard_cases.md").write_text("\n".join(lines) + "\n")
    print(f"{len(rows)} cases, {len(unexpected)} not as expected; tables in {folder}")
    assert not unexpected, f"not as expected: {unexpected}"


def main() -> None:
    """Run all cases, or some."""
    parser = argparse.ArgumentParser(description="Hard cases: expected, outcome, residuals.")
    parser.add_argument("--out", type=Path, default=Path("results/hard_cases"))
    parser.add_argument("--fast", action="store_true", help="leave out the slow ones")
    parser.add_argument("--only", default="", help="cases whose name holds this text")
    options = parser.parse_args()
    rf.on_root(MPI.COMM_WORLD, lambda: play(options.out, options.fast, options.only))


if __name__ == "__main__":
    main()
