"""Motions from arrays and obspy, their plot, and response spectra."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2 import Motion
from vsr2.config.motion_source import Filter
from vsr2.errors import MotionError
from vsr2.motion import (
    STANDARD_GRAVITY,
    MotionWarning,
    Record,
    build_recorded_motion,
    cosine_motion,
    from_signal,
    response_spectrum,
)

H = 0.01
SIGNAL = 0.3 * np.sin(2 * np.pi * np.arange(0, 6, H)) * np.hanning(600)
"""Acceleration [g]."""


def test_a_motion_from_an_array_is_that_of_its_record() -> None:
    wanted = build_recorded_motion(
        Record("record", H, acceleration=SIGNAL * STANDARD_GRAVITY), 0.002, filter=Filter()
    )
    made = Motion.from_acceleration(SIGNAL, H, time_step=0.002, filter=Filter())
    np.testing.assert_array_equal(made.displacement, wanted.displacement)
    assert made == wanted
    in_si = Motion.from_acceleration(
        SIGNAL * STANDARD_GRAVITY, H, "m/s^2", time_step=0.002, filter=Filter()
    )
    # the product in another order
    np.testing.assert_allclose(in_si.displacement, made.displacement, rtol=1e-12, atol=1e-15)


def test_units_say_what_a_signal_is() -> None:
    t = np.arange(0, 6, H)
    moved = 2.0 * np.sin(2 * np.pi * t) * np.hanning(600)
    made = from_signal(moved, H, "cm", name="x")
    assert np.abs(made.displacement).max() == pytest.approx(np.abs(moved).max() / 100, rel=1e-3)
    assert made.name == "x"
    with pytest.raises(MotionError, match="units 'gg' are not known; use one of g, m/s"):
        from_signal(moved, H, "gg")  # type: ignore[arg-type]


def test_what_is_no_acceleration_is_refused() -> None:
    for signal, units, words in (
        (
            SIGNAL,
            "ft/s^2",
            "units 'ft/s\\^2' are not known; of an acceleration use one of g, m/s\\^2",
        ),
        (
            SIGNAL,
            "cm",
            "units 'cm' are those of a displacement, which vsr2.motion.from_signal takes",
        ),
        (
            SIGNAL,
            "m/s",
            "units 'm/s' are those of a velocity, which vsr2.motion.from_signal takes",
        ),
        (SIGNAL[:5], "g", "needs one dimension and 16"),
        (["a"] * 20, "g", "is not an array of numbers"),
        (np.full(50, np.nan), "g", "acceleration is nan"),
    ):
        with pytest.raises(MotionError, match=words):
            Motion.from_acceleration(signal, H, units)  # type: ignore[arg-type]
    with pytest.warns(MotionWarning, match="Check units"):
        Motion.from_acceleration(SIGNAL * STANDARD_GRAVITY * 5, H)


def test_a_stream_of_obspy() -> None:
    obspy = pytest.importorskip("obspy")
    header = {"delta": H, "network": "XX", "station": "ABC", "channel": "HNE"}
    trace = obspy.Trace(np.asarray(SIGNAL), header)
    wanted = Motion.from_acceleration(SIGNAL, H, name="XX.ABC..HNE")
    for given in (trace, obspy.Stream([trace])):
        assert Motion.from_obspy(given, "g") == wanted
    late = trace.copy()
    late.stats.starttime += 20
    stream = obspy.Stream([trace, late])
    with pytest.raises(MotionError, match="samples are missing"):
        Motion.from_obspy(stream, "g")
    assert len(stream) == 2  # as it was given
    late.stats.channel = "HNN"
    with pytest.raises(MotionError, match=r"2 channels \(XX.ABC..HNE, XX.ABC..HNN\).*select one"):
        Motion.from_obspy(stream, "g")
    with pytest.raises(MotionError, match="give an obspy Stream or Trace"):
        Motion.from_obspy([1.0], "g")


def test_the_plot_shows_the_histories() -> None:
    motion = cosine_motion(0.05, 1.0, 0.001)
    panels = motion.plot().axes
    assert [panel.get_ylabel() for panel in panels] == [
        "displacement [m]", "velocity [m/s]", "acceleration [g]",
    ]  # fmt: skip
    np.testing.assert_array_equal(panels[0].lines[0].get_ydata(), motion.displacement)
    assert np.abs(panels[2].lines[0].get_ydata()).max() == motion.pga_g


def test_one_line_says_what_a_motion_is() -> None:
    motion = cosine_motion(0.05, 1.0, 0.001, name="<a>")
    assert repr(motion) == (
        "<Motion: name='<a>', kind='cosine', duration=1, time_step=0.001, pga_g=0.2013, "
        "pgv_m_s=0.3142>"
    )
    assert motion._repr_html_().startswith("<b>Motion</b>: name=&#39;&lt;a&gt;&#39;, kind=")


def pulse_of(acceleration: np.ndarray, step: float) -> Motion:
    """A motion with this acceleration, whatever its displacement."""
    velocity = np.concatenate([[0.0], np.cumsum(acceleration[1:] + acceleration[:-1])]) * step / 2
    moved = np.concatenate([[0.0], np.cumsum(velocity[1:] + velocity[:-1])]) * step / 2
    return Motion("pulse", step, moved, velocity, acceleration, kind="recording")


def test_a_spectrum_under_a_constant_acceleration() -> None:
    """Undamped, u = -(a / w^2) (1 - cos w t): SD = 2 a / w^2, PSA = 2 a."""
    motion = pulse_of(np.full(4001, 1.5), 0.001)
    spectrum = response_spectrum(motion, [0.5, 1.0, 2.0], damping=0.0)
    # Into the first sample the acceleration rises within a step h, and the maximum lies amid two
    # samples: together a share of (w h)^2 / 12, at most 1.32e-5, is lost.
    np.testing.assert_allclose(
        spectrum.pseudo_acceleration_g, 2 * 1.5 / STANDARD_GRAVITY, rtol=1.4e-5
    )
    np.testing.assert_allclose(
        spectrum.pseudo_velocity, 3.0 / (2 * np.pi / spectrum.period), rtol=1.4e-5
    )


def test_a_spectrum_at_resonance_and_for_stiff_oscillators() -> None:
    """A stiff oscillator follows the ground; at resonance u grows to a / (2 z w^2)."""
    t = np.arange(0, 60, 0.005)
    motion = pulse_of(np.cos(2 * np.pi * t), 0.005)
    spectrum = response_spectrum(motion, [0.02, 1.0], damping=0.05)
    assert spectrum.pseudo_acceleration_g[0] == pytest.approx(motion.pga_g, rel=0.6)
    # e^(-z w t) is below 1e-8 in the end; the peak lies within half a sample of one.
    assert spectrum.pseudo_acceleration_g[1] == pytest.approx(motion.pga_g / 0.1, rel=2e-3)


@pytest.mark.parametrize(
    ("periods", "damping"), [([], 0.05), ([0.0], 0.05), ([np.nan], 0.05), (["1"], 0.05), ([1], 1.0)]
)
def test_no_spectrum_of_impossible_oscillators(periods: list[float], damping: float) -> None:
    with pytest.raises(MotionError, match="response spectrum"):
        response_spectrum(cosine_motion(0.05, 1.0, 0.001), periods, damping=damping)
