"""What is said of a command line that the verbs do not take: what is wrong, and what to give."""

from __future__ import annotations

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
    ValidationError,
)

from vsr2.cli.exclusive_options import ExclusiveOptionsError

NO_VALUE: dict[type, str] = {
    float: "is no number",
    bool: "is no value that a switch takes; leave it out",
}
"""Of a type that the library converts into: what a word is that it cannot convert."""


def usage_error(error: CycloptsError, command: str) -> str:
    """The library's message, in plain words where it has none.

    Args:
        error: of the library that reads the command line.
        command: verb as it was typed, as `vsr2 motion info`.
    """
    if isinstance(error, UnknownOptionError) and error.token.keyword == "--html":
        return f"--html is --out: `{command} ... --out FILE.html`"
    said = None
    if isinstance(error, UnknownCommandError):
        said = _no_option(error)
    elif isinstance(error, MissingArgumentError):
        said = _unnamed(error, command) or _missing(error)
    elif isinstance(error, ValidationError):
        said = _excluding(error)
    elif isinstance(error, UnusedCliTokensError):
        said = _unnamed(error, command) or _too_many(error, command)
    elif isinstance(error, CoercionError):
        said = _no_value(error)
    return said or str(error)


def _no_option(error: UnknownCommandError) -> str | None:
    """An option where a verb should stand."""
    from vsr2.near_words import offer

    word = (error.unused_tokens or [""])[0]
    if not word.startswith("-") or error.app is None:
        return None
    known = [name for name in error.app if name.startswith("--")]
    return f"{word} is no option here; {offer(word, known)}"


def _missing(error: MissingArgumentError) -> str | None:
    """An argument, or values of one, that the line lacks."""
    argument = error.argument
    if argument is None:
        return None
    count, _ = argument.token_count()
    if error.keyword:
        values = "a value" if count == 1 else f"{count} values"
        given = f", not {len(error.tokens_so_far)}" if error.tokens_so_far else ""
        return f"{error.keyword} takes {values}{given}"
    from vsr2.near_words import NEAR, near_words

    words = [word for word in error.unused_tokens or [] if word.startswith("-")]
    near = near_words(argument.name, words, alike=NEAR.offered)
    remedy = f"did you mean it by {near[0]}?" if near else "give it"
    return f"{argument.name} is missing; {remedy}"


def _excluding(error: ValidationError) -> str | None:
    """Arguments of which a group allows one."""
    cause = error.__cause__
    return str(cause) if isinstance(cause, ExclusiveOptionsError) else None


def _unnamed(error: CycloptsError, command: str) -> str | None:
    """A word that nothing takes, where the place for what is written lacks its name."""
    words = error.unused_tokens or []
    if not words or words[-1].startswith("-") or error.app is None:
        return None
    writes = any(one.name == "--out" for one in error.app.assemble_argument_collection())
    named = any(one.partition("=")[0] == "--out" for one in error.root_input_tokens or ())
    if named or not writes:
        return None
    return f"what is written is named by --out: `{command} ... --out {words[-1]}`"


def _too_many(error: UnusedCliTokensError, command: str) -> str | None:
    """Words that nothing takes."""
    words = error.unused_tokens or []
    return f"{' '.join(words)} is too much; `{command}` takes no such argument" if words else None


def _no_value(error: CoercionError) -> str | None:
    """A word that is no value of its option's type."""
    token, kind = error.token, error.target_type
    reason = NO_VALUE.get(kind) if isinstance(kind, type) else None
    if token is None or reason is None:
        return None
    return f'Invalid value for {token.keyword or "an argument"}: "{token.value}" {reason}'
