"""Build the documentation: ``python docs/build.py`` writes a site of HTML pages.

It needs Sphinx with myst-parser and furo (``pip install -e ".[dev]"``), no network, and neither
DOLFINx nor MPI. Warnings are errors, as of a link within the site that leads nowhere.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from site_source import DOCS, prepare


def main() -> None:
    """Build the site into the folder given by --out, which is replaced."""
    from sphinx.cmd.build import build_main

    parser = argparse.ArgumentParser(description="Build the documentation.")
    parser.add_argument("--out", default="results/site", help="folder for the pages")
    out = Path(parser.parse_args().out)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        prepare(source)
        shutil.rmtree(out, ignore_errors=True)
        places = ["-d", str(Path(folder) / "doctrees"), str(source), str(out)]
        if build_main(["-q", "-W", "--keep-going", "-c", str(DOCS), *places]):
            raise SystemExit("the documentation was not built")
    print(f"{len(list(out.rglob('*.html')))} pages in {out}, the first is {out / 'index.html'}")


if __name__ == "__main__":
    main()
