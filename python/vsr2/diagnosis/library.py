"""What the inference needs to know of an effect: its name, parameters with priors, and channels.

An entry is an effect of any simulator: :class:`vsr2.effects.Effect` has the same attributes, and so
have the planar block's own entries.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NONE = "none"
"""Label of the hypothesis that nothing is missing."""
UNKNOWN = "unknown"
"""Label of a gap that no entry and no pair explains."""


class Parameter(Protocol):
    """One number of an effect, with its prior.

    Attributes:
        name, unit: for people.
        null: value at which the effect is absent; may lie outside `lower` to `upper`.
        lower, upper: bounds of the prior.
        prior: its kind; "fixed" parameters stay at `null`.
        secondary: without effect on its own, an azimuth for example.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def unit(self) -> str: ...  # noqa: D102
    @property
    def null(self) -> float: ...  # noqa: D102
    @property
    def lower(self) -> float: ...  # noqa: D102
    @property
    def upper(self) -> float: ...  # noqa: D102
    @property
    def prior(self) -> str: ...  # noqa: D102
    @property
    def secondary(self) -> bool: ...  # noqa: D102
    def ppf(self, u: float, /) -> float:
        """Prior quantile of `u` in (0, 1)."""
        ...


class Entry(Protocol):
    """One effect of the library."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def parameters(self) -> tuple[Parameter, ...]: ...  # noqa: D102
    @property
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def stage(self) -> str: ...  # noqa: D102


Library = Mapping[str, Entry]


def free_parameters(entry: Entry) -> tuple[Parameter, ...]:
    """Those that the prior leaves open."""
    return tuple(p for p in entry.parameters if p.prior != "fixed" and p.lower < p.upper)


HINGES = (0.5, 1.25)
"""Distances from the null, of at most 2, at which an effect may begin to act."""

_NULLS: dict[Hashable, float | None] = {}


def null_quantile(parameter: Parameter) -> float | None:
    """Prior quantile of the null value; None where the prior cannot reach it."""
    key = (type(parameter), parameter.prior, parameter.null, parameter.lower, parameter.upper)
    if key not in _NULLS:
        _NULLS[key] = _null_quantile(parameter)
    return _NULLS[key]


def _null_quantile(parameter: Parameter) -> float | None:
    """Found by bisection, because a prior tells only its quantile function."""
    if not parameter.lower <= parameter.null <= parameter.upper:
        return None
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if parameter.ppf(min(max(middle, 1e-9), 1 - 1e-9)) < parameter.null:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def positions(entry: Entry, quantiles: Array) -> Array:
    """Quantiles of the library's priors at quantiles of the diagnosis' own, shape (n, parameters).

    A cause is more likely weak than strong, and most effects show long before their prior ends: the
    distance of a primary parameter's quantile from that of its null value is squared, of the larger
    distance that its side has. So half the draws lie within a quarter of the range.
    """
    out = np.array(np.atleast_2d(quantiles), dtype=np.float64)
    for j, parameter in enumerate(free_parameters(entry)):
        null = null_quantile(parameter)
        if parameter.secondary or null is None:
            continue
        gap = out[:, j] - null
        side = np.where(gap > 0, 1.0 - null, null)
        out[:, j] = null + gap * np.abs(gap) / np.maximum(side, 1e-9)
    return out


def basis_size(entry: Entry) -> int:
    """Number of columns of :func:`basis`."""
    return int(basis(entry, np.full((1, len(free_parameters(entry))), 0.3)).shape[1])


def is_angle(parameter: Parameter) -> bool:
    """Whether the prior spans a full turn."""
    turn = {"degree": 360.0, "rad": 2 * np.pi}.get(parameter.unit)
    return turn is not None and abs(parameter.upper - parameter.lower - turn) < 1e-6 * turn


def basis(entry: Entry, quantiles: Array) -> Array:
    """Smooth functions of an effect's free parameters that the emulator is linear in.

    With c_j = 2 (u_j - u_j0), u_j the position of parameter j in its prior and u_j0 its null's (the
    end next to it where the prior does not reach it): c, c^2 and c^3 of a primary parameter with
    values on both sides of its null; of one with values on one side 1, c, c^2 and two squared
    hinges, because such an effect may start with a jump (any bump under a flat base) or not act
    before a threshold (a cap); products c_j c_k; and 1 or c times functions of every secondary
    parameter: c and c^2, or cosine and sine of a full turn.

    Args:
        entry: the effect.
        quantiles: of its free parameters, shape (n, parameters), in (0, 1).

    Returns:
        Shape (n, `basis_size(entry)`).
    """
    parameters = free_parameters(entry)
    u = positions(entry, quantiles)
    columns: list[Array] = []
    distances: list[Array] = []
    for j in (j for j, p in enumerate(parameters) if not p.secondary):
        null = null_quantile(parameters[j])
        if null is None:
            null = 1.0 if parameters[j].null > parameters[j].upper else 0.0
        c = 2.0 * (u[:, j] - null)
        distances.append(c)
        if 1e-6 < null < 1 - 1e-6:
            columns += [c, c**2, c**3]
        else:
            columns += [np.ones(len(u)), c, c**2]
            columns += [np.maximum(np.abs(c) - knot, 0.0) ** 2 for knot in HINGES]
    for j, one in enumerate(distances):
        columns += [one * other for other in distances[:j]]
    for j, parameter in enumerate(parameters):
        if parameter.secondary:
            if is_angle(parameter):
                turn = 2 * np.pi * u[:, j]
                functions = [np.cos(turn), np.sin(turn)]
            else:
                functions = [2 * u[:, j] - 1, (2 * u[:, j] - 1) ** 2]
            columns += [one * function for one in distances for function in functions]
    return np.stack(columns, axis=1)


def coordinates(quantiles: Array, angles: Sequence[bool]) -> Array:
    """Quantiles as points whose distances make sense: full turns lie on a circle."""
    columns = []
    for j, turns in enumerate(angles):
        u = quantiles[:, j]
        columns += [np.cos(2 * np.pi * u) / np.pi, np.sin(2 * np.pi * u) / np.pi] if turns else [u]
    return np.stack(columns, axis=1)


def values_at(entry: Entry, quantiles: Array) -> tuple[float, ...]:
    """Values of all parameters at quantiles of the free ones, fixed ones at their null."""
    free = free_parameters(entry)
    clipped = np.clip(positions(entry, quantiles)[0], 1e-6, 1 - 1e-6)
    known = {p.name: float(p.ppf(float(u))) for p, u in zip(free, clipped, strict=True)}
    return tuple(known.get(p.name, float(p.null)) for p in entry.parameters)
