"""Every key of a scene counts where two scenes are compared, unless it is named here as free."""

import dataclasses
import re
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bodies import block

import receding_fenicsx as rf
from receding_fenicsx.evolution.journal import JOURNAL
from receding_fenicsx.scene.identity import body_of, digest, identity_of
from receding_fenicsx.scene.model import TABLE_OF
from receding_fenicsx.scene.toml_file import known_scene
from receding_fenicsx.store import hdf5
from receding_fenicsx.store.run_folder import SCENE, SYSTEM, is_finished, run_folder, write_summary

pytestmark = pytest.mark.one_rank

FULL = known_scene(Path(__file__).with_name("full.toml").read_text(encoding="utf-8"))
"""A scene of two bodies that sets all keys that go with each other."""

FREE = {"title", "history.cycles", "history.until", "output.cycles", "fatigue"}
FREE_TABLES = {"units", "shakedown", "accuracy", "mode", "wear"}
"""What a run may be gone on with: README, "Long runs"."""
PHYSICAL = ("body", "material", "mesh", "contact", "tie", "load", "support", "spring", "bolt")
"""Tables that a condensed system depends on."""
UNCONDENSED = (
    *(("contact", key) for key in ("friction", "initial_gap", "shear_limit", "cohesion")),
    *(("bolt", key) for key in ("shortening", "preload", "tightening")),
)
"""Their keys that it does not depend on."""


