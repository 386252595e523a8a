"""Draw what a demo prints: ``python docs/picture_of_output.py demos/NAME.py [options]``.

For demos whose result is a table. The picture goes to ``demos/pictures/NAME.png``, where
the gallery finds it.
"""

import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

PICTURES = Path(__file__).resolve().parent.parent / "demos" / "pictures"
FONT_SIZE = 8.0
"""Size of the letters in points."""
LETTER = (0.63, 1.35)
"""Width of a letter and height of a line, over the size."""
LONGEST, WIDEST = 50, 120
"""Lines and columns that are shown; of more lines the first ones and the last ten."""


def shortened(lines: list[str]) -> list[str]:
    """Return the lines of a picture."""
    if len(lines) > LONGEST:
        lines = [*lines[: LONGEST - 11], "...", *lines[-10:]]
    return [line if len(line) <= WIDEST else f"{line[: WIDEST - 4]} ..." for line in lines]


def draw(lines: list[str]) -> Figure:
    """Return a figure of lines of text in letters of equal width."""
    width, height = (
        (count + 2) * size * FONT_SIZE / 72.0
        for count, size in zip((max(map(len, lines)), len(lines)), LETTER, strict=True)
    )
    with mpl.rc_context({"font.family": "DejaVu Sans Mono", "font.size": FONT_SIZE}):
        figure = Figure(figsize=(width, height), dpi=150)
        for i, line in enumerate(lines):
            y = 1.0 - (i + 1.7) * LETTER[1] * FONT_SIZE / 72.0 / height
            figure.text(LETTER[0] * FONT_SIZE / 72.0 / width, y, line, parse_math=False)
    return figure


def main() -> None:
    """Run the demo of the command line and draw its output."""
    demo = Path(sys.argv[1])
    command = [sys.executable, *sys.argv[1:]]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    shown = " ".join(["$ python", *sys.argv[1:]])
    figure = draw([shown, *shortened(done.stdout.rstrip().splitlines())])
    figure.savefig(PICTURES / f"{demo.stem}.png")


if __name__ == "__main__":
    main()
