"""Tables of the keys of scene files, for the site; ``python docs/key_tables.py`` prints them.

The texts are those of the dataclasses' docstrings, which the JSON Schema of scene files has too.
"""

import dataclasses
import json
import re
from typing import Any, get_args, get_type_hints

import receding_fenicsx as rf
from receding_fenicsx.scene.model import TABLE_OF
from receding_fenicsx.scene.toml_reader import descriptions

KINDS: dict[str, Any] = {
    TABLE_OF.get(name, name): kind
    for name, hint in get_type_hints(rf.Scene).items()
    for kind in (hint, *get_args(hint))
    if dataclasses.is_dataclass(kind)
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
