"""``python -m receding_fenicsx``: the command line."""

import sys

from receding_fenicsx.cli import main

if __name__ == "__main__":
    sys.exit(main())
