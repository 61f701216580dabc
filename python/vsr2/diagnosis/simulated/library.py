"""What the inference makes of an effect: its name, parameters with priors, and channels."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect, Parameter
from vsr2.effects.effect import Stage

Array = NDArray[np.float64]

NONE = "none"
"""Label of the hypothesis that nothing is missing."""
UNKNOWN = "unknown"
"""Label of a gap that no entry and no pair explains."""


@dataclass(frozen=True)
class Reaching:
    """An effect whose range reaches beyond where it begins to overwhelm all else.

    Attributes:
        entry: the effect.
        below, above: share of the range on either side of the null at which it does, at most 1.
    """

    entry: Entry
    below: float
    above: float

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.entry.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of the effect."""
        return self.entry.parameters

    @property
    def channels(self) -> tuple[str, ...]:
        """Of the effect."""
        return self.entry.channels

    @property
    def stage(self) -> Stage:
        """Of the effect."""
        return self.entry.stage


Entry = Effect | Reaching
Library = Mapping[str, Entry]


def free_parameters(entry: Entry) -> tuple[Parameter, ...]:
    """Those that the prior leaves open."""
    return tuple(p for p in entry.parameters if p.prior != "fixed" and p.lower < p.upper)


@dataclass(frozen=True)
class RangeConstants:
    """How an effect's range is covered; chosen by hand.

    Attributes:
        hinges: distances from the null, of at most 2, at which an effect may begin to act.
        far: reach from which on a range is not compressed: half the squared distances lie in it.
        half: reach below which distances from a null outside the prior are squared too: less than
            half of those that are not lie within it.
    """

    hinges: tuple[float, float] = (0.5, 1.25)
    far: float = 0.25
    half: float = 0.5


RANGES = RangeConstants()

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


def reaches(library: Library) -> dict[str, tuple[float, float]]:
    """Below and above the null of each effect, 1 where its whole range is used."""
    return {
        name: (entry.below, entry.above) if isinstance(entry, Reaching) else (1.0, 1.0)
        for name, entry in library.items()
    }


class _Axis:
    """A primary parameter's range as distances from its null, on either side.

    Distances are shares f of the side. Up to the effect's reach r the coordinate is f / r, beyond
    it 1 + ln(f / r): what is overwhelming takes less room than what is not.

    Args:
        entry: the effect.
        parameter: one of its primary ones.
    """

    def __init__(self, entry: Entry, parameter: Parameter) -> None:
        null = null_quantile(parameter)
        self.null = (1.0 if parameter.null > parameter.upper else 0.0) if null is None else null
        self.two_sided = 1e-6 < self.null < 1 - 1e-6
        reach = (entry.below, entry.above) if isinstance(entry, Reaching) else (1.0, 1.0)
        self.squared = {up: null is not None or r < RANGES.half for up, r in enumerate(reach)}
        self.reach = {bool(up): r if r < RANGES.far else 1.0 for up, r in enumerate(reach)}
        self.side = {False: max(self.null, 1e-9), True: max(1.0 - self.null, 1e-9)}

    @property
    def compressed(self) -> bool:
        """Whether the range reaches beyond the effect's reach anywhere."""
        return any(r < 1 and self.side[above] > 1e-6 for above, r in self.reach.items())

    def placed(self, quantile: Array) -> Array:
        """Quantiles of the library's prior at quantiles of the diagnosis' own."""
        gap = quantile - self.null
        out = np.empty_like(gap)
        for above, reach in self.reach.items():
            mine = (gap > 0) == above
            share = np.abs(gap[mine]) / self.side[above]
            if self.squared[above]:
                far = share**2 * (1 - np.log(reach))
                share = reach * np.where(far < 1, far, np.exp(np.maximum(far, 1) - 1))
            out[mine] = self.null + (1 if above else -1) * share * self.side[above]
        return out

    def distance(self, position: Array) -> tuple[Array, Array]:
        """Coordinate of positions in the prior, signed, of at most 2: within reach, and beyond."""
        gap = position - self.null
        near, beyond = np.empty_like(gap), np.empty_like(gap)
        for above, reach in self.reach.items():
            mine = (gap > 0) == above
            share = np.abs(gap[mine]) / (self.side[above] * reach)
            size = (1 if above else -1) * 2 * self.side[above]
            near[mine] = size * np.minimum(share, 1)
            beyond[mine] = size * np.log(np.maximum(share, 1))
        return near, beyond


def positions(entry: Entry, quantiles: Array) -> Array:
    """Quantiles of the library's priors at quantiles of the diagnosis' own, shape (n, parameters).

    A cause is more likely weak than strong, and most effects show long before their prior ends: the
    distance of a primary parameter's quantile from that of its null value is squared, of the larger
    distance that its side has. So half the draws lie within a quarter of the range, or of what its
    coordinate makes of it where the effect is :class:`Reaching`. Where the null lies outside the
    prior, the distance is from the end next to it, and squared only where that tells less.
    """
    out = np.array(np.atleast_2d(quantiles), dtype=np.float64)
    for j, parameter in enumerate(free_parameters(entry)):
        if not parameter.secondary:
            out[:, j] = _Axis(entry, parameter).placed(out[:, j])
    return out


def at_share(entry: Entry, share: float, *, above: bool, secondary: Array) -> tuple[float, ...]:
    """Values with all primary parameters at a share of their range from the null.

    Args:
        entry: the effect.
        share: of the range on one side, in (0, 1].
        above: on which side, where there are two.
        secondary: prior quantiles of all free parameters, of which the secondary ones are used.
    """
    known = {}
    for parameter, quantile in zip(free_parameters(entry), secondary, strict=True):
        u = float(quantile)
        if not parameter.secondary:
            axis = _Axis(entry, parameter)
            up = above if axis.two_sided else axis.null < 0.5
            u = axis.null + (1 if up else -1) * share * axis.side[up]
        known[parameter.name] = float(parameter.ppf(min(max(u, 1e-6), 1 - 1e-6)))
    return tuple(known.get(p.name, float(p.null)) for p in entry.parameters)


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
    before a threshold (a cap); products c_j c_k; and c times functions of every secondary
    parameter: c and c^2, or cosine and sine of a full turn. Of an effect that is
    :class:`Reaching`, c is taken over its reach, and what lies beyond has two columns of its own in
    the logarithm of the distance.

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
    far: list[Array] = []
    for j, parameter in enumerate(parameters):
        if parameter.secondary:
            continue
        axis = _Axis(entry, parameter)
        c, beyond = axis.distance(u[:, j])
        distances.append(c)
        if axis.two_sided:
            columns += [c, c**2, c**3]
        else:
            columns += [np.ones(len(u)), c, c**2]
            columns += [np.maximum(np.abs(c) - knot, 0.0) ** 2 for knot in RANGES.hinges]
        if axis.compressed:
            far.append(beyond)
            columns += [beyond, np.abs(beyond)] if axis.two_sided else [beyond, beyond**2]
    for j, one in enumerate(distances):
        columns += [one * other for other in distances[:j]]
    for j, parameter in enumerate(parameters):
        if parameter.secondary:
            if is_angle(parameter):
                turn = 2 * np.pi * u[:, j]
                functions = [np.cos(turn), np.sin(turn)]
            else:
                functions = [2 * u[:, j] - 1, (2 * u[:, j] - 1) ** 2]
            columns += [one * function for one in distances + far for function in functions]
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
