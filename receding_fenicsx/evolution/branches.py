"""All branches of a load history: every path that the contact may take from rest.

1. The history is played with the first continuation at every choice; the choices are noted
   (:class:`~receding_fenicsx.interface.branches.choice.Chooser`).
2. For each choice on it and each continuation that was not taken, the history is played again with
   the same choices up to there and then this one (:func:`branches`), and so on with its choices.
   Each branch is a :class:`~receding_fenicsx.evolution.record.Record` of its own.
3. A branch that ends where no quasi-static path leads on keeps its record up to there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from receding_fenicsx.arrays import check_types
from receding_fenicsx.errors import InputError, SolveError
from receding_fenicsx.evolution.evolve import continue_history
from receding_fenicsx.evolution.histories import tightened
from receding_fenicsx.evolution.journal import Journal
from receding_fenicsx.evolution.problem import Problem, problem_of_history, problem_of_scene
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.interface.branches.choice import Choice, Chooser, Key
from receding_fenicsx.interface.system import ContactSystem
from receding_fenicsx.scene.history import History
from receding_fenicsx.scene.model import OutputOptions, Scene, SolverOptions


@dataclass(frozen=True)
class Branch:
    """One path through all choices.

    Attributes:
        record: of the whole path, or up to the leg on which it ends.
        failure: why it ends before the end of the history, "" where it does not.
    """

    record: Record
    failure: str

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The choices made on it; ``taken`` of each is the continuation's number, from 1."""
        return self.record.choices

    @property
    def taken(self) -> tuple[int, ...]:
        """Number of the continuation taken at each choice, from 1."""
        return tuple(choice.taken for choice in self.choices)

    @property
    def name(self) -> str:
        """The choices in words."""
        return ", ".join(f"{c.taken} of {c.solutions}" for c in self.choices) or "no choice"


@dataclass(frozen=True)
class BranchTree:
    """All branches that were followed; the first one takes the first continuation everywhere.

    Attributes:
        branches: the branches.
        unsure: cycle, leg and s of instants at which not all continuations could be searched.
        limited: the number of branches was limited, there are more.
    """

    branches: tuple[Branch, ...]
    unsure: tuple[tuple[int, int, float], ...]
    limited: bool

    @property
    def complete(self) -> bool:
        """Whether no other branch exists."""
        return not self.unsure and not self.limited

    def __len__(self) -> int:
        """Return the number of branches."""
        return len(self.branches)

    def __iter__(self) -> Iterator[Branch]:
        """Iterate over the branches."""
        return iter(self.branches)

    def __getitem__(self, number: int) -> Branch:
        """Return a branch by its number, from 0."""
        return self.branches[number]

    def __str__(self) -> str:
        """Return a line for each branch: choices taken, how far it goes, dissipation."""
        whole = "there are more" if self.limited else "all"
        if self.unsure:
            cycle, leg, s = self.unsure[0]
            whole = (
                f"there may be more: at {len(self.unsure)} instants not all continuations were "
                f"searched, first in cycle {cycle}, leg {leg}, at s = {s:.6g}"
            )
        lines = [f"{len(self)} branch{'es' if len(self) > 1 else ''} ({whole})"]
        for k, branch in enumerate(self.branches):
            record = branch.record
            total = record.dissipation_first_loading + float(record.cycles.dissipation.sum())
            end = f"ends: {branch.failure}" if branch.failure else "goes all the way"
            lines.append(f"branch {k}: {branch.name}; dissipation {total:.6g}; {end}")
        return "\n".join(lines)


def branches(
    system: ContactSystem,
    history: Scene | History,
    most: int = 64,
    solver: SolverOptions | None = None,
    output: OutputOptions | None = None,
) -> BranchTree:
    """Follow all branches of a history on the exact path.

    Where a load has no ``load_compliance`` (a system made by hand), its displacement in the records
    is that of the contact alone, the displacement with the contact held being left out.

    Args:
        system: the condensed body.
        history: a scene, or a path of load factors.
        most: number of branches that are followed at most.
        solver: its ``on_jump``; not with a scene.
        output: samples of each record; by default all cycles are sampled. Not with a scene.

    Returns:
        The tree.

    Raises:
        InputError: as :func:`~receding_fenicsx.evolution.evolve.evolve`; the method is not
            "events", or ``solver.branch`` is given.
    """
    check_types(
        "branches",
        system=(system, ContactSystem),
        history=(history, Scene, History),
        most=(most, int),
        solver=(solver, SolverOptions, None),
        output=(output, OutputOptions, None),
    )
    problem = _problem(system, history, solver, output)
    if problem.solver.method != "events" or problem.solver.branch != "first":
        raise InputError(
            'branches: follows all branches by method "events"; leave out solver.method and '
            "solver.branch"
        )
    if problem.history.until_limit:
        raise InputError(
            'branches: follows no limit of infinitely many cycles; use until = "steady"'
        )
    if most < 1:
        raise InputError(f"branches: most must be at least 1, not {most}")
    waiting: deque[dict[Key, int]] = deque([{}])
    found: list[Branch] = []
    unsure: set[tuple[int, int, float]] = set()
    while waiting and len(found) < most:
        taken = waiting.popleft()
        chooser = Chooser(taken=taken)
        problem = replace(problem, chooser=chooser)
        try:
            found.append(Branch(continue_history(problem, Journal()), ""))
        except SolveError as error:
            if not isinstance(error.record, Record):
                raise
            found.append(Branch(error.record, str(error)))
        unsure |= chooser.unsure
        before: dict[Key, int] = {}
        for key in sorted(chooser.log):
            choice = chooser.log[key]
            if key not in taken:
                waiting += [before | {key: k + 1} for k in range(1, choice.solutions)]
            before[key] = choice.taken
    return BranchTree(tuple(found), tuple(sorted(unsure)), limited=bool(waiting))


def _problem(
    system: ContactSystem,
    history: Scene | History,
    solver: SolverOptions | None,
    output: OutputOptions | None,
) -> Problem:
    if system.load_compliance.size == 0:
        loads = len(system.load_names)
        system = replace(
            system, load_compliance=np.zeros((loads, loads)), load_sign=-np.ones(loads)
        )
    if not isinstance(history, Scene):
        output = output or OutputOptions(cycles="all")
        return problem_of_history(system, history, solver, output)
    if solver is not None or output is not None:
        raise InputError("branches: a scene brings its own solver and output")
    return problem_of_scene(system, tightened(system, history))
