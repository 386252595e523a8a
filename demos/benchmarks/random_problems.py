"""Random contact problems, each checked by code that shares nothing with the solvers.

**Problem.** 5000 small problems: nodes held and free, exact ties, near-singular stiffness, gaps,
friction from 0 to 3, free bodies, one to three loads, cycles, complete unloading, by the exact path
and in load steps.

**Equations.** A record holds the states (stick, separation, forward or backward slip) between any
two events. In given states the contact law is a linear system,

    Q_i + sign_i f_i P_i = 0  or  v_i = v_i(old),    w_i = -g0_i  or  P_i = Q_i = 0,
    [Q; P] = sum_k lambda_k r*_k + K [v; w],

which ``tests/replay.py`` solves anew. All inequalities, slip directions, events, jumps and energies
must hold there, and the record must agree. Where a path is refused, ``tests/ways.py`` tries all
states of all nodes on limits: a refusal is right if no state continues the path.

Families follow from the same numbers: "plain"; "directed" with other friction forward than
backward; "oblique" with bodies that are guided or hinged, on two edges oblique to each other;
"limit" until the limit of infinitely many cycles; "sprung" on ground springs of 1e-4 to 1e-9 of K;
"stack" of two to four blocks whose nodes do not match, touching or tied; "capped" with a
shear limit and a cohesion.

**What to look for.** How many problems were accepted, refused for which reason, and wrong (0).

    python demos/benchmarks/random_problems.py --count 5000 --seed 0
"""

import argparse
import sys
from pathlib import Path

from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from problems import FALSE, WRONG, judge, problem, table_of
from stack_problems import FAMILIES

import receding_fenicsx as rf

comm = MPI.COMM_WORLD


def main() -> None:
    """Check the problems, each rank its share; print the counts and the wrong ones."""
    parser = argparse.ArgumentParser(description="Random problems, accepted, refused and wrong.")
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0, help="number of the first problem")
    parser.add_argument("--family", choices=FAMILIES, default="plain")
    options = parser.parse_args()
    own = range(options.seed + comm.rank, options.seed + options.count, comm.size)
    # a problem follows from its number alone: any one can be played again
    family = FAMILIES[options.family]
    judged = rf.on_all(comm, lambda: {number: judge(family(problem(number))) for number in own})
    found = {number: o for part in comm.allgather(judged) for number, o in part.items()}
    bad = {number: o for number, o in sorted(found.items()) if o.verdict in (WRONG, FALSE)}
    if comm.rank == 0:
        print(table_of(found.values()))
        for number, outcome in bad.items():
            print(f"problem {number}: {outcome.verdict}: {outcome.said}")
        print(f"{len(found)} problems, {len(bad)} wrong or falsely refused")
    assert not bad, f"wrong or falsely refused: {list(bad)}"


if __name__ == "__main__":
    main()
