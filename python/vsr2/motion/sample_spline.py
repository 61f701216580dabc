"""Interpolating splines through uniform samples: scipy's, to the last bit, in less time.

Over the sample number, knots are whole numbers. Three things follow. The system for the
coefficients depends on the number of samples alone, and the elimination of its rows settles after
`SETTLED` of them: so the factors of a short spline, with their middle repeated, are those of any
other. Away from the ends the differences of knots are known. And at samples, or midway between
them, every value is the same weighted sum of the coefficients beside it.

Operations follow each other as in scipy (`make_interp_spline`, `BSpline`), which is left what lies
at the ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Array = NDArray[np.float64]

SETTLED = 48
"""Rows at either end which elimination is left for. It repeats itself from row 25 to the seventh
from the end for degree 5, from 21 to the fifth for degree 3."""
BLOCK = 4096
"""Positions at a time: what belongs to them stays in the processor's cache."""
BOUND_ROUNDING = 1e-9
"""Relative error of a value, over that of its bound, which is far greater than any."""
MAX_KEPT = 2**16
"""Positions whose weights are kept: 3 MB for each order of a quintic spline."""


def sample_spline(values: Array, degree: int) -> BSpline:
    """The interpolating spline through samples, over their number.

    Args:
        values: shape (n,), finite, any unit, n > `degree`.
        degree: odd; ends are not-a-knot.
    """
    from scipy.interpolate import BSpline, make_interp_spline
    from scipy.linalg.lapack import dgbtrs

    size = values.size
    if size < 2 * SETTLED:
        return make_interp_spline(np.arange(float(size)), values, k=degree)
    factors, pivots = _factors(size, degree)
    coefficients, _ = dgbtrs(factors, degree - 1, 0, values, pivots)
    return BSpline.construct_fast(_knots(size, degree), coefficients, degree)


class KeptWeights:
    """Weights of the coefficients at positions where many splines are asked, kept by blocks.

    For splines of one degree, at the same positions or at the first of them. Of positions beyond
    `MAX_KEPT` nothing is kept.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[int, tuple[int, ...]], tuple[Array, list[Array]]] = {}

    def of(
        self, start: int, position: Array, degree: int, orders: tuple[int, ...]
    ) -> tuple[Array, list[Array]]:
        """The knots before positions and the weights there, as :func:`_weights` has them.

        Args:
            start: number of the first position.
            position: of a block, shape (m,).
            degree: of the spline.
            orders: of derivatives.
        """
        count = position.size
        floor, weights = self._known.get((start, orders), (position[:0], []))
        if floor.size < count:
            floor = np.floor(position)
            weights = _weights(floor, position, degree, orders)
            if start < MAX_KEPT:
                self._known[start, orders] = floor, weights
        return floor[:count], [weight[:, :count] for weight in weights]


def at(
    spline: BSpline, position: Array, orders: Sequence[int], kept: KeptWeights | None = None
) -> list[Array]:
    """Values and derivatives of a spline over the sample number at any positions.

    Args:
        spline: of :func:`sample_spline`, or an antiderivative of one.
        position: ascending, shape (m,).
        orders: of derivatives; 0: the values.
        kept: for positions at which other splines are asked, too; None: nothing is kept.

    Returns:
        Of each order, shape (m,).
    """
    low, high = _uniform(spline)
    begin, end = np.searchsorted(position, (low, max(low, high))).tolist()
    found = [np.zeros(position.size) for _ in orders]
    for part in (slice(0, begin), slice(end, None)):
        for out, order in zip(found, orders, strict=True):
            out[part] = spline(position[part], order)
    known = KeptWeights() if kept is None else kept
    for start in range(begin - begin % BLOCK, end, BLOCK):
        block = slice(start, min(start + BLOCK, end))
        floor, weights = known.of(start, position[block], spline.k, tuple(orders))
        inside = max(begin - start, 0)
        part = slice(start + inside, block.stop)
        beside = floor[inside:].astype(np.intp) + _first(spline)
        coefficients = spline.c[beside + np.arange(spline.k + 1)[:, None]]
        for out, weight in zip(found, weights, strict=True):
            _add(coefficients * weight[:, inside:], out[part])
    return found


def greatest(spline: BSpline, position: Array, order: int) -> float:
    """Greatest magnitude of a derivative at positions, most of which are not looked at.

    In an interval a spline lies between the least and the greatest of its coefficients there (C. de
    Boor, "A practical guide to splines", 2001, chapter IX). So only those intervals are looked at
    that may exceed the greatest value found in the likeliest.

    Args:
        spline: of :func:`sample_spline`.
        position: ascending, shape (m,).
        order: of the derivative, below the spline's degree.

    Returns:
        In the samples' unit, a derivative by the sample number; 0 where there is no position.
    """
    low, high = _uniform(spline)
    begin, end = np.searchsorted(position, (low, max(low, high))).tolist()
    ends = np.concatenate([position[:begin], position[end:]])
    best = float(np.abs(spline(ends, order)).max(initial=0.0))
    if begin == end:
        return best
    first, last = (int(np.floor(position[k])) for k in (begin, end - 1))
    # Of each interval, from the first to the last that has a position.
    start = first + _first(spline)
    magnitude = np.abs(np.diff(spline.c[start : last + _first(spline) + spline.k + 1], order))
    bounds = magnitude[: last - first + 1].copy()
    for k in range(1, spline.k + 1 - order):
        np.maximum(bounds, magnitude[k : k + bounds.size], out=bounds)
    bounds *= 1 + BOUND_ROUNDING
    for likeliest in (True, False):
        looked_at = first + np.flatnonzero(bounds >= bounds.max() if likeliest else bounds > best)
        edges = np.searchsorted(position[begin:end], [looked_at, looked_at + 1]) + begin
        some = np.concatenate([position[slice(*own)] for own in edges.T.tolist()] or [ends[:0]])
        best = max(best, float(np.abs(at(spline, some, (order,))[0]).max(initial=0.0)))
    return best


def on_grid(spline: BSpline, begin: int, end: int, order: int = 0, *, shift: float = 0.0) -> Array:
    """A derivative of a spline over the sample number at samples, or midway between them.

    Args:
        spline: of :func:`sample_spline`, or an antiderivative of one.
        begin: first sample.
        end: after the last sample.
        order: of the derivative; 0: the values.
        shift: 0, or 0.5 for the middle after each sample.

    Returns:
        Shape (end - begin,).
    """
    low, high = _uniform(spline)
    first, last = max(begin, int(low)), min(end, int(high))
    out = np.empty(end - begin)
    if first >= last:
        return np.asarray(spline(np.arange(begin, end) + shift, order))
    out[: first - begin] = spline(np.arange(begin, first) + shift, order)
    out[last - begin :] = spline(np.arange(last, end) + shift, order)
    floor = np.array([low])
    (weights,) = _weights(floor, floor + shift, spline.k, (order,))
    start, middle = first + _first(spline), out[first - begin : last - begin]
    middle[:] = 0.0
    for k, weight in enumerate(weights[:, 0].tolist()):
        middle += spline.c[start + k : start + k + middle.size] * weight
    return out


def _uniform(spline: BSpline) -> tuple[float, float]:
    """Positions from the first to before the second have neighbours at whole numbers alone."""
    degree = spline.k
    return spline.t[degree + 1] + degree - 1, spline.t[-degree - 2] - degree + 1


def _first(spline: BSpline) -> int:
    """The first coefficient that acts in an interval, less the interval's sample number."""
    # An interval's knot of number l sees the coefficients l - degree to l.
    return 1 - int(spline.t[spline.k + 1])


