"""Verbs of the command line, called so that their errors reach the test."""

from __future__ import annotations

from vsr2.cli.main import app


def run(*arguments: object) -> int:
    """Exit code of `vsr2 ARGUMENTS`; what `main` would print as one line is raised."""
    verb, bound, _ = app.parse_args(
        [str(argument) for argument in arguments], print_error=False, exit_on_error=False
    )
    return int(verb(*bound.args, **bound.kwargs))
