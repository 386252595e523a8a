"""Sweep of a scene over a grid of values.

table = rf.sweep(scene, {"contact.friction": [0.1, 0.2], "history.minimum": [0.0, 0.5]}, "out")
table["dissipation_last_cycle"], table.grid("steady"), table.to_pandas()
"""

from __future__ import annotations

import copy
import hashlib
import inspect
import itertools
import json
import math
import pickle
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from receding_fenicsx import mpi
from receding_fenicsx.arrays import aligned, check_types, shortened
from receding_fenicsx.errors import InputError
from receding_fenicsx.evolution.evolve import evolve
from receding_fenicsx.evolution.moment import extreme_row
from receding_fenicsx.evolution.record import Record
from receding_fenicsx.evolution.tables import optional
from receding_fenicsx.measures.ends import half_widths
from receding_fenicsx.scene.checks import suggestion
from receding_fenicsx.scene.identity import body_of, identity_of
from receding_fenicsx.scene.model import OutputOptions, Scene
from receding_fenicsx.scene.toml_file import from_raw, parse_value, set_value, to_toml
from receding_fenicsx.scene.toml_reader import parse_toml, plain
from receding_fenicsx.store.run_folder import write_csv
from receding_fenicsx.store.workspace import Case, Outcome
from receding_fenicsx.studies.run import shared_system
from receding_fenicsx.studies.runner import Kind, Runner, Study, StudyOptions, run_study
from receding_fenicsx.studies.wear.study import wear_numbers

if TYPE_CHECKING:
    import pandas as pd


Label = float | int | str | bool
"""A value of a key as the table shows it."""
ERROR = "error"
"""Column of the reasons why cases failed."""


