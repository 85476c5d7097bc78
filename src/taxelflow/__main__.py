"""`python -m taxelflow`: the command line."""

import sys

from taxelflow.cli import main

if __name__ == "__main__":
    sys.exit(main())
