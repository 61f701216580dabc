"""Simulated responses as a campaign would have noted them: with its noise, at its sampling."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planted import shaken_campaign
from vsr2.campaign import MeasurementNoise, Series
from vsr2.ensemble.observed.observations import observe_campaign, series_sampling


def test_responses_are_noted_as_the_campaign_noted_its_own() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    # Every fifth fell; rows of the table in another order than that of execution.
    trials = [
        dataclasses.replace(t, overturned=k % 5 == 0, peak_tilt=0.01 * (k + 1), note=str(k))
        for k, t in enumerate(plain.trials)
    ]
    rows = tuple(trials[k] for k in np.random.default_rng(3).permutation(len(trials)))
    noise = MeasurementNoise(peak_tilt=0.02)
    seen = observe_campaign(dataclasses.replace(plain, trials=rows, noise=noise), "M")
    assert [t.note for t in seen.campaign.trials] == [str(k) for k in range(len(trials))]
    fallen = np.arange(len(trials)) % 5 == 0
    np.testing.assert_array_equal(seen.overturned, fallen)
    own = np.log(0.01 * np.arange(1, 41) + 0.02)
    np.testing.assert_allclose(seen.features[:, 0], np.where(fallen, np.nan, own))
    down = np.tile(fallen, (1000, 1)).astype(float)
    noted = seen.noted(down, np.full(down.shape, 0.3), None, np.random.default_rng(1))[..., 0]
    np.testing.assert_array_equal(np.isnan(noted), down > 0.5)
    tilt = np.exp(noted[down < 0.5]) - 0.02
    assert tilt.mean() == pytest.approx(0.3, abs=5 * 0.02 / np.sqrt(tilt.size))
    assert tilt.std() == pytest.approx(0.02, rel=0.05)


def test_a_noise_of_the_logarithm_scatters_noted_tilts() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    trials = tuple(dataclasses.replace(t, overturned=False, peak_tilt=0.3) for t in plain.trials)
    noise = MeasurementNoise(peak_tilt=0.02, peak_tilt_relative=0.1)
    seen = observe_campaign(dataclasses.replace(plain, trials=trials, noise=noise), "M")
    peak = np.full((1000, 40), 0.3)
    noted = seen.noted(np.zeros(peak.shape), peak, None, np.random.default_rng(1))[..., 0]
    tilt = np.exp(noted) - seen.tilt_offset
    # Independent errors; the exponential's mean is above its median.
    assert np.std(tilt) == pytest.approx(np.hypot(0.02, 0.3 * 0.1), rel=0.03)
    assert np.mean(tilt) == pytest.approx(0.3 * np.exp(0.1**2 / 2), rel=0.002)


def measured_by_orientation(own=None, stated=None):
    """Trials of a rock that stays, measured by noisy orientations."""
    plain = shaken_campaign(5, 8, duration=1.5)
    time, rng = np.arange(0, 2, 0.01), np.random.default_rng(1)
    about = 0.004 * rng.standard_normal((40, 2, 200)) / 2
    trials = []
    for trial, (x, y) in zip(plain.trials, about, strict=True):
        turned = np.stack([x, y, 0 * x, np.sqrt(1 - x**2 - y**2)], axis=1)
        series = Series(time=time, orientation=turned, noise_orientation=own)
        trials.append(dataclasses.replace(trial, overturned=False, peak_tilt=None, series=series))
    noise = MeasurementNoise(tilt=0.9, orientation=stated)
    return dataclasses.replace(plain, trials=tuple(trials), noise=noise)


@pytest.mark.parametrize("noise", [{"own": 0.004}, {"stated": 0.004}, {"own": 0.004, "stated": 7}])
def test_a_tilt_that_is_read_from_the_orientation_has_its_noise_about_two_axes(noise) -> None:
    campaign = measured_by_orientation(**noise)
    sampling = series_sampling(campaign)
    assert (sampling.tilt_noise, sampling.axes) == (0.004, 2)
    assert sampling.interval == pytest.approx(0.01)
    time = np.arange(0, 80, 0.01)
    _, found = sampling.measured(time, np.zeros(time.size), np.random.default_rng(2))
    seen = np.concatenate([t.series.tilt_angle for t in campaign.trials])
    quantiles = [0.1, 0.5, 0.9, 0.99]
    np.testing.assert_allclose(
        np.quantile(found, quantiles), np.quantile(seen, quantiles), rtol=0.07
    )


def test_a_largest_tilt_of_a_series_is_that_of_the_simulated_series() -> None:
    campaign = measured_by_orientation(own=0.004)
    first = dataclasses.replace(campaign.trials[0], peak_tilt=0.2)
    mixed = dataclasses.replace(campaign, trials=(first, *campaign.trials[1:]))
    seen = observe_campaign(mixed, "M")
    assert seen.from_series.tolist() == [False] + 39 * [True]
    assert seen.reads_series
    assert not observe_campaign(mixed, "B").reads_series
    peak, series = np.full((1, 40), 0.1), np.log(np.full((1, 40, 1), 0.13))
    for found, wanted in ((series, 0.13), (None, 0.1)):
        noted = seen.noted(np.zeros(peak.shape), peak, found, np.random.default_rng(1))[0, :, 0]
        np.testing.assert_allclose(np.exp(noted) - seen.tilt_offset, [0.1] + 39 * [wanted])
