"""Splines through samples against scipy's own, to the last bit."""

import platform

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from vsr2.motion.sample_spline import SETTLED, KeptWeights, at, greatest, on_grid, sample_spline

SIZES = (16, 2 * SETTLED - 1, 2 * SETTLED, 2 * SETTLED + 1, 2 * SETTLED + 2, 997, 5000)
"""Round the size from which the repeated rows are used, and beyond a block of positions."""
DEGREES = (3, 5)
RATIOS = (0.8, 1.0, 1 / 1.03, 2.3)
"""Of a new interval to the old."""


def walk(size):
    """Samples without any smoothness."""
    return np.cumsum(np.random.default_rng(size).standard_normal(size))


def pulse(size):
    """Samples at rest for the first half."""
    late = np.maximum(np.arange(size) - size // 2, 0)
    return np.sin(late / 7.0)


def both(size, degree, samples=walk):
    """Ours and scipy's."""
    values = samples(size)
    return sample_spline(values, degree), make_interp_spline(
        np.arange(float(size)), values, k=degree
    )


def same_bits(found, expected):
    """Whether two arrays are equal to the sign of a zero.

    Compilers for other processors fuse scipy's multiplications and additions; there, to rounding.
    """
    if platform.machine() not in ("x86_64", "AMD64"):
        return np.allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    return np.asarray(found).tobytes() == np.asarray(expected).tobytes()


@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("size", SIZES)
def test_coefficients_are_those_of_scipy(size, degree):
    found, expected = both(size, degree)
    assert same_bits(found.t, expected.t)
    assert same_bits(found.c, expected.c)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("samples", [walk, pulse, np.zeros])
@pytest.mark.parametrize("size", SIZES)
def test_values_and_derivatives_at_any_positions_are_those_of_scipy(size, samples, ratio):
    found, expected = both(size, 5, samples)
    position = np.minimum(np.arange(int((size - 1) / ratio) + 1) * ratio, size - 1.0)
    for order, values in enumerate(at(found, position, (0, 1, 2))):
        assert same_bits(values, expected(position, order))


@pytest.mark.parametrize("ratio", RATIOS)
def test_kept_weights_serve_splines_of_any_length(ratio):
    kept = KeptWeights()
    for size in (*SIZES, *reversed(SIZES)):
        found, _ = both(size, 5)
        position = np.minimum(np.arange(int((size - 1) / ratio) + 1) * ratio, size - 1.0)
        for orders in ((0, 1), (2,)):
            fresh = at(found, position, orders)
            for values, expected in zip(at(found, position, orders, kept), fresh, strict=True):
                assert values.tobytes() == expected.tobytes()


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("samples", [walk, pulse, np.zeros])
@pytest.mark.parametrize("size", SIZES)
def test_the_greatest_is_that_of_all_positions(size, samples, ratio, order):
    found, _ = both(size, 5, samples)
    for first in (0, size // 3):
        position = np.minimum(np.arange(first, int((size - 1) / ratio) + 1) * ratio, size - 1.0)
        (every,) = at(found, position, (order,))
        assert greatest(found, position, order) == np.abs(every).max(initial=0.0)


@pytest.mark.parametrize("shift", [0.0, 0.5])
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("size", SIZES)
def test_values_at_samples_and_midway_are_those_of_scipy(size, degree, order, shift):
    found, expected = both(size, degree)
    for begin, end in ((0, size - 1), (3, size - 5), (size // 2, size // 2 + 1)):
        position = np.arange(begin, end) + shift
        values = on_grid(found, begin, end, order, shift=shift)
        assert same_bits(values, expected(position, order))


@pytest.mark.parametrize("size", SIZES)
def test_antiderivatives_at_samples_are_those_of_scipy(size):
    found, expected = both(size, 3)
    for _ in range(2):
        found, expected = found.antiderivative(), expected.antiderivative()
        assert same_bits(on_grid(found, 2, size), expected(np.arange(2.0, size)))


def test_a_spline_goes_through_its_samples():
    """To rounding, of a system whose condition is below 10."""
    values = walk(4000)
    rounding = 100 * np.finfo(float).eps * np.abs(values).max()
    assert np.abs(on_grid(sample_spline(values, 5), 0, 4000) - values).max() < rounding