def _weights(floor: Array, position: Array, degree: int, orders: Sequence[int]) -> list[Array]:
    """B-splines amid knots at whole numbers, by the recursion of de Boor and Cox.

    Args:
        floor: the knot before each position, shape (m,).
        position: shape (m,).
        degree: of the spline.
        orders: of derivatives.

    Returns:
        Of each order, shape (degree + 1, m).
    """
    away = np.arange(1.0, degree + 1)[:, None]
    after, before = (floor + away) - position, position - (floor + 1 - away[::-1])
    lower = [np.ones((1, position.size))]
    for j in range(1, degree + 1):
        share = lower[-1] / j
        raised = np.empty((j + 1, position.size))
        raised[0] = 0.0
        np.multiply(share, before[degree - j :], out=raised[1:])
        share *= after[:j]
        raised[:-1] += share
        lower.append(raised)
    found = []
    for order in orders:
        weights = lower[degree - order]
        for j in range(degree - order + 1, degree + 1):
            share = weights * j
            share /= j
            weights = np.empty((j + 1, position.size))
            weights[0] = 0.0
            weights[1:] = share
            weights[:-1] -= share
        found.append(weights)
    return found


def _add(rows: Array, total: Array) -> None:
    """Add rows to their total, one after another."""
    for row in rows:
        total += row


def _knots(size: int, degree: int) -> Array:
    """Of the not-a-knot spline, shape (size + degree + 1,)."""
    half = degree // 2
    inner = np.arange(float(half + 1), float(size - 1 - half))
    return np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, size - 1.0)])


def _factors(size: int, degree: int) -> tuple[Array, NDArray[np.int32]]:
    """LAPACK's factors of a system, `degree` - 1 bands beside the diagonal, and their pivots."""
    short, swaps = _short_factors(degree)
    factors = np.empty((short.shape[0], size), order="F")
    factors[:, :SETTLED] = short[:, :SETTLED]
    factors[:, SETTLED:-SETTLED] = short[:, SETTLED : SETTLED + 1]
    factors[:, -SETTLED:] = short[:, -SETTLED:]
    pivots = np.arange(size, dtype=np.int32)
    pivots[-SETTLED:] += swaps[-SETTLED:] - np.arange(swaps.size, dtype=np.int32)[-SETTLED:]
    return factors, pivots


@lru_cache
def _short_factors(degree: int) -> Any:
    """As :func:`_factors`, of the fewest samples whose middle is settled."""
    from scipy.interpolate import BSpline
    from scipy.linalg.lapack import dgbtrf

    size = 2 * SETTLED + 1
    samples = np.arange(float(size))
    matrix = BSpline.design_matrix(samples, _knots(size, degree), degree).tocoo()
    band = np.zeros((3 * degree + 1, size), order="F")
    band[2 * degree + matrix.row - matrix.col, matrix.col] = matrix.data
    factors, pivots, _ = dgbtrf(band, degree, degree)
    return factors[degree + 1 : 3 * degree], pivots
