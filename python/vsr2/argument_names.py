"""Names of arguments: who mistypes one, or gives an old one, reads the right one."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from vsr2.errors import Renamed, Vsr2Error
from vsr2.near_words import nearest

NONE_ELSEWHERE: Mapping[str, str] = {}

C = TypeVar("C", bound=Callable[..., Any])


def checked_names(
    error: type[Vsr2Error], elsewhere: Mapping[str, str] = NONE_ELSEWHERE
) -> Callable[[C], C]:
    """Decorator of a class, method or function: its error names the argument that is meant.

    Python's own error for an unknown keyword names none, and that for a missing argument is none of
    VSR2's. A :class:`vsr2.errors.Renamed` of the class says what replaced an old name, with its
    unit.

    Args:
        error: raised where a keyword is no argument.
        elsewhere: what other libraries call an argument, with its name here.
    """

    def decorated(of: C) -> C:
        taken = of.__init__ if isinstance(of, type) else of  # type: ignore[misc]
        signature = inspect.signature(taken)
        parameters = signature.parameters.values()
        names = [parameter.name for parameter in parameters]
        own = names[names[:1] in (["self"], ["cls"]) :]
        known = frozenset(own)

        @functools.wraps(taken)
        def checked(*args: Any, **named: Any) -> Any:
            if not named.keys() <= known:
                name = next(name for name in named if name not in known)
                raise error(f"{of.__name__}({name}=...): {_meant(of, name, own, elsewhere)}")
            try:
                return taken(*args, **named)
            except TypeError:
                missing = _missing(signature, args, named)
                if missing is None:
                    raise
                raise error(f"{of.__name__}: `{missing}` is missing; give it") from None

        if not isinstance(of, type):
            return checked  # type: ignore[return-value]
        of.__init__ = checked  # type: ignore[misc]
        return of

    return decorated


def _missing(
    signature: inspect.Signature, args: tuple[Any, ...], named: Mapping[str, Any]
) -> str | None:
    """The first argument that a call lacks; None: it lacks none."""
    try:
        given = signature.bind_partial(*args, **named).arguments
    except TypeError:  # More by position than there are.
        return None
    for name, one in signature.parameters.items():
        if one.default is one.empty and name not in given:
            return name
    return None


def _meant(
    of: Callable[..., Any], name: str, known: list[str], elsewhere: Mapping[str, str]
) -> str:
    gone = getattr(of, name, None)
    if isinstance(gone, Renamed) and gone.name in known:
        return f"is gone; use {gone.now}"
    near = elsewhere.get(name) or nearest(name, known)
    hint = f"did you mean `{near}`?" if near else f"known are {', '.join(known)}"
    return f"is no argument; {hint}"
