"""Fusing a table's channels, against simulated tables whose truth is known."""

from functools import cache

import numpy as np
import pytest

from vsr2.config.motion_source import Filter
from vsr2.errors import MotionError
from vsr2.motion import (
    ChannelNoise,
    Noise,
    Record,
    band_pass,
    build_recorded_motion,
    channel_noise,
    fuse,
    input_uncertainty,
    kinematics,
    synthetic_motion,
)
from vsr2.motion.fusion import _Smoother

H = 1 / 800
REST = 3.0

WHITE = ChannelNoise(Noise(5e-5), Noise(0.04))
# as measured on a table: a coloured accelerometer, a transducer half white
COLOURED = ChannelNoise(Noise(5e-5, 0.5, 0.9), Noise(0.04, 0.9, 0.9))


def sample(noise, count, chance):
    from scipy.signal import lfilter

    driven = chance.standard_normal(count) * np.sqrt(1 - noise.persistence**2)
    coloured = lfilter([1.0], [1.0, -noise.persistence], driven)
    white = chance.standard_normal(count)
    return noise.deviation * (np.sqrt(noise.share) * coloured + np.sqrt(1 - noise.share) * white)


@cache
def table(noise, pga=0.3, pgv_pga_s=0.06, seed=3, gain=1.0):
    """The truth (x, v, a) with rest around it, and the record a table's channels make of it."""
    motion = synthetic_motion(pga, pgv_pga_s, 6.0, seed, H)
    truth = [
        np.pad(signal, round(REST / H))
        for signal in (motion.displacement, motion.velocity, motion.acceleration)
    ]
    chance = np.random.default_rng(seed)
    count = truth[0].size
    record = Record(
        "table",
        H,
        displacement=truth[0] + 0.003 + sample(noise.displacement, count, chance),
        acceleration=gain * truth[2] + 0.2 + sample(noise.acceleration, count, chance),
    )
    return truth, record


def rms(error):
    return float(np.sqrt(np.mean((error - error.mean()) ** 2)))


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
@pytest.mark.parametrize(("pga", "pgv_pga_s"), [(0.1, 0.02), (0.3, 0.06), (0.5, 0.1), (0.3, 0.2)])
def test_fusion_beats_either_channel(noise, pga, pgv_pga_s):
    (x, _, a), record = table(noise, pga, pgv_pga_s)
    fused = fuse(record)
    inside = slice(800, -800)
    band = Filter()
    by_x = kinematics(record, channel="displacement", filter=band)
    by_a = kinematics(record, channel="acceleration", filter=band)
    true_x, true_a = (band_pass(signal, H, band) for signal in (x, a))
    # displacement, whole and in the band in which an accelerometer can be integrated
    assert rms(fused.displacement - x) < 0.5 * rms(record.displacement - x)
    both = kinematics(record, channel="fused", filter=band)
    in_band = rms((both.displacement - true_x)[inside])
    assert in_band < 0.7 * rms((by_x.displacement - true_x)[inside])
    assert in_band < 0.2 * rms((by_a.displacement - true_x)[inside])
    # acceleration likewise
    assert rms(fused.acceleration - a) < rms(record.acceleration - a)
    in_band = rms((both.acceleration - true_a)[inside])
    assert in_band < 0.95 * rms((by_a.acceleration - true_a)[inside])
    assert in_band < 0.5 * rms((by_x.acceleration - true_a)[inside])


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
@pytest.mark.parametrize(("pga", "pgv_pga_s"), [(0.1, 0.02), (0.3, 0.06), (0.3, 0.2)])
def test_standard_errors_are_those_of_the_truth(noise, pga, pgv_pga_s):
    (x, v, a), record = table(noise, pga, pgv_pga_s)
    fused = fuse(record)
    for name, true in (("displacement", x), ("velocity", v), ("acceleration", a)):
        score = rms((getattr(fused, name) - true) / getattr(fused, f"{name}_error"))
        # smooth shaking is no Wiener process, which errs on the side of caution; and the noise is
        # itself estimated from a few seconds
        assert 0.45 < score < 1.2, name
    assert 0.7 < fused.consistency < 1.1


def test_channels_that_disagree_show():
    """An accelerometer of half the gain cannot be explained by noise."""
    agree = fuse(table(WHITE, gain=1.0)[1])
    (x, _, _), record = table(WHITE, gain=0.5)
    disagree = fuse(record)
    assert agree.consistency < 1.2
    assert disagree.consistency > 2
    assert (disagree.acceleration_error > 1.9 * agree.acceleration_error).all()
    # where it is slow the displacement is still believed
    assert rms(disagree.displacement - x) < 0.02 * np.abs(x).max()


