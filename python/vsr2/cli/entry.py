"""The program `vsr2`: :func:`vsr2.cli.main.main`, and what may happen before it is imported."""

from __future__ import annotations

import sys


def program() -> int:
    """Run the command line and return the exit code.

    Ctrl-C while modules are imported ends with exit code 130, as it does later.
    """
    try:
        from vsr2.cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("vsr2: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(program())
