"""Pages of the gallery: one for each demo, from its docstring, pictures, scene and script."""

import ast
import re
from pathlib import Path

from api_pages import markdown

PICTURES = {
    "block": (
        "cycle.gif",
        "zones_unloading.png",
        "tractions.png",
        "slip.png",
        "zones_steady.png",
        "fringes_steady.png",
        "hysteresis.png",
        "trajectories.png",
        "dissipation_density.png",
    ),
    "problem_figure": ("problem.png",),
}
"""Pictures of the demos whose pictures do not begin with their name."""


def pictures_of(demos: Path, name: str) -> list[str]:
    """Return the names of a demo's pictures in ``demos/pictures``."""
    if name in PICTURES:
        return list(PICTURES[name])
    found = (demos / "pictures").glob(f"{name}*.*")
    return sorted((path.name for path in found), key=lambda file: (Path(file).stem, file))


def demo_names(demos: Path) -> list[str]:
    """Return the demos: the paper's study first, then by name."""
    return sorted(
        (path.stem for path in demos.glob("*.py")), key=lambda name: (name != "block", name)
    )


def write_pages(demos: Path, source: Path) -> None:
    """Write the gallery and a page for each demo.

    Args:
        demos: folder of the demos.
        source: folder of the pages, which has ``demos`` (scripts, scenes) and ``pictures``.
    """
    names = demo_names(demos)
    (source / "gallery").mkdir()
    parts = [
        "# Gallery",
        "Every demo of the project: `bash demos/run.sh NAME` runs one on two ranks.",
    ]
    for name in names:
        title, rest = _docstring(demos / f"{name}.py")
        pictures = pictures_of(demos, name)
        parts += [f"## [{title}](gallery/{name}.md)"]
        parts += [f"![{title}](pictures/{pictures[0]})"] if pictures else []
        parts += [_problem(rest)]
        page = [f"# {title}", f"`bash demos/run.sh {name}`", rest]
        page += [f"![{Path(picture).stem}](../pictures/{picture})" for picture in pictures]
        scenes = sorted(path.name for path in demos.glob("*.toml") if _uses(demos, name, path.name))
        for file, language in [*((scene, "toml") for scene in scenes), (f"{name}.py", "python")]:
            page += [
                f"## {file}",
                f"```{{literalinclude}} ../demos/{file}\n:language: {language}\n```",
            ]
        (source / "gallery" / f"{name}.md").write_text("\n\n".join(page), encoding="utf-8")
    entries = (f"{name} <gallery/{name}>" for name in names)
    tree = ["```{toctree}", ":hidden:", "", *entries, "```"]
    parts.append("\n".join(tree))
    (source / "gallery.md").write_text("\n\n".join(parts), encoding="utf-8")


def _docstring(path: Path) -> tuple[str, str]:
    """Return the first line of a script's docstring, without its full stop, and the rest."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or path.stem
    title, _, rest = text.partition("\n")
    return title.rstrip("."), markdown(rest.strip())


def _problem(text: str) -> str:
    """Return what a demo says of its problem: its first paragraph, with the list that follows."""
    paragraphs = text.split("\n\n")
    length = 2 if paragraphs[0].endswith(":") else 1
    return "\n\n".join(paragraphs[:length]).removeprefix("**Problem.** ")


def _uses(demos: Path, name: str, scene: str) -> bool:
    """Whether a demo reads a scene file of the demos."""
    return re.search(rf"\b{re.escape(scene)}\b", (demos / f"{name}.py").read_text()) is not None
