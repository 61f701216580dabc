"""Entry point of the command line: verbs, exit codes, errors without tracebacks."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from vsr2.cli import (
    verb_calibrate,
    verb_config,
    verb_diagnose,
    verb_effects,
    verb_fragility,
    verb_inertia,
    verb_new,
    verb_run,
    verb_view,
)
from vsr2.cli.entry import INTERRUPTED, TERMINATED
from vsr2.cli.options import DEFAULTS
from vsr2.cli.usage_errors import usage_error
from vsr2.cli.version import version
from vsr2.errors import ConfigError, Vsr2Error

Shell = Literal["bash", "zsh", "fish"]
HELP = """\
Virtual shake robot: precariously balanced rocks on a shaking pedestal.

Exit code 0: done.

Exit code 1: done, but some trials have no trustworthy outcome (see their status).

Exit code 2: the input cannot be used; nothing was run.

Exit code 130: interrupted; finished trials are kept. 143: the same, by SIGTERM.
"""

app = App(
    name="vsr2",
    help=HELP,
    default_parameter=DEFAULTS,
    version_flags=(),
)
app.command(verb_new.new)
app.command(verb_run.run)
app.command(verb_view.view)
app.command(verb_inertia.inertia)
# Imported when they are asked for: their options take names and defaults from heavy rooms.
app.command(
    "vsr2.cli.verb_motion:verbs",
    name="motion",
    help="Ground motions: measures, conversion, synthesis, fusion of a table's channels, rotation.",
)
app.command(
    "vsr2.cli.verb_campaign:verbs",
    name="campaign",
    help="Import, check, describe and simulate campaigns of trials.\n\n"
    "A campaign is a folder with campaign.yaml, trials.csv, motions/ and series/; "
    "docs/reference/campaign.md describes the form.",
)
app.command(verb_calibrate.calibrate)
app.command(verb_fragility.fragility)
app.command(
    "vsr2.cli.verb_hazard:hazard",
    name="hazard",
    help="Rate of overturning at a site, and the age that a standing rock excludes.\n\n"
    "docs/how-to/hazard.md explains both, and what the interval holds.",
)
app.command(verb_effects.verbs)
app.command(verb_diagnose.diagnose)
app.command(
    "vsr2.cli.verb_blind:verbs",
    name="blind",
    help="Check the diagnosis on campaigns whose effect is withheld.\n\n"
    "A custodian makes a pack and seals the answer; the diagnosis gets the data alone; scoring "
    "opens the key. docs/reference/blind.md describes the forms and the duties.",
)
app.command(verb_config.verbs)
app.command(version, name="--version")


@app.command(name="--install-completion")
def _install_completion(shell: Shell, /) -> int:
    """Complete verbs and options of `vsr2` in a shell from now on.

    Args:
        shell: that is to complete
    """
    from vsr2.report.messages.commands import completion_installed

    print(completion_installed(app.install_completion(shell=shell)))
    return 0


@app.command(name="--show-completion")
def _show_completion(shell: Shell, /) -> int:
    """Print the script that completes `vsr2` in a shell.

    Args:
        shell: that runs the script
    """
    print(app.generate_completion(shell=shell))
    return 0


@app.meta.default
def _launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    verbose: Annotated[
        int, Parameter(alias="-v", count=True, allow_repeating=None, show_default=False)
    ] = 0,
    effects: tuple[Path, ...] = (),
) -> int:
    """Run a verb.

    Args:
        tokens: verb and options
        verbose: log to standard error what is done; -vv: in detail
        effects: Python file with effects of your own, which join the library (may be repeated)
    """
    if any(re.fullmatch(r"(--[\w-]+=)?\s*", token) for token in tokens):
        raise ConfigError("an argument is empty, as of a shell variable that is not set; give it")
    for file in effects:
        _add_effects(file)
    verb, bound, _ = app.parse_args(tokens, print_error=False, exit_on_error=False)
    with _one_line_warnings(), _log_to_stderr(verbose):
        code = verb(*bound.args, **bound.kwargs)
    if code is None and not set(tokens) & set(app.help_flags):
        return 2  # help in place of the verb that is missing
    return int(code or 0)


def _add_effects(file: Path) -> None:
    """Enter the effects of a file into the library of this process.

    Raises:
        ConfigError: it is no Python file, cannot be imported, or defines none.
    """
    from vsr2.effects import module_effects

    if file.suffix != ".py":
        raise ConfigError(f"--effects {file}: is no Python file; give a file with the suffix .py")
    module_effects(str(file))


@contextmanager
def _one_line_warnings() -> Iterator[None]:
    """Warnings of VSR2 as one line on stderr, each once."""
    with warnings.catch_warnings():
        usual, shown = warnings.showwarning, set()

        def show(message: Warning | str, category: type[Warning], *where: Any, **how: Any) -> None:
            # By name: a warning must not import the rooms that have others.
            if not any(kind.__module__.split(".")[0] == "vsr2" for kind in category.__mro__):
                usual(message, category, *where, **how)
            elif str(message) not in shown:
                shown.add(str(message))
                print(f"vsr2: warning: {message}", file=sys.stderr)

        warnings.showwarning = show
        yield


@contextmanager
def _log_to_stderr(verbose: int) -> Iterator[None]:
    """Records of the package's loggers on stderr: of level INFO, from 2 on DEBUG."""
    if not verbose:
        yield
        return
    import logging

    logger = logging.getLogger("vsr2")
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


