"""Build the documentation: ``python docs/build.py`` writes a site of HTML pages.

It needs Sphinx with myst-parser and furo (``pip install -e ".[dev]"``), no network, and neither
DOLFINx nor MPI. Warnings and broken links within the site are errors.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from site_links import broken_links
from site_source import DOCS, prepare


def main() -> None:
    """Build the site into the folder given by --out."""
    parser = argparse.ArgumentParser(description="Build the documentation.")
    parser.add_argument("--out", default="results/site", help="folder for the pages")
    out = Path(parser.parse_args().out)
    build(out)
    print(f"{len(list(out.rglob('*.html')))} pages in {out}, the first is {out / 'index.html'}")


def build(out: Path) -> None:
    """Build the site.

    Args:
        out: folder of the pages, replaced.

    Raises:
        SystemExit: Sphinx warns, or a link within the site leads nowhere.
    """
    from sphinx.cmd.build import build_main

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source"
        prepare(source)
        shutil.rmtree(out, ignore_errors=True)
        places = [str(source), str(out)]
        doctrees = ["-d", str(Path(folder) / "doctrees")]
        code = build_main(["-q", "-W", "--keep-going", "-c", str(DOCS), *doctrees, *places])
    broken = [] if code else broken_links(out)
    if code or broken:
        raise SystemExit("\n".join(["the documentation was not built", *broken]))


if __name__ == "__main__":
    main()
