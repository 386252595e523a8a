"""Pages of the gallery: one for each demo, from its docstring, pictures, scene and script."""

import ast
import re
from pathlib import Path

from api_pages import markdown

PICTURES = {
    "block": {
        "cycle.gif": "One cycle: fringes of the largest shear, states and tractions",
        "zones_unloading.png": "Zones on complete unloading (Fig. 5)",
        "tractions.png": "Tractions in the friction cone at a third of the load (Fig. 6)",
        "slip.png": "Slip gained per cycle and its power law (Fig. 8)",
        "zones_steady.png": "Zones in the steady cycle (Fig. 9)",
        "fringes_steady.png": "Fringes of the largest shear in the steady cycle",
        "hysteresis.png": "Hysteresis loops of the load",
        "trajectories.png": "Paths of four nodes: tractions in the friction cone, displacements",
        "dissipation_density.png": "Dissipation along the contact, per cycle",
    },
    "problem_figure": {"problem.png": "The problem"},
}
"""Pictures of the demos whose pictures do not begin with their name, with captions."""


def pictures_of(demos: Path, name: str) -> dict[str, str]:
    """Return a demo's pictures in ``demos/pictures``: file names, each with its caption or ""."""
    if name in PICTURES:
        return PICTURES[name]
    found = (path.name for path in (demos / "pictures").glob("*.*") if _is_of(path.stem, name))
    return dict.fromkeys(sorted(found, key=lambda file: (len(file), file)), "")


def _is_of(picture: str, name: str) -> bool:
    """Whether a picture is called like a demo, or begins with its name and an underscore."""
    return picture == name or picture.startswith(f"{name}_")


def demo_names(demos: Path) -> list[str]:
    """Return the demos: the paper's study, others with a scene of their own, then the rest."""

    def rank(name: str) -> tuple[bool, bool, str]:
        return name != "block", not (demos / f"{name}.toml").is_file(), name

    return sorted((path.stem for path in demos.glob("*.py")), key=rank)


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
        "Problems to start from: `bash demos/run.sh NAME` runs one on two ranks.",
    ]
    cards = []
    for name in names:
        title, rest = _docstring(demos / f"{name}.py")
        pictures = pictures_of(demos, name)
        thumbnail = "".join(f"![](pictures/{picture}) " for picture in list(pictures)[:1])
        cards.append(f"* {thumbnail}[{title}](gallery/{name}.md)")
        page = [f"# {title}", f"`bash demos/run.sh {name}`", rest]
        for picture, caption in pictures.items():
            page += [f"![{caption or title}](../pictures/{picture})", caption]
        scenes = sorted(path.name for path in demos.glob("*.toml") if _uses(demos, name, path.name))
        for file, language in [*((scene, "toml") for scene in scenes), (f"{name}.py", "python")]:
            page += [
                f"## {file}",
                f"```{{literalinclude}} ../demos/{file}\n:language: {language}\n```",
            ]
        (source / "gallery" / f"{name}.md").write_text("\n\n".join(page), encoding="utf-8")
    entries = (f"{name} <gallery/{name}>" for name in names)
    tree = ["```{toctree}", ":hidden:", "", *entries, "```"]
    parts += ["\n".join(cards), "\n".join(tree)]
    (source / "gallery.md").write_text("\n\n".join(parts), encoding="utf-8")


def _docstring(path: Path) -> tuple[str, str]:
    """Return the first line of a script's docstring, without its full stop, and the rest."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or path.stem
    title, _, rest = text.partition("\n")
    return title.rstrip("."), markdown(rest.strip())


def _uses(demos: Path, name: str, scene: str) -> bool:
    """Whether a demo reads a scene file of the demos."""
    return re.search(rf"\b{re.escape(scene)}\b", (demos / f"{name}.py").read_text()) is not None
