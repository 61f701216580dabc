"""Entry point of the command line: verbs, exit codes, errors without tracebacks."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from vsr2.cli import (
    blind,
    bodies,
    calibration,
    campaign,
    configuration,
    diagnosis,
    effects,
    fragility,
    motion,
    replay,
    study,
)
from vsr2.effects import EffectWarning
from vsr2.errors import Vsr2Error

EXIT_CODES = """\
exit codes:
  0  done
  1  done, but some trials have no trustworthy outcome (see their status)
  2  the input cannot be used; nothing was run
  130  interrupted; finished trials are kept
"""


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = argparse.ArgumentParser(
        prog="vsr2",
        description="Virtual shake robot: precariously balanced rocks on a shaking pedestal.",
        epilog=EXIT_CODES + "\n`vsr2 VERB --help` explains a verb.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="version and build facts, then end")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    for room in (
        study,
        replay,
        bodies,
        motion,
        campaign,
        calibration,
        fragility,
        effects,
        diagnosis,
        blind,
        configuration,
    ):
        room.add_verbs(verbs)
    return parser


@contextmanager
def _one_line_warnings() -> Iterator[None]:
    """Warnings about effects as one line on stderr, each once."""
    with warnings.catch_warnings():
        usual, told = warnings.showwarning, set()

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, EffectWarning):
                usual(message, category, filename, lineno, file, line)
            elif str(message) not in told:
                told.add(str(message))
                print(f"vsr2: warning: {message}", file=sys.stderr)

        warnings.showwarning = show
        yield


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    if options.version:
        from vsr2._native import build_facts

        print("\n".join(f"{name}: {value}" for name, value in build_facts().items()))
        return 0
    if options.verb is None:
        parser.print_help()
        return 2
    try:
        with _one_line_warnings():
            return int(options.run(options))
    except Vsr2Error as error:
        print(f"vsr2: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vsr2: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of our output went away, as in `vsr2 ... | head`.
        sys.stderr.close()
        return 0


if __name__ == "__main__":
    sys.exit(main())
