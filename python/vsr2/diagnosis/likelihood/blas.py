"""Linear algebra on one thread.

A product that BLAS shares out over threads is summed in another order than on one, so that its last
bits, and with them a verdict, would depend on the machine. The matrices here are small besides: on
cores that others use too, BLAS threads that wait for each other take many times as long.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """As a decorator or in `with`: NumPy's and SciPy's BLAS use one thread meanwhile."""
    import scipy.linalg  # noqa: F401  # its BLAS must be loaded to be limited

    with threadpool_limits(limits=1, user_api="blas"):
        yield