def test_the_smoother_is_the_posterior_of_its_model():
    """Against the whole Gaussian posterior, solved at once, in the record's middle."""
    chance = np.random.default_rng(1)
    noise = ChannelNoise(Noise(1e-3, 0.4, 0.7), Noise(0.5, 0.6, 0.8))
    interval, count, wiener = 0.02, 250, 2e-8
    measured = np.cumsum(chance.standard_normal((count, 2)) * [1e-3, 1e-4], axis=0)
    smoother = _Smoother(noise, interval, wiener)
    states, variances, _ = smoother.smooth(measured)

    # precision of x_(k+1) = step x_k + w and y_k = observed x_k + e, started wide open
    step, observed = smoother.step, smoother.observed
    size = len(step)
    driven = np.zeros((size, size))
    driven[:3, :3] = wiener * np.array(
        [[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]]
    )
    deviation = np.array([1e-3, 0.5 * interval**2])
    share, persistence = np.array([0.4, 0.6]), np.array([0.7, 0.8])
    driven[3:, 3:] = np.diag(share * deviation**2 * (1 - persistence**2))
    white = np.diag((1 - share) * deviation**2)
    precision = np.zeros((count, size, count, size))
    right = np.zeros((count, size))
    w, r = np.linalg.inv(driven), np.linalg.inv(white)
    precision[0, :, 0, :] += np.linalg.inv(np.diag([1, 1, 1, *(share * deviation**2)]))
    for k in range(count):
        precision[k, :, k, :] += observed.T @ r @ observed
        right[k] = observed.T @ r @ measured[k]
        if k + 1 < count:
            precision[k, :, k, :] += step.T @ w @ step
            precision[k + 1, :, k + 1, :] += w
            precision[k, :, k + 1, :] -= step.T @ w
            precision[k + 1, :, k, :] -= w @ step
    # of like size, so that the inverse keeps its digits
    scale = np.tile(np.sqrt(np.diag(driven)), count)
    covariance = np.linalg.inv(precision.reshape(count * size, -1) * np.outer(scale, scale))
    wanted = (scale * (covariance @ (scale * right.reshape(-1)))).reshape(count, size)
    spread = (np.diag(covariance) * scale**2).reshape(count, size)
    inside = slice(120, None)  # the start differs: run up there, wide open here
    for state in range(3):
        error = np.abs(states[inside, state] - wanted[inside, state])
        assert error.max() < 1e-4 * np.sqrt(spread[inside, state].max())
        np.testing.assert_allclose(variances[inside, state], spread[inside, state], rtol=1e-4)


@pytest.mark.parametrize("noise", [WHITE, COLOURED])
def test_noise_is_distinguished_from_the_rest(noise):
    _, record = table(noise)
    reported = channel_noise(record)
    assert reported.rest >= 4.0
    for channel in ("displacement", "acceleration"):
        wanted, found = getattr(noise, channel), getattr(reported, channel)
        # 5 s at 800 Hz, with a memory of ten samples: some 400 independent ones
        assert found.deviation == pytest.approx(wanted.deviation, rel=0.15)
        assert found.share * found.persistence == pytest.approx(
            wanted.share * wanted.persistence, abs=0.06
        )


def test_noise_given_is_used():
    _, record = table(WHITE)
    fused = fuse(record, noise=COLOURED)
    assert fused.noise is COLOURED
    # trusting the transducer brings the motion to it
    trusting = fuse(record, noise=ChannelNoise(Noise(1e-9), Noise(0.04)))
    apart, near = (rms(f.displacement - record.displacement) for f in (fuse(record), trusting))
    assert near < 0.5 * apart


def test_fusion_is_linear_in_the_record():
    _, record = table(WHITE)
    double = Record(
        "r", H, displacement=2 * record.displacement, acceleration=2 * record.acceleration
    )
    one, two = fuse(record), fuse(double)
    np.testing.assert_allclose(two.displacement, 2 * one.displacement, rtol=0, atol=1e-10)
    np.testing.assert_allclose(two.acceleration_error, 2 * one.acceleration_error, rtol=1e-6)


def test_a_study_can_drive_the_fused_motion():
    (x, _, a), record = table(COLOURED)
    motion = build_recorded_motion(record, 0.001, channel="fused", filter=Filter())
    assert "displacement and acceleration fused (noise" in motion.source
    t = np.arange(x.size) * H
    inside = (motion.times > 1) & (motion.times < t[-1] - 1)
    error = motion.acceleration - np.interp(motion.times, t, band_pass(a, H, Filter()))
    assert rms(error[inside]) < 0.03  # the accelerometer's own noise in the band is 0.033 m/s^2


