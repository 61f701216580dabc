"""Which function checks which effect."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from vsr2.effects import Bench, Check, Effect

Form = Callable[[Effect, Bench], list[Check]]
FORMS: dict[str, Form] = {}
"""By the name of the effect."""


def closed_form(form: Form) -> Form:
    """Take a function for the checks of the effect of its name."""
    FORMS[form.__name__] = form
    return form


def closed_forms(effect: Effect, bench: Bench) -> list[Check]:
    """The checks of an effect of the library.

    Raises:
        LookupError: there are none; says where to write them.
    """
    if effect.name not in FORMS:
        raise LookupError(
            f"effect {effect.name!r} has no closed form; write the function "
            f"`{effect.name}(effect, bench)`, marked @closed_form, in a module of studies/"
            f"{Path(__file__).parent.name}"
        )
    return FORMS[effect.name](effect, bench)
