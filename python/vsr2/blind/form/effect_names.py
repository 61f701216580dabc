"""What packs and keys say of effects, beside the library.

Effects of another custodian may have names of their own: of these nothing is known.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from vsr2.blind.form.reader import Name, Part, misfit
from vsr2.config.problems import shown
from vsr2.effects import Effect, library
from vsr2.errors import ConfigError
from vsr2.near_words import slip_of


def _no_slip(name: str) -> str:
    known = library()
    if name not in known and (meant := slip_of(name, known)):
        raise ValueError(f"there is no effect {name!r}; do you mean {meant!r}?")
    return name


EffectName = Annotated[Name, AfterValidator(_no_slip)]
"""A name that is nearly one of the library's is a slip."""
EffectNames = Annotated[tuple[EffectName, ...], Field(strict=False)]


class NamedEffect(Part):
    """An effect and what it acts with.

    Attributes:
        name: of the effect.
        values: by parameter; of an effect of the library they can be simulated.
    """

    name: EffectName
    values: dict[str, float]

    @property
    def known(self) -> Effect | None:
        """The effect in the library; None: it lacks it."""
        return library().get(self.name)

    @model_validator(mode="after")
    def _check_values(self) -> NamedEffect:
        if self.known is not None:
            for word, value in self.values.items():
                _check_value(self.known, word, value)
        return self


def _check_value(effect: Effect, name: str, value: float) -> None:
    """Refuse a parameter that an effect of the library lacks, and what it cannot be."""
    key = f"values.{name}"
    try:
        parameter = effect.parameter(name)
    except ConfigError as error:
        raise misfit(key, value, f"{effect.name} {error.message}") from None
    try:
        parameter.accept(value, key, warn=False)
    except ConfigError as error:
        raise misfit(key, value, error.message) from None


def check_strength(effect: Effect, strength: str, null: float | None) -> None:
    """Refuse a strength that does nothing on its own, and a null that is not its own.

    Args:
        effect: of the library.
        strength: one of its parameters.
        null: its value without effect; None: infinity.

    Raises:
        ValueError: names key, value and what is wanted.
    """
    parameter = effect.parameter(strength)
    if parameter.secondary:
        primary = ", ".join(one.name for one in effect.parameters if not one.secondary)
        wanted = f"it does nothing on its own; give one of {effect.name} that does: {primary}"
        raise misfit("strength", strength, wanted)
    low, high = parameter.limits or (parameter.lower, parameter.upper)
    given, own = math.inf if null is None else null, parameter.null
    if math.isnan(own):
        # As the study has it, which is a value that can be simulated.
        right, wanted = low <= given <= high, f"from {low:g} to {high:g}"
    else:
        # Where no value goes beyond the one without effect, that is no bound at all.
        right = math.isclose(given, own) or (given == math.inf and own == high)
        wanted = "null, for infinity" if own == math.inf else repr(own)
    if not right:
        raise ValueError(
            f"null is {shown(null)}; it should be {wanted}: the value of {effect.name}.{strength} "
            "without effect"
        )


def check_complete(key: str, exclude: Collection[str], classes: Iterable[Collection[str]]) -> None:
    """Refuse a class of which a campaign withholds a part alone.

    Args:
        key: of the names that the campaign withholds.
        exclude: these names.
        classes: equivalence classes of the pack.

    Raises:
        ValueError: names key, value and what is missing.
    """
    withheld = set(exclude)
    for members in map(set, classes):
        if members & withheld and members - withheld:
            missing = ", ".join(sorted(members - withheld))
            wanted = f"it should hold complete equivalence classes: {missing} too"
            raise misfit(key, list(exclude), wanted)
