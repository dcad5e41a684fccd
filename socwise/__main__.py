"""Run the command line as ``python -m socwise``."""

import sys

from socwise.cli import main

if __name__ == "__main__":
    sys.exit(main())
