"""Folders of results: none is lost, half written or used twice."""

import os
import signal
from pathlib import Path

import pytest

from receding_fenicsx.errors import InputError, Interrupted
from receding_fenicsx.store.workspace import FolderKind, locked, resumable

pytestmark = pytest.mark.one_rank

KIND = FolderKind("curve", ("curve.json", "cases/sweep.json"))
ONCE = FolderKind("study", ("nodes.csv",), resumable=False)


@pytest.mark.parametrize(
    ("kind", "files", "how", "answer"),
    [
        (KIND, (), {}, False),
        (KIND, (), {"resume": True}, False),
        (KIND, (".curve.json.7.tmp",), {}, False),  # another process is about to rename it
        (KIND, ("curve.json",), {"resume": True}, True),
        (KIND, ("cases/sweep.json",), {"overwrite": True}, True),
        (KIND, ("curve.json",), {}, "already exists and holds a curve; continue it with --resume"),
        (ONCE, ("nodes.csv",), {}, "already exists and holds a study; replace it"),
        (KIND, ("thesis.tex",), {"overwrite": True}, "is not the folder of a curve"),
        (KIND, ("nodes.csv",), {"resume": True}, "is not the folder of a curve"),
        (KIND, (), {"overwrite": True, "resume": True}, "give one of them"),
    ],
)
def test_only_results_of_the_kind_are_replaced_or_continued_and_only_when_asked(
    kind: FolderKind,
    files: tuple[str, ...],
    how: dict[str, bool],
    answer: bool | str,
    tmp_path: Path,
) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    if isinstance(answer, bool):
        assert kind.check(tmp_path, **how) == answer
        return
    with pytest.raises(InputError, match=answer):
        kind.check(tmp_path, **how)
    assert all((tmp_path / name).read_text() == "mine" for name in files)


def test_a_folder_of_one_piece_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    for number in range(2):
        with pytest.raises(RuntimeError), ONCE.new(out, number > 0) as folder:
            (folder / "nodes.csv").write_text("half")
            raise RuntimeError
        assert os.listdir(out.parent) == ["out"][:number]
        with ONCE.new(out, number > 0) as folder:
            (folder / "nodes.csv").write_text(str(number))
            assert not number or (out / "nodes.csv").read_text() == "0"
        assert os.listdir(out.parent) == ["out"] and os.listdir(out) == ["nodes.csv"]
        assert (out / "nodes.csv").read_text() == str(number)


def test_those_that_share_keep_others_out(tmp_path: Path) -> None:
    with locked(tmp_path, shared=True), locked(tmp_path, shared=True):
        with pytest.raises(InputError, match="another run is using"), locked(tmp_path):
            pass


@pytest.mark.parametrize("name", ["", "file.lock"])
def test_one_at_a_time(name: str, tmp_path: Path) -> None:
    for _ in range(2):
        with locked(tmp_path / name):
            with pytest.raises(InputError, match="another run is using"), locked(tmp_path / name):
                pass
            # the refusal has not taken the lock away
            with pytest.raises(InputError, match="another run is using"), locked(tmp_path / name):
                pass


@pytest.mark.parametrize(
    ("signalled", "code"),
    [(KeyboardInterrupt(), 128 + signal.SIGINT), (SystemExit(128 + signal.SIGTERM), 143)],
)
def test_an_interruption_tells_how_to_go_on_if_there_is_what_to_go_on_with(
    signalled: BaseException, code: int, tmp_path: Path
) -> None:
    with pytest.raises(type(signalled)) as bare, resumable(tmp_path, "here", file="system.h5"):
        raise signalled
    assert bare.value is signalled
    (tmp_path / "system.h5").touch()
    with (
        pytest.raises(
            Interrupted, match=r"^interrupted here; .* holds .*; continue by --resume$"
        ) as told,
        resumable(tmp_path, "there", file="system.h5"),
        resumable(tmp_path, "here", file="system.h5"),
    ):
        raise signalled
    assert told.value.exit_code == code
