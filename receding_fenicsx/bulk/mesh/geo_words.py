"""Words of a .geo file: which parameters it takes."""

from __future__ import annotations

import re
from pathlib import Path

from receding_fenicsx.scene.model import Body


def takes_elements(body: Body) -> bool:
    """Return whether a body's file is a .geo file that takes ``contact_elements``."""
    path = Path(body.mesh or "")
    return path.suffix == ".geo" and "contact_elements" in words_of(path)


def words_of(path: Path) -> set[str]:
    """Return the words of a .geo file, and of the .geo files that it includes."""
    words: set[str] = set()
    read, todo = set(), [path]
    while todo:
        file = todo.pop()
        if file in read or not file.is_file():
            continue
        read.add(file)
        text = file.read_text(encoding="utf-8", errors="replace")
        words |= set(re.findall(r"[A-Za-z_]\w*", text))
        included = re.findall(r'(?:Include|Merge)\s*"([^"]+\.geo)"', text)
        todo += [(file.parent / name).resolve() for name in included]
    return words
