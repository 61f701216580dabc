"""What the inference makes of an effect: its parameters as shares of their range from the null."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

from vsr2.effects import Effect, Parameter
from vsr2.effects.own_code import own_code

NONE: Final = "none"
"""Label of the hypothesis that nothing is missing."""
UNKNOWN: Final = "unknown"
"""Label of the hypothesis that the cause lies outside the library."""

HALVINGS = 50
"""Of [0, 1], after which a bisection has reached the rounding of numbers near 1 (2^-52)."""

GAIN: Final = "table_gain"
"""The effect by which a motion is scaled."""

Library = Mapping[str, Effect]
"""Effects by name, in the order of application; every null value is a number."""
Side = int
"""Of an effect's null: -1 below, 1 above."""


def content_of(library: Library) -> str:
    """All of a library that a diagnosis depends on: names, parameters with priors, twins, code."""
    return repr(
        [(e.name, e.parameters, e.confounded_with, own_code(type(e))) for e in library.values()]
    )


def free_parameters(effect: Effect) -> tuple[Parameter, ...]:
    """Those that the prior leaves open."""
    return tuple(p for p in effect.parameters if p.prior != "fixed" and p.lower < p.upper)


def primary_parameters(effect: Effect) -> tuple[Parameter, ...]:
    """The free ones that act alone: their null is no effect."""
    return tuple(p for p in free_parameters(effect) if not p.secondary)


@lru_cache(maxsize=1024)
def null_quantile(parameter: Parameter) -> float | None:
    """Prior quantile of the null value; None where the prior cannot reach it.

    Found by bisection, because a prior gives only its quantile function.
    """
    if not parameter.lower <= parameter.null <= parameter.upper:
        return None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if parameter.ppf(min(max(middle, 1e-9), 1 - 1e-9)) < parameter.null:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def sides(effect: Effect) -> tuple[Side, ...]:
    """Sides of the null on which an effect has values; none where it has no open parameter."""
    primary = primary_parameters(effect)
    if not primary:
        return ()
    return (-1, 1) if any(map(two_sided, primary)) else (1,)


def parameter_sides(parameter: Parameter) -> tuple[Side, ...]:
    """Sides of its null on which a primary parameter has values; 1 stands for an only one."""
    return (-1, 1) if two_sided(parameter) else (1,)


def two_sided(parameter: Parameter) -> bool:
    """Whether its prior reaches to both sides of its null, but for rounding."""
    return 1e-6 < _null(parameter) < 1 - 1e-6


def value_at(parameter: Parameter, share: float) -> float:
    """Value of a free parameter.

    Args:
        parameter: with a prior.
        share: of a primary one its share of the range from the null, in [-1, 1], negative below
            the null where it is two-sided; of a secondary one the prior quantile.
    """
    if parameter.secondary:
        return parameter.ppf(share)
    if share == 0:
        return parameter.null
    null = _null(parameter)
    up = share > 0 if two_sided(parameter) else null < 0.5
    quantile = null + abs(share) * ((1 - null) if up else -null)
    return parameter.ppf(min(max(quantile, 0.0), 1.0))


def values_at(
    effect: Effect, side: Side, shares: Sequence[float], secondary: Sequence[float]
) -> tuple[float, ...]:
    """Values of all parameters, fixed ones at their null.

    Args:
        effect: of the library.
        side: of the null; of a parameter with one side alone, that one.
        shares: of the range on that side, one for each primary parameter, in [0, 1].
        secondary: prior quantiles of the secondary free parameters.

    Returns:
        One value for each of `effect.parameters`.
    """
    left, rest = iter(shares), iter(secondary)
    known = {
        p.name: value_at(p, next(rest) if p.secondary else side * max(next(left), 0.0))
        for p in free_parameters(effect)
    }
    return tuple(float(known.get(p.name, p.null)) for p in effect.parameters)


def _null(parameter: Parameter) -> float:
    """Quantile of the null, or of the end of the prior next to it."""
    null = null_quantile(parameter)
    return (1.0 if parameter.null > parameter.upper else 0.0) if null is None else null


def is_angle(parameter: Parameter) -> bool:
    """Whether the prior spans a full turn."""
    turn = turn_of(parameter)
    return turn > 0 and abs(parameter.upper - parameter.lower - turn) < 1e-6 * turn


def turn_of(parameter: Parameter) -> float:
    """A full turn in the parameter's unit; 0 where it is no angle."""
    return {"degree": 360.0, "rad": 2 * math.pi}.get(parameter.unit, 0.0)
