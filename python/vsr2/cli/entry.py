"""The program `vsr2`: :func:`vsr2.cli.main.main`, and what may happen before it is imported."""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes, 128 plus the number of SIGINT and of SIGTERM."""


def program() -> int:
    """Run the command line and return the exit code.

    Ctrl-C and SIGTERM while modules are imported end with the messages and the exit codes that
    they have later. Nothing but `sys` is imported outside the `try`: the import of `typing` alone
    takes longer than the interpreter's own start.
    """
    try:
        import signal

        # Until `main` takes over: nothing is begun that could be kept.
        signal.signal(signal.SIGTERM, _end)
        from vsr2.cli.main import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write("vsr2: interrupted\n")
        return INTERRUPTED


def _end(number: int, frame: "FrameType | None") -> None:
    sys.stderr.write("vsr2: ended by SIGTERM\n")
    sys.exit(TERMINATED)


if __name__ == "__main__":
    sys.exit(program())
