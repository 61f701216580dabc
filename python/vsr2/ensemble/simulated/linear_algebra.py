"""Linear algebra whose result depends on neither the machine's threads nor LAPACK's luck."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

Array = NDArray[np.float64]


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
