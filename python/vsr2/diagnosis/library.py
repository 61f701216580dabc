"""What the inference needs to know of an effect: its name, parameters with priors, and channels.

An entry is an effect of any simulator: :class:`vsr2.effects.Effect` has the same attributes, and so
have the planar block's own entries.
"""

from __future__ import annotations

from collections.abc import Mapping
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


def null_quantile(parameter: Parameter) -> float | None:
    """Prior quantile of the null value; None where the prior cannot reach it.

    Found by bisection, because a prior tells only its quantile function.
    """
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


def basis_size(entry: Entry) -> int:
    """Number of columns of :func:`basis`."""
    count = len(entry.parameters)
    return count + count * (count + 1) // 2 + (0 if _reaches_null(entry) else 1)


def _reaches_null(entry: Entry) -> bool:
    return any(null_quantile(p) is not None for p in entry.parameters)


def basis(entry: Entry, quantiles: Array) -> Array:
    """Smooth functions of an effect's parameters that the emulator is linear in.

    With c_j = 2 (u_j - u_j0), u_j the prior quantile of parameter j and u_j0 that of its null value
    (1/2 where there is none): all c_j, c_j c_k, and 1 where no parameter can reach its null. They
    vanish where the effect is absent.

    Args:
        entry: the effect.
        quantiles: of its parameters, shape (n, parameters), in (0, 1).

    Returns:
        Shape (n, `basis_size(entry)`).
    """
    nulls = [null_quantile(p) for p in entry.parameters]
    centre = np.array([0.5 if null is None else null for null in nulls])
    c = 2.0 * (np.atleast_2d(quantiles) - centre)
    columns = [c[:, j] for j in range(c.shape[1])]
    columns += [c[:, j] * c[:, k] for j in range(c.shape[1]) for k in range(j, c.shape[1])]
    if not _reaches_null(entry):
        columns.append(np.ones(len(c)))
    return np.stack(columns, axis=1)


def values_at(entry: Entry, quantiles: Array) -> tuple[float, ...]:
    """Parameter values at prior quantiles, shape (parameters,)."""
    clipped = np.clip(quantiles, 1e-6, 1 - 1e-6)
    return tuple(float(p.ppf(float(u))) for p, u in zip(entry.parameters, clipped, strict=True))