class _Signals:
    """Turns SIGINT and SIGTERM into KeyboardInterrupt, which keeps what is finished.

    Attributes:
        first: number of the one that came first; 0: none came.
    """

    def __init__(self) -> None:
        self.first = 0
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> _Signals:
        if threading.current_thread() is threading.main_thread():
            for number, noted in (
                (signal.SIGTERM, self._terminated),
                (signal.SIGINT, self._interrupted),
            ):
                # As Ctrl-C of a shell's job in the background.
                if number is signal.SIGTERM or signal.getsignal(number) is not signal.SIG_IGN:
                    self._previous[number] = signal.signal(number, noted)
        return self

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        self.first = self.first or number
        raise KeyboardInterrupt

    def _terminated(self, number: int, frame: FrameType | None) -> None:
        self.first = self.first or number
        # Not by print: the signal may have come amid another one.
        os.write(2, b"vsr2: ended by SIGTERM\n")
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            raise KeyboardInterrupt
        # Not raised here: what is running may have a way of its own to stop.
        signal.raise_signal(signal.SIGINT)

    def __exit__(self, *exception: object) -> None:
        for number, previous in self._previous.items():
            signal.signal(number, previous)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    with _Signals() as signals:
        try:
            code = _main(arguments)
        except Exception:
            # Native modules amid their import, and libraries, turn KeyboardInterrupt into theirs.
            if not signals.first:
                raise
            code = None
    if signals.first == signal.SIGTERM:
        return TERMINATED
    if code is None:
        print("vsr2: interrupted", file=sys.stderr)
    # 2 is an error that was made of KeyboardInterrupt.
    return INTERRUPTED if code is None or (signals.first and code == 2) else code


def _main(arguments: Sequence[str] | None) -> int | None:
    """The exit code; None: interrupted, of which nothing is said yet."""
    try:
        launch, bound, _ = app.meta.parse_args(arguments, print_error=False, exit_on_error=False)
        code = int(launch(*bound.args, **bound.kwargs) or 0)
        # A signal while the interpreter ends must not take what was printed.
        sys.stdout.flush()
        return code
    except CycloptsError as error:
        command = " ".join(("vsr2", *(error.command_chain or ())))
        said = usage_error(error, command)
        print(f"{command}: {said}\n`{command} --help` explains.", file=sys.stderr)
        return 2
    except Vsr2Error as error:
        print(f"vsr2: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return None
    except BrokenPipeError:
        # The reader of our output went away, as in `vsr2 ... | head`.
        sys.stderr.close()
        return 0


if __name__ == "__main__":
    sys.exit(main())
