"""The program `vsr2`: :func:`vsr2.cli.main.main`, and what may happen before it is imported."""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes, 128 plus the number of SIGINT and of SIGTERM."""


def program() -> int:
    """Run the command line and return the exit code.

    Ctrl-C and SIGTERM before and after :func:`main` end the process at once: nothing is begun that
    could be kept. An exception would not do, because native modules that are amid their import,
    and libraries, turn it into one of theirs. `signal` itself imports `enum`, which takes as long
    as the interpreter's own start; `_signal` and `os` are there.
    """
    said = False
    try:
        # Typeshed does not know the builtin half of `signal`.
        import _signal  # type: ignore[import-not-found]
        import os

        def end(number: int, frame: "FrameType | None") -> None:
            if not said:
                # Not by print: the signal may have come amid another one.
                os.write(2, b"vsr2: " + sentence[number] + b"\n")
            os._exit(128 + number)

        sentence = {_signal.SIGINT: b"interrupted", _signal.SIGTERM: b"ended by SIGTERM"}
        for number in sentence:
            # Ignored, for instance, as Ctrl-C is by a shell's job in the background.
            if _signal.getsignal(number) is not _signal.SIG_IGN:
                _signal.signal(number, end)
        if sys.argv[1:] == ["--version"]:
            from vsr2.cli.version import version

            return version()
        from vsr2.cli.main import main

        code = main()
        said = code in (INTERRUPTED, TERMINATED)
    except KeyboardInterrupt:
        said, code = True, INTERRUPTED
        sys.stderr.write("vsr2: interrupted\n")
    # A KeyboardInterrupt that has left evaluated text, such as that of a dataclass, makes
    # `python -m` die by SIGINT, though it was caught, unless other text is evaluated since.
    exec("")
    return code


if __name__ == "__main__":
    sys.exit(program())
