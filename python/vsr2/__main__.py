"""`python -m vsr2`: the command line."""

import sys

from vsr2.cli.entry import program

if __name__ == "__main__":
    sys.exit(program())
