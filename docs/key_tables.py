"""Tables of the keys of scene files, for the site; ``python docs/key_tables.py`` prints them.

The texts are those of the dataclasses' docstrings, which the JSON Schema of scene files has too.
"""

import dataclasses
import json
import re
from typing import Any

import receding_fenicsx as rf
from receding_fenicsx.scene.toml_reader import descriptions

KINDS: dict[str, Any] = {
    "body": rf.Body,
    "material": rf.Material,
    "mesh": rf.MeshOptions,
    "contact": rf.Contact,
    "tie": rf.Tie,
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
    "fatigue": rf.FatigueOptions,
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
    """Return a page with a table of keys in the place of each ``<!-- keys of TABLE -->``."""
    return re.sub(r"<!-- keys of (\w+) -->", lambda found: key_table(KINDS[found[1]]), text)


if __name__ == "__main__":
    for name, kind in KINDS.items():
        print(f"[{name}]\n\n{key_table(kind)}\n")
