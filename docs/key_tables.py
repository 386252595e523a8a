"""Write the tables of scene keys into the documents: ``python docs/key_tables.py``.

Each table stands below the heading of its table in a scene file. The texts are those of the
dataclasses' docstrings, which the JSON Schema of scene files has too.
"""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import receding_fenicsx as rf
from receding_fenicsx.scene.schema import descriptions

DOCS = Path(__file__).resolve().parent
KINDS: dict[str, Any] = {
    "body": rf.Body,
    "material": rf.Material,
    "mesh": rf.MeshOptions,
    "contact": rf.Contact,
    "load": rf.Load,
    "support": rf.Support,
    "spring": rf.Spring,
    "bolt": rf.Bolt,
    "probe": rf.Probe,
    "history": rf.HistoryOptions,
    "solver": rf.SolverOptions,
    "output": rf.OutputOptions,
    "mode": rf.ModeOptions,
    "units": rf.Units,
    "shakedown": rf.ShakedownOptions,
    "accuracy": rf.AccuracyOptions,
    "wear": rf.WearOptions,
}
"""Dataclass of each table of a scene file."""


def key_table(kind: Any) -> str:
    """Return the keys of a table with their meanings and defaults, in Markdown."""
    texts = descriptions(kind)
    rows = ["| key | meaning | default |", "| --- | --- | --- |"]
    for field in dataclasses.fields(kind):
        # tables, lists with quotes, and quoted words are code
        code = re.sub(r'\{[^}]*\}|\[[^\]]*"[^\]]*\]|"[^"]*"', r"`\g<0>`", texts[field.name])
        text = code.replace("``", "`").rstrip(".")
        rows.append(f"| `{field.name}` | {text} | {_default(field)} |")
    return "\n".join(rows)


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default is dataclasses.MISSING:
        return "needed" if field.default_factory is dataclasses.MISSING else "-"
    return "-" if field.default in (None, (), "") else json.dumps(field.default)


def with_tables(text: str) -> str:
    """Return a document with the tables of keys as the dataclasses have them now."""

    def section(found: re.Match[str]) -> str:
        table = key_table(KINDS[found[2]])
        return found[1] + re.sub(
            r"(?:^\|.*\n)+", lambda _: f"{table}\n", found[3], count=1, flags=re.M
        )

    heading = rf"(^## \[+({'|'.join(KINDS)})\]+\n)((?:(?!## ).*\n)*)"
    return re.sub(heading, section, text, flags=re.M)


if __name__ == "__main__":
    path = DOCS / "scene.md"
    path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