def changed(value: Any) -> Any:
    """Return another value of the same sort."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, float | int):
        return value + 1
    if isinstance(value, tuple) and value:
        return (*value[:-1], changed(value[-1]))
    if isinstance(value, dict):
        return {**value, "another": 1.0}
    return f"{value} another" if isinstance(value, str) else "another"


def variants(
    table: Any, key: str = "", change: Callable[[Any], Any] = changed
) -> Iterator[tuple[str, Any]]:
    """Yield ("table.key", the scene with another value of that key), for every key there is."""
    for field in dataclasses.fields(table):
        value, name = getattr(table, field.name), TABLE_OF.get(field.name, field.name)
        below = f"{key}.{name}" if key else name
        if dataclasses.is_dataclass(value):
            for path, other in variants(value, below, change):
                yield path, replace(table, **{field.name: other})
        elif isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
            yield name, replace(table, **{field.name: value[:-1]})
            for k, item in enumerate(value):
                for path, other in variants(item, below, change):
                    items = (*value[:k], other, *value[k + 1 :])
                    yield path, replace(table, **{field.name: items})
        else:
            yield below, replace(table, **{field.name: change(value)})


def test_run_is_gone_on_with_only_where_no_key_but_the_free_ones_differs(tmp_path: Path) -> None:
    out, seen = tmp_path / "run", set()
    with run_folder(out, FULL) as folder:
        (folder / SYSTEM).write_text("a system")
        (folder / JOURNAL).mkdir()
        steady = {"reached": True}
        summary = {"title": "", "turning_points": [], "dissipation_per_cycle": [1.0, 1.0]}
        write_summary(folder / "summary.json", {**summary, "steady": steady})
    for cycles, done in ((1, True), (2, True), (3, False)):
        plain = replace(FULL.history, cycles=cycles, until=None)
        assert is_finished(out, replace(FULL, history=plain)) == done, cycles
    none = {**summary, "dissipation_per_cycle": [], "steady": steady}
    write_summary(out / "summary.json", none, True)
    assert is_finished(out, replace(FULL, history=plain))  # it has no cycles
    (tmp_path / "run.part").mkdir()  # a longer one goes on from it
    assert not is_finished(out, replace(FULL, history=replace(plain, cycles=2)))
    (tmp_path / "run.part").rmdir()
    for jumped, until, cycles, done in (
        *((False, "limit", 2, True), (False, "limit", 9, False), (True, "limit", 2, True)),
        *((False, None, 2, True), (True, None, 2, False)),
    ):
        limit = {"reached": False, "jumped": jumped}
        write_summary(out / "summary.json", {**summary, "steady": steady, "limit": limit}, True)
        history = replace(FULL.history, cycles=cycles, until=until)
        assert is_finished(out, replace(FULL, history=history)) == done, (jumped, until, cycles)
    write_summary(out / "summary.json", {**summary, "steady": steady}, True)
    for key, other in (*variants(FULL), *variants(FULL, change=lambda _: None)):
        seen.add(key)
        if key in FREE or key.partition(".")[0] in FREE_TABLES or other == FULL:
            # nothing is left to do where cycles after the steady one are asked for
            again = replace(other, history=FULL.history)
            assert is_finished(out, again) == (again == FULL), key
            continue
        table, _, last = key.rpartition(".")
        with pytest.raises(rf.InputError) as caught:
            is_finished(out, other)
        named = f"[{table}] {last}" if table else key
        assert f"a run with another {named};" in str(caught.value), key
    assert FREE < seen and len(seen) > 80
    # the default number of samples is written out or not
    one, two, other = (
        replace(FULL, output=replace(FULL.output, samples_per_leg=n)) for n in (40, None, 41)
    )
    (out / SCENE).write_text(rf.to_toml(one), encoding="utf-8")
    is_finished(out, two)
    with pytest.raises(rf.InputError, match=r"another \[output\] samples_per_leg"):
        is_finished(out, other)


def test_every_key_reads_back_as_it_was_written() -> None:
    kept: set[str] = set()
    values: Any = (0.25, 2, (0.25, 0.5), ((0.25, 0.5),), "left")
    changes: list[Any] = [changed, *((lambda _, value=value: value) for value in values)]
    for change in changes:
        for key, other in variants(FULL, change=change):
            # a path becomes a whole one; without any contact there is the default one
            if key in kept | {"body.mesh", "contact"}:
                continue
            try:
                again = known_scene(rf.to_toml(other))
            except (rf.InputError, TypeError, AttributeError):
                continue  # a value of another kind
            assert again == other, key
            kept.add(key)
    assert len(kept) > 110


def test_saved_system_depends_on_all_of_the_body_and_on_nothing_else() -> None:
    mine, impossible = digest(FULL), set()
    whole, body = identity_of(FULL), body_of(FULL)
    for key, other in variants(FULL):
        table, _, last = key.rpartition(".")
        physical = (table or key) in PHYSICAL
        physical &= (table, last) not in UNCONDENSED
        try:
            found = digest(other)
        except rf.InputError:
            impossible.add(key)  # there is no such file or material
            continue
        assert (found != mine) == physical, key
        # a system of a sweep has its probes, and a case all but the title
        assert (body_of(other) != body) == (physical or (table or key) == "probe"), key
        assert (identity_of(other) == whole) == (key == "title"), key
    assert identity_of(FULL, 1) != whole
    assert impossible == {"body.material", "body.mesh", "material", "material.name"}


def test_a_system_depends_on_the_mesh_files_of_each_body_and_what_they_include(
    tmp_path: Path,
) -> None:
    a, b = (rf.Body(name, mesh=str(tmp_path / f"{name}.geo")) for name in "ab")
    scene = block(body=a, others=(b,), contacts=(rf.Contact("a.foot", against="b.top"),))
    found = set()
    for changed in "-abc":
        for name in "abc":
            text = f'x = {int(name == changed)}; Include "c.geo";'
            (tmp_path / f"{name}.geo").write_text(text)
        found.add(digest(scene))
    assert len(found) == 4


def test_a_stored_scene_is_not_judged_by_rules_that_are_newer() -> None:
    once = rf.HistoryOptions("table", columns=("p0",), rows=((1.0,),), cycles=5)
    solver = replace(FULL.solver, branch=2, method="gauss-seidel")
    for scene, words in (
        (replace(FULL, solver=solver), "load steps find one"),
        (block(history=once), r"\[history\] cycles"),
    ):
        with pytest.raises(rf.InputError, match=words):
            rf.from_toml(rf.to_toml(scene))
        old = rf.to_toml(scene).replace("[solver]", "[solver]\novershoot = 0.1")
        assert known_scene(rf.to_toml(scene)) == known_scene(old) == scene
    assert rf.history_from_scene(scene).cycles == 0


def test_a_system_of_another_version_is_known_by_its_scene_but_not_by_its_mesh_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own.geo").write_text("// a mesh")
    drawn = block(elements=8, material=rf.Material())
    own = replace(drawn, body=rf.Body(mesh=str(tmp_path / "own.geo")))
    system = rf.given(rf.condense(drawn))
    with monkeypatch.context() as other:
        other.setattr(hdf5, "digest", lambda scene: "of another version")
        for name, scene in (("drawn", drawn), ("own", own)):
            rf.write_system(tmp_path / name, replace(system, scene_toml=rf.to_toml(scene)))
    assert rf.read_system(tmp_path / "drawn", drawn).n == system.n
    for name, scene, key in (
        ("own", own, "mesh file"),
        ("drawn", replace(drawn, body=rf.Body(width=4.5)), "[body] width"),
    ):
        with pytest.raises(rf.InputError, match=re.escape(f"from a scene with another {key};")):
            rf.read_system(tmp_path / name, scene)
    rf.write_system(tmp_path / "own.h5", replace(system, scene_toml=rf.to_toml(own)))
    assert rf.read_system(tmp_path / "own.h5", own).n == system.n
    # a mesh file may move, but not change
    stored, history = replace(system, scene_toml=rf.to_toml(own)), rf.HistoryOptions(cycles=1)
    ways = ("// a mesh", 1.0, ""), ("// b", 1.0, "mesh file"), ("// b", 2.0, "young")
    for text, E, words in ways:
        (tmp_path / "moved.geo").write_text(text)
        body, material = rf.Body(mesh=str(tmp_path / "moved.geo")), rf.Material(E)
        moved = replace(own, body=body, history=history, material=material)
        told = pytest.raises(rf.InputError, match=words) if words else nullcontext()
        with told:
            rf.evolve(stored, moved)
