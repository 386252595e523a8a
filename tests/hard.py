"""Hard cases: what is expected of each is written here before it is run.

A case is played by its function; every answer that the package accepts is checked by code that
shares nothing with its solvers (``law.py``, and the quadrature below). Only lift-off, overturning,
gross sliding, a pulling load, a load range lost in round-off, and a jump that enumeration of all
states confirms may be refused. The cases are in ``hard_block.py`` and ``hard_bodies.py``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from enumeration import confirmed
from law import worst_slip, worst_violation

import receding_fenicsx as rf
from receding_fenicsx.evolution.record_data import States
from receding_fenicsx.interface.normal_form import eliminate_tangential

SOLVED, SLIDES, PULLS = "solved", "gross sliding", "pull the body off"
TIPS = "overturning"
JUMPS = "no quasi-static continuation"
HOVERS = "is not held"
"""A free body that touches nowhere at rest: nothing balances the smallest load."""

VIOLATION = 1e-9
"""Violation of any law at any kept instant, over the largest nodal force, that is let pass."""
ENERGY = 1e-8
"""Error of a leg's energy identity, over dissipation and stored energy, that is let pass."""
QUADRATURE = 0.06
"""Difference between a cycle's dissipation and the quadrature over its samples, over cycle 1's."""

ROUND_OFF = 1e-12
"""Dissipation over force times displacement that is none."""


class Wrong(AssertionError):
    """An answer was accepted that is none."""


def require(holds: object, text: str) -> None:
    """Raise Wrong unless something holds."""
    if not holds:
        raise Wrong(text)


class Tally:
    """Evolves, checks what comes out, and keeps the worst."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        self.violation = self.energy = 0.0

    def solve(
        self,
        system: rf.ContactSystem,
        history: rf.History,
        solver: rf.SolverOptions | None = None,
        initial_slip: np.ndarray | None = None,
        output: rf.OutputOptions | None = None,
    ) -> rf.Record:
        """Evolve a system of kind "frictional" and check every kept instant."""
        output = output or rf.OutputOptions(samples_per_leg=24, cycles=(0, 1, 2, history.cycles))
        played = system if np.any(system.f) else eliminate_tangential(system)
        try:
            record = rf.evolve(played, history, solver, output, initial_slip)
        except rf.NoQuasiStaticContinuation as error:
            self._confirm(system, history, error)
            raise
        part = modelled(system, record)
        checks = [worst_violation(system, part), record.residual_max]
        if record.method == "events":
            checks.append(worst_slip(system, part))
        self.violation = max(self.violation, *checks)
        require(self.violation <= VIOLATION, f"the law is violated by {self.violation:.1e}")
        if record.method == "events":
            self.energy = max(self.energy, record.energy_error_max)
            require(self.energy <= ENERGY, f"the energy identity fails by {self.energy:.1e}")
            difference = dissipation_difference(record)
            require(difference <= QUADRATURE, f"dissipation is off by {difference:.1e}")
        return record

    def _confirm(
        self, system: rf.ContactSystem, history: rf.History, refusal: rf.NoQuasiStaticContinuation
    ) -> None:
        """Raise Wrong where the path goes on although it is said to end."""
        try:
            ends = confirmed(system, history, refusal)
        except rf.RecedingError as error:
            raise Wrong(f"ends even before the place that is named: {error}") from error
        require(ends, f"refused, but a way on exists: {refusal}")


def modelled(system: rf.ContactSystem, record: rf.Record) -> rf.Record:
    """Cut a record of the whole contact, or of the full circle, down to what was modelled."""
    if system.axisymmetric:
        part = {name: getattr(record.samples, name) / (2.0 * np.pi) for name in ("P", "Q")}
        return replace(record, samples=replace(record.samples, **part))
    if not system.half:
        return record
    right = slice(len(record.x) - system.n, None)

    def cut(table: States) -> States:
        part = {name: getattr(table, name)[:, right].copy() for name in ("P", "Q", "v", "w")}
        part["P"][:, 0] *= 0.5  # the axis node carries both halves
        return replace(table, state=table.state[:, right], **part)

    return replace(record, samples=cut(record.samples))


def dissipation_difference(record: rf.Record) -> float:
    """Compare the dissipation of the kept cycles with the trapezoidal rule over their samples."""
    s, D = record.samples, record.cycles.dissipation
    worst = 0.0
    for cycle in set(s.cycle.tolist()) - {0}:
        rows = np.flatnonzero(s.cycle == cycle)
        ends = record.turning_points
        before = np.flatnonzero(ends.cycle == cycle - 1)[-1]
        Q = np.vstack([ends.Q[before], s.Q[rows]])
        v = np.vstack([ends.v[before], s.v[rows]])
        sum_ = float(-(0.5 * (Q[1:] + Q[:-1]) * np.diff(v, axis=0)).sum())
        scale = np.abs(D).max() + ROUND_OFF * np.abs(ends.P).max() * np.abs(v).max()
        worst = max(worst, abs(sum_ - D[cycle - 1]) / scale) if scale > 0.0 else worst
    return worst


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes:
        name: what it is.
        expected: "solved", or words of the refusals that are right; several are joined by " or ".
        play: plays it on a tally, raises Wrong or a refusal, says in a few words what came out.
        fast: takes well under a second.
    """

    name: str
    expected: str
    play: Callable[[Tally], str]
    fast: bool = True


@dataclass(frozen=True)
class Outcome:
    """What became of a case."""

    outcome: str
    said: str
    violation: float
    energy: float
    seconds: float
    as_expected: bool


def judge(case: Case) -> Outcome:
    """Play a case and hold it against what was expected."""
    tally, begin = Tally(), time.process_time()
    allowed = case.expected.split(" or ")
    try:
        said = case.play(tally)
        outcome, fine = SOLVED, SOLVED in allowed
    except Wrong as error:
        outcome, said, fine = "WRONG", str(error), False
    except rf.RecedingError as error:
        outcome, said = "refused", str(error)
        fine = any(word in said for word in allowed)
    except Exception as error:
        outcome, said, fine = "CRASHED", f"{type(error).__name__}: {error}", False
    seconds = time.process_time() - begin
    return Outcome(outcome, said, tally.violation, tally.energy, seconds, fine)