@dataclass(frozen=True, repr=False)
class SweepTable:
    """Table of a sweep; ``table["dissipation_last_cycle"]`` is a column.

    Attributes:
        keys: the keys of the sweep, the first columns.
        labels: the values of each key.
        rows: one dictionary for each case, the last key varying fastest: keys, measured numbers
            (none where the case failed), and "error", the reason why it failed, or "".
    """

    keys: tuple[str, ...]
    labels: tuple[tuple[Any, ...], ...]
    rows: tuple[dict[str, Any], ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns: keys, measured numbers, "error"."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        return (*(name for name in names if name != ERROR), ERROR)

    @property
    def failed(self) -> tuple[dict[str, Any], ...]:
        """Rows of the cases that failed."""
        return tuple(row for row in self.rows if row[ERROR])

    def __len__(self) -> int:
        """Return the number of rows, one for each case."""
        return len(self.rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Go through the rows."""
        return iter(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; missing numbers are NaN, missing texts None."""
        if name not in self.columns:
            hint = suggestion(name, self.columns)
            raise InputError(f"sweep: no column is named '{name}'; {hint}")
        values = [row.get(name) for row in self.rows]
        given = [value for value in values if value is not None]
        if given and all(isinstance(v, int | float) and not isinstance(v, bool) for v in given):
            return np.array([math.nan if value is None else value for value in values])
        return np.array(values, dtype=object)

    def grid(self, name: str) -> NDArray[Any]:
        """Return a column with one axis for each key, in the order of ``keys``."""
        return self[name].reshape([len(values) for values in self.labels])

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame; needs pandas."""
        return optional("pandas").DataFrame({name: self[name] for name in self.columns})

    def write_csv(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the table as a CSV file; numbers keep all their digits."""
        write_csv(Path(path), self.by_column(), overwrite)

    def by_column(self) -> dict[str, list[Any]]:
        """Return the values of all cases by their columns; None where a case has none."""
        return {name: [row.get(name) for row in self.rows] for name in self.columns}

    def __repr__(self) -> str:
        """Return the number of cases, and the first rows with the most important columns."""
        filled = {name for row in self.rows for name, cell in row.items() if cell is not None}
        measured = [name for name in self.columns[len(self.keys) : -1] if name in filled]
        names = ["steady", "steady_cycle", "dissipation_last_cycle", "stick_half_width_at_minimum"]
        names += ["p_max_at_maximum", "residual_max"]
        names = [name for name in names if name in measured] or measured[:5]
        names = [*self.keys, *names, *([ERROR] if self.failed else [])]
        most = 20

        def shown(value: Any) -> str:
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            return "-" if value is None else shortened(text, 40)

        rows = [names, *([shown(r.get(name)) for name in names] for r in self.rows[:most])]
        lines = aligned(rows)
        if len(self.rows) > most:
            lines.append(f"... {len(self.rows) - most} more rows")
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return "\n".join([*lines, f"{len(self.rows)} cases{failed}"])


Cell = float | int | str | bool | None
"""Value in a table; None where a case has no such number."""

Measure = Callable[[Record], Mapping[str, Any]]
"""Function that takes the numbers of a case from its record."""


def sweep(
    scene: Scene,
    over: Mapping[str, Any],
    out: str | Path | None = None,
    workers: int | None = None,
    measure: Measure | None = None,
    options: StudyOptions = StudyOptions(),
) -> SweepTable | None:
    """Run a scene for every combination of values; all ranks of an MPI job call this together.

    Cases of the same body, mesh, contact edges, loads and supports share one condensed system. A
    case that fails is a row with its reason.

    Args:
        scene: the scene that is changed.
        over: values of each key "table.key" or "load.NAME.key": a list, or a dictionary of values
            by the names that the table shows.
        out: folder for ``sweep.csv``, ``sweep.json`` (what the sweep is of) and ``cases.jsonl``
            (finished cases, from which an interrupted sweep continues). None writes nothing.
        workers: number of new processes of this machine that run the cases; default: this process.
        measure: takes a dictionary of numbers and texts from the record of a case; default: the
            headline numbers. For MPI and executors it must be a function of a module.
        options: further options.

    Returns:
        The table on rank 0, None on the others. Rows of other shares that are not finished say so.

    Raises:
        InputError: a key or a value cannot be used in any combination, the folder holds another
            sweep, or the options contradict each other. Nothing has been computed then.
    """
    check_types(
        "sweep",
        scene=(scene, Scene),
        over=(over, Mapping),
        out=(out, str, Path, None),
        measure=(measure, Callable, None),
        options=(options, StudyOptions),
    )

    kind = Kind("sweep", "sweep.json", ("sweep.csv",))
    kind.check(out, workers, options)
    if measure is not None and (workers or options.executor or mpi.world().size > 1):
        import cloudpickle

        try:
            # new processes of this machine take functions of the main program too
            (cloudpickle if workers else pickle).dumps(measure)
        except Exception as caught:
            sent = f"cannot be sent to another process ({caught})"
            raise InputError(
                f"measure: {sent}; make it a function of a module, without open files"
            ) from None

    def begin() -> Study[SweepTable]:
        if scene.accuracy.tolerance is not None:
            own = "a sweep solves all its cases on the scene's mesh"
            raise InputError(f"[accuracy] tolerance: {own}; omit it")
        grid = grid_of(scene, over, options.folder)

        def combine(runner: Runner) -> SweepTable:
            cases = grid.cases(runner.systems, measure, measure is None)
            table = grid.table(runner.outcomes(cases, play_scene))
            runner.write(lambda: {"sweep.csv": table.by_column()})
            return table

        same = {"key": ", ".join(sorted(grid.keys)), "function measure": _text_of(measure)}
        over_labels = dict(zip(grid.keys, grid.labels, strict=True))
        return Study(scene, combine, same, {"over": over_labels, "cases": len(grid.scenes)})

    return run_study(kind, begin, out, workers, options)


def _text_of(measure: Any) -> str:
    """Return a text that changes with a function's name, its program and the values it holds."""
    if measure is None:
        return ""
    held: list[Any] = []
    while isinstance(measure, partial):
        held += [measure.args, measure.keywords]
        measure = measure.func
    held += [cell.cell_contents for cell in getattr(measure, "__closure__", None) or ()]
    found = (getattr(measure, name, None) for name in ("__defaults__", "__self__", "__dict__"))
    held += [value for value in found if value]

    def known(value: Any) -> Any:
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        return re.sub(r" at 0x\w+", "", repr(value))  # addresses change

    text = json.dumps(held, default=known, skipkeys=True) if held else ""
    with suppress(OSError, TypeError):
        text = inspect.getsource(measure) + text
    name = getattr(measure, "__qualname__", type(measure).__qualname__)
    return f"{name} {hashlib.sha256(text.encode()).hexdigest()[:16]}"


def play_scene(
    scene: Scene,
    body: str,
    systems: Path | None,
    measure: Measure | None,
    taken: tuple[str, ...],
    wears: bool,
) -> dict[str, Cell]:
    """Evolve a scene, with a system that processes share in a folder, and take its numbers.

    ``wears``: with the end of its wear, where it has a coefficient of wear.
    """
    system = shared_system(scene, body, systems)
    if measure is None:
        # turning points only: enough for the columns of measure_record
        every = scene.output.checkpoint_cycles
        scene = replace(scene, output=OutputOptions(1, (), checkpoint_cycles=every))
    cells = cells_of((measure or measure_record)(evolve(system, scene)), taken)
    if wears and (scene.wear.coefficient or scene.wear.archard):
        cells |= wear_numbers(system, scene)
    return cells


def cells_of(measured: Any, taken: Iterable[str]) -> dict[str, Cell]:
    """Return what a function of the user's has measured as plain numbers and texts.

    InputError: it is no dictionary of such, or names a column that is taken.
    """
    if not isinstance(measured, Mapping):
        raise InputError(f"measure: must return a dictionary, not a {type(measured).__name__}")
    cells: dict[str, Cell] = {}
    for name, given in measured.items():
        value = given.item() if isinstance(given, np.generic) else given
        if not isinstance(name, str) or name in taken:
            raise InputError(f"measure: {name!r} cannot be the name of a column; choose another")
        if not (value is None or isinstance(value, str | bool | int | float)):
            kind = type(value).__name__
            raise InputError(f"measure: '{name}' must be a number or a text, not a {kind}")
        cells[name] = value
    return cells


# -- numbers of a case ---------------------------------------------------------------------------


def measure_record(record: Record) -> dict[str, Cell]:
    """Return the headline numbers of a record, with the names of ``summary.json``.

    Half widths and extreme tractions are those of the last cycle at the smallest and the largest
    load. With several contact edges their names end in ".EDGE". Samples and events are not used.
    """
    D, steady = record.cycles.dissipation, record.steady
    row: dict[str, Cell] = {
        "cycles": len(D),
        "dissipation_first_loading": record.dissipation_first_loading,
        "dissipation_cycle_1": D[0] if len(D) else None,
        "dissipation_last_cycle": D[-1] if len(D) else None,
        "steady": steady.kind,
        "steady_cycle": steady.cycle if steady.reached else None,
        "steady_period": steady.period if steady.reached else None,
    }
    edges = record.by_edge()
    for name, part in edges.items():
        end = f".{name}" if len(edges) > 1 else ""
        points = part.turning_points
        rows = np.flatnonzero(points.cycle == points.cycle.max())  # of the last cycle
        for load in ("minimum", "maximum"):
            i = extreme_row(points, rows, load)
            found = half_widths(part, i)
            found |= {"p_max": points.p[i].max(), "q_abs_max": np.abs(points.q[i]).max()}
            row |= {f"{key}_at_{load}{end}": value for key, value in found.items()}
    return row | {
        "residual_max": record.residual_max,
        "energy_error_max": record.energy_error_max,
        "events": record.n_events,
        "sweeps": record.sweeps,
        "jumps": record.jumps,
    }


# -- cases ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Grid:
    """All combinations of values, those of the last key varying fastest.

    Of one that cannot be modelled the reason stands in place of the scene.
    """

    keys: tuple[str, ...]
    labels: tuple[tuple[Label, ...], ...]
    scenes: tuple[Scene | str, ...]

    def cases(self, systems: Path | None, measure: Measure | None, wears: bool) -> list[Case]:
        """Return the cases for :func:`play_scene`."""
        found, taken = [], (*self.keys, ERROR)
        for labels, scene in zip(itertools.product(*self.labels), self.scenes, strict=True):
            if isinstance(scene, str):
                found.append(Case("", (), labels, error=scene))
                continue
            body = body_of(scene)
            work = (scene, body, systems, measure, taken, wears)
            found.append(Case(identity_of(scene), work, labels, body))
        return found

    def table(self, outcomes: list[Outcome]) -> SweepTable:
        """Return the table of the outcomes of all cases."""
        rows = [
            {**dict(zip(self.keys, labels, strict=True)), **outcome.cells, ERROR: outcome.error}
            for labels, outcome in zip(itertools.product(*self.labels), outcomes, strict=True)
        ]
        return SweepTable(self.keys, self.labels, tuple(rows))


def grid_of(scene: Scene, over: Mapping[str, Any], folder: Path | None = None) -> Grid:
    """Return the scenes of all combinations of values; paths of files are relative to a folder.

    InputError: a key or a value cannot be used in any combination.
    """
    if not over:
        raise InputError('sweep: give keys and values, {"contact.friction": [0.1, 0.2]}')
    values = {key: _labelled(key, given) for key, given in over.items()}
    count, most = int(np.prod([float(len(v)) for v in values.values()])), 1_000_000
    if count > most:
        raise InputError(f"sweep: has {count} cases; at most {most} are possible")
    raw, folder = tomllib.loads(to_toml(scene)), folder or Path()

    def changed(chosen: Mapping[str, Any]) -> Scene | str:
        try:
            new = copy.deepcopy(raw)
            for key, value in chosen.items():
                set_value(new, key, copy.deepcopy(value), "the scene")
            found = from_raw(new, folder)
            body_of(found)  # a mesh file may be missing
        except InputError as error:
            return str(error).replace("\n", " ")
        return found

    combined = list(itertools.product(*(v.values() for v in values.values())))
    scenes = tuple(changed(dict(zip(values, chosen, strict=True))) for chosen in combined)
    labels = tuple(tuple(v) for v in values.values())
    numbered = list(zip(itertools.product(*labels), scenes, strict=True))
    for k, (key, of_key) in enumerate(values.items()):
        good = {chosen[k] for chosen, found in numbered if isinstance(found, Scene)}
        for label in set(of_key) - good:
            alone = changed({key: of_key[label]})
            if isinstance(alone, str):
                raise InputError(f"sweep over {key} = {shortened(str(label))}: {alone}")
    if isinstance(scenes[0], str) and not any(isinstance(found, Scene) for found in scenes):
        raise InputError(f"sweep over {', '.join(values)}: {scenes[0]}")
    return Grid(tuple(values), labels, scenes)


def _labelled(key: object, given: Any) -> dict[Label, Any]:
    """Return the values of a key by their labels."""
    if not isinstance(key, str) or "." not in key:
        raise InputError(f"sweep over {key}: write table.key, for example contact.friction")
    named = isinstance(given, Mapping)
    if not named and (isinstance(given, str) or not hasattr(given, "__iter__")):
        raise InputError(f"sweep over {key}: give a list of values, [{given!r}]")
    found: dict[Label, Any] = {}
    for item in given:
        value = plain(given[item] if named else item)
        label: Label = str(item) if named else json.dumps(value, default=str)
        if not named and isinstance(value, str | bool | int | float):
            label = value
        elif not named and isinstance(value, dict) and set(value) == {"file"}:
            label = str(value["file"])
        if label in found:
            raise InputError(f"sweep over {key}: the value {label} occurs twice; remove one")
        found[label] = value
    if not found:
        raise InputError(f"sweep over {key}: has no values; give at least one")
    return found


# -- values of the command line ------------------------------------------------------------------


def read_over(texts: list[str]) -> dict[str, list[Any]]:
    """Read the arguments ``--over KEY=VALUES``.

    Values are separated by commas; each is TOML, a text without quotes, or a range
    "first:last:number" of evenly spaced values.
    """
    over: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = (part.strip() for part in text.partition("="))
        where = f"--over {text}"
        if not (key and equals and values):
            example = "contact.friction=0.1:0.9:9 or history.minimum=0,0.25,0.5"
            raise InputError(f"{where}: write table.key=values, for example {example}")
        if key in over:
            raise InputError(f"{where}: {key} occurs twice; give all its values at once")
        over[key] = _values(values, where)
    return over


def _values(text: str, where: str) -> list[Any]:
    """Return the values of one key; of a range whole numbers where both ends and all are such."""
    found: list[Any] = []
    # first value, last value, number of values
    pattern = r"\s*([^:\s]+)\s*" + 2 * r":\s*([^:\s]+)\s*"
    matches = [re.fullmatch(pattern, part) for part in text.split(",")]
    if not any(matches):
        with suppress(InputError):
            return list(parse_toml(f"values = [{text}]")["values"])
    for part, match in zip(text.split(","), matches, strict=True):
        if not part.strip():
            raise InputError(f"{where}: a value is missing between commas")
        if not match:
            found.append(parse_value(part, where))
            continue
        try:
            a, b, n = float(match[1]), float(match[2]), int(match[3])
        except ValueError:
            a = b = n = 0
        if not (math.isfinite(a) and math.isfinite(b) and 2 <= n <= 100_000):
            numbers = "first:last:number, two numbers and a count of 2 to 100000"
            raise InputError(f"{where}: a range is {numbers}")
        values = np.linspace(a, b, n)
        whole = all(re.fullmatch(r"[+-]?\d+", end) for end in match.groups()[:2])
        whole = whole and bool(np.all(values == np.round(values)))
        found += (values.astype(int) if whole else values).tolist()
    return found
