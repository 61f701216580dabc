"""The section `effects` of a study: its form; names and values are the library's to judge."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator

from vsr2.config.section import inapplicable

_EFFECT_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}\Z")


def _effects_mapping(given: object) -> object:
    """Check the form of `effects`; which names and values exist the library of effects knows."""
    if not isinstance(given, Mapping):
        raise ValueError(
            f"must hold names of effects, each with its parameters (is {str(given)[:60]!r}); "
            "`vsr2 effects list` prints the names"
        )
    for name, values in given.items():
        key = str(name)[:100]
        if not isinstance(name, str) or not _EFFECT_WORD.match(name):
            raise ValueError(f"{key!r} is no name of an effect; `vsr2 effects list` prints them")
        if not isinstance(values, Mapping) or not values:
            raise inapplicable(
                key,
                f"must hold parameters, {{PARAMETER: VALUE, ...}}; `vsr2 effects show {name}` "
                "prints them",
            )
        for parameter, value in values.items():
            if not isinstance(parameter, str) or not _EFFECT_WORD.match(parameter):
                raise inapplicable(key, f"{str(parameter)[:100]!r} is no name of a parameter")
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and math.isfinite(value):
                continue
            if isinstance(value, str) and _EFFECT_WORD.match(value):
                continue
            raise inapplicable(
                f"{key}.{parameter}",
                f"must be a finite number, or a word where `vsr2 effects show {name}` says so "
                f"(is {str(value)[:60]!r})",
            )
    return {name: dict(values) for name, values in given.items()}


Effects = Annotated[dict[str, dict[str, float | str]], BeforeValidator(_effects_mapping)]
