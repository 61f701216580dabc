"""Linear algebra whose result depends on neither the machine's threads nor LAPACK's luck."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

Array = NDArray[np.float64]
BLOCK = 1 << 19
"""Numbers in a block of rows or columns, 4 MB in double precision; chosen by hand."""


def blocks(count: int, width: int) -> Iterator[slice]:
    """Slices of rows that hold `BLOCK` numbers together, or one row; one slice at least.

    Args:
        count: of all rows.
        width: numbers in a row.
    """
    rows = max(BLOCK // max(width, 1), 1)
    for start in range(0, max(count, 1), rows):
        yield slice(start, min(start + rows, count))


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """As a decorator or in `with`: NumPy's and SciPy's BLAS use one thread meanwhile.

    A product that BLAS shares out over threads is summed in another order than on one, so that its
    last bits, and with them a verdict, would depend on the machine. The matrices here are small
    besides: on cores that others use too, BLAS threads that wait for each other take many times as
    long.
    """
    import scipy.linalg  # noqa: F401  # its BLAS must be loaded to be limited

    with threadpool_limits(limits=1, user_api="blas"):
        yield


def ridge(x: Array, y: Array, penalty: float) -> Array:
    """Coefficients b that minimise |x b - y|^2 + penalty |b|^2, shape (columns, targets).

    Args:
        x: shape (rows, columns).
        y: shape (rows, targets).
        penalty: above 0.
    """
    rows, columns = x.shape
    if columns <= rows:
        gram = x.T @ x
        gram[np.diag_indices(columns)] += penalty
        return np.asarray(np.linalg.solve(gram, x.T @ y))
    gram = x @ x.T
    gram[np.diag_indices(rows)] += penalty
    return np.asarray(x.T @ np.linalg.solve(gram, y))


def ridge_of_copies(
    copies: Sequence[NDArray[np.floating[Any]]],
    rows: NDArray[np.int64],
    y: Array,
    penalties: Sequence[float],
) -> tuple[Array, list[Array]]:
    """Ridge regressions on some rows of several arrays, centred, without a copy of these.

    The products of all rows with each other are summed over blocks, once for all penalties.

    Args:
        copies: each of shape (n, columns), in single or double precision.
        rows: of each that are used.
        y: what is regressed on each of these, of mean 0, shape (rows, targets).
        penalties: above 0.

    Returns:
        The mean of the rows; for each penalty coefficients, shape (columns, targets).
    """
    count, columns = len(copies) * rows.size, copies[0].shape[1]
    row_parts = list(blocks(rows.size, columns))
    centre = np.zeros(columns)
    for copy in copies:
        for part in row_parts:
            centre += copy[rows[part]].sum(axis=0, dtype=np.float64)
    centre /= count
    if columns <= count:
        gram, product = np.zeros((columns, columns), order="F"), np.zeros((columns, y.shape[1]))
        for copy in copies:
            for part in row_parts:
                own = copy[rows[part]] - centre
                gram = _with_products(gram, own.T)
                product += own.T @ y[part]
        return centre, _solved(gram, product, penalties)
    gram, column_parts = np.zeros((count, count), order="F"), list(blocks(columns, count))
    for part in column_parts:
        gram = _with_products(gram, _columns(copies, rows, part, centre))
    stacked = np.tile(y, (len(copies), 1))
    duals = _solved(gram, stacked, penalties)
    out = [np.zeros((columns, y.shape[1])) for _ in penalties]
    for part in column_parts:
        own = _columns(copies, rows, part, centre)
        for one, dual in zip(out, duals, strict=True):
            one[part] = own.T @ dual
    return centre, out


def _columns(
    copies: Sequence[NDArray[np.floating[Any]]],
    rows: NDArray[np.int64],
    part: slice,
    centre: Array,
) -> Array:
    """Some columns of all rows, centred, shape (copies * rows, columns)."""
    return np.concatenate([copy[rows, part] - centre[part] for copy in copies])


def _with_products(gram: Array, x: Array) -> Array:
    """A symmetric matrix plus x x^T, in its lower triangle and in its own memory."""
    from scipy.linalg.blas import dsyrk

    return np.asarray(dsyrk(1.0, x, beta=1.0, c=gram, lower=1, overwrite_c=1))


def _solved(gram: Array, y: Array, penalties: Sequence[float]) -> list[Array]:
    """(gram + penalty)^-1 y of each penalty, of the lower triangle of a matrix.

    Factors take that triangle; it comes back from the upper one, so that there is one matrix.
    """
    from scipy.linalg import cho_factor, cho_solve

    out, diagonal = [], np.array(gram.diagonal())
    _mirror(gram.T)
    for k, penalty in enumerate(penalties):
        if k:
            _mirror(gram)
        gram[np.diag_indices(len(gram))] = diagonal + penalty
        factor = cho_factor(gram, lower=True, overwrite_a=True, check_finite=False)
        out.append(np.ascontiguousarray(cho_solve(factor, y, check_finite=False)))
    return out


def _mirror(matrix: Array) -> None:
    """Copy the part above the diagonal to below it."""
    for part in blocks(len(matrix), len(matrix)):
        rest = slice(part.stop, None)
        matrix[rest, part] = matrix[part, rest].T
        own = matrix[part, part]
        upper = np.triu(own)
        own[...] = upper + np.triu(own, 1).T
