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


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Thin singular value decomposition U, s, V' of a finite matrix.

    LAPACK's divide and conquer (gesdd, NumPy's) now and then does not converge where singular
    values vanish; its QR iteration (gesvd), several times as slow, then takes its place.

    Args:
        matrix: shape (rows, columns).
    """
    try:
        left, size, right = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        from scipy.linalg import svd

        left, size, right = svd(matrix, full_matrices=False, lapack_driver="gesvd")
    return left, size, right