def test_a_baseline_takes_a_drift_off_both_channels():
    (x, _, _), record = table(WHITE)
    t = np.arange(x.size) * H
    drifting = Record(
        "r", H, displacement=record.displacement + 1e-3 * t, acceleration=record.acceleration
    )
    assert rms(fuse(drifting).displacement - x) > 1e-3
    assert rms(fuse(drifting, baseline=1).displacement - x) < 3e-4


# --- agreement of the channels ------------------------------------------------------------------


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.4])
def test_the_gain_between_the_channels_is_found_where_they_cohere(gain):
    _, record = table(WHITE, pga=0.5, gain=gain)
    reported = input_uncertainty(record)
    strong = (reported.bands[:, 0] >= 1) & (reported.bands[:, 1] <= 8)
    assert (reported.coherence[strong] > 0.95).all()
    np.testing.assert_allclose(reported.gain[strong], gain, rtol=0.05)
    np.testing.assert_allclose(
        reported.difference_rms[strong] / reported.displacement_rms[strong], abs(gain - 1), atol=0.1
    )


def test_noise_alone_does_not_cohere():
    chance = np.random.default_rng(4)
    record = Record(
        "r",
        H,
        displacement=5e-5 * chance.standard_normal(32_000),
        acceleration=0.04 * chance.standard_normal(32_000),
    )
    reported = input_uncertainty(record)
    wide = reported.bands[:, 1] - reported.bands[:, 0] >= 1
    assert (reported.coherence[wide] < 0.2).all()
    # white: deviation squared times the share of the bandwidth of 400 Hz
    width = reported.bands[:, 1] - reported.bands[:, 0]
    np.testing.assert_allclose(
        reported.acceleration_rms[wide], 0.04 * np.sqrt(width[wide] / 400), rtol=0.15
    )
    # and twice differentiated: the integral of (2 pi f)^4 over the band
    low, high = reported.bands[wide].T
    power = (2 * np.pi) ** 4 * (high**5 - low**5) / 5 / 400
    np.testing.assert_allclose(reported.displacement_rms[wide], 5e-5 * np.sqrt(power), rtol=0.15)


def test_bands_beyond_the_sampling_tell_nothing():
    _, record = table(WHITE)
    reported = input_uncertainty(record, ((300.0, 500.0), (2.0, 4.0), (0.01, 0.02)))
    assert np.isnan(reported.gain[[0, 2]]).all()
    assert np.isfinite(reported.gain[1])


# --- refusing -----------------------------------------------------------------------------------


def test_one_channel_is_not_enough():
    for fields in ({"displacement": np.zeros(50)}, {"acceleration": np.zeros(50)}):
        record = Record("r", H, **fields)
        for use in (fuse, channel_noise, input_uncertainty):
            with pytest.raises(MotionError, match=r"fusing needs both; give a recording with both"):
                use(record)


def test_a_computed_record_has_no_noise_to_weigh_by():
    motion = synthetic_motion(0.3, 0.06, 6.0, 3, H)
    record = Record(
        "r",
        H,
        displacement=np.pad(motion.displacement, 2400),
        acceleration=np.pad(motion.acceleration, 2400),
    )
    with pytest.raises(MotionError, match=r"constant at rest.*give `noise`"):
        fuse(record)
    assert np.isfinite(fuse(record, noise=WHITE).displacement).all()


def test_a_record_too_short_for_rest_is_refused():
    record = Record("r", 0.1, displacement=np.arange(20.0), acceleration=np.arange(20.0))
    with pytest.raises(MotionError, match=r"no rest of 0.5 s"):
        fuse(record)


def test_a_record_whose_channels_never_rest_together_is_refused():
    count = 4000
    chance = np.random.default_rng(2)
    loud = np.repeat([0, 1], count // 2)
    record = Record(
        "r",
        H,
        displacement=chance.standard_normal(count) * np.where(loud, 1.0, 1e-3),
        acceleration=chance.standard_normal(count) * np.where(loud, 1e-3, 1.0),
    )
    with pytest.raises(MotionError, match="both channels rest"):
        channel_noise(record)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0,), "deviation 0.0"),
        ((float("nan"),), "deviation nan"),
        ((1.0, 1.0, 0.5), "share 1.0"),
        ((1.0, 0.5, -0.1), "persistence -0.1"),
    ],
)
def test_impossible_noise_is_refused(values, message):
    with pytest.raises(MotionError, match=message):
        Noise(*values)
