"""The campaign as numbers: features, repeats, the table's recordings."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from planar.planar_simulator import PlanarSimulator
from planted import observe, shaken_campaign
from vsr2.campaign import Series
from vsr2.ensemble.noise_floor import _repeats
from vsr2.ensemble.observed.features import (
    LARGEST_TILT,
    REST_FEATURES,
    SERIES,
    TILT_FEATURES,
    Sampling,
    noted_tilt_features,
    rest_features,
    tilt_features,
)
from vsr2.ensemble.observed.observations import (
    OBSERVED,
    _reached_tier,
    observe_campaign,
    rest_logarithm,
)
from vsr2.ensemble.observed.table_motion import agreement, table_residuals
from vsr2.errors import DiagnosisError
from vsr2.motion import Record

NAMES = [feature.name for feature in TILT_FEATURES]


def bumps(*given, end=4.0, step=0.01, noise=0.0):
    """Sine arches by start, duration and height, noise between them."""
    time = np.arange(0.0, end, step)
    tilt = noise * np.abs(np.random.default_rng(0).standard_normal(time.size))
    for start, duration, height in given:
        phase = (time - start) / duration
        tilt += np.where((phase > 0) & (phase < 1), height * np.sin(np.pi * phase.clip(0, 1)), 0.0)
    return time, tilt


def named(time, tilt):
    return dict(zip(NAMES, tilt_features(time, tilt), strict=True))


def test_excursions_have_a_start_a_length_and_a_height() -> None:
    given = [(0.5, 0.8, 0.2), (1.4, 0.5, 0.1), (2.0, 0.4, 0.06), (2.5, 0.3, 0.04), (2.9, 0.2, 0.03)]
    found = named(*bumps(*given, noise=0.001))
    up = []
    for word, (start, duration, height) in zip(
        ("first", "second", "third", "fourth"), given[:4], strict=True
    ):
        # An arch is above the uplift for all but its feet.
        foot = np.arcsin(SERIES.uplift / height) / np.pi * duration
        up.append(duration - 2 * foot)
        assert found[f"{word}_start"] == pytest.approx(start + foot, abs=0.012)
        assert np.exp(found[f"{word}_excursion"]) == pytest.approx(height, abs=0.003)
        assert np.exp(found[f"{word}_duration"]) == pytest.approx(up[-1], abs=0.021)
    foot = np.arcsin(SERIES.uplift / 0.03) / np.pi * 0.2
    up.append(0.2 - 2 * foot)
    assert np.expm1(found["excursions"]) == pytest.approx(5)
    assert np.exp(found["time_aloft"]) - 0.05 == pytest.approx(sum(up), abs=0.06)
    assert found["rest_time"] == pytest.approx(3.1 - foot, abs=0.012)
    assert np.exp(found["series_tilt"]) == pytest.approx(0.2, rel=0.01)
    assert found["contradiction"] == 1.0
    assert np.isnan(found["fall_time"])


def test_what_does_not_end_is_no_excursion_and_a_fall_has_a_time() -> None:
    time, tilt = bumps((0.5, 0.4, 0.1))
    falling = tilt + np.where(time > 2, np.minimum((time - 2) ** 2, np.pi / 2), 0.0)
    found = named(time, falling)
    assert np.exp(found["first_excursion"]) == pytest.approx(0.1, rel=0.02)
    assert np.isnan([found["second_start"], found["rest_time"]]).all()
    assert np.expm1(found["excursions"]) == pytest.approx(2)
    assert found["fall_time"] == pytest.approx(2 + np.sqrt(SERIES.fallen), abs=0.011)
    assert found["contradiction"] == 0.0
    aloft = 0.4 * (1 - 2 * np.arcsin(0.1) / np.pi) + 2 - 0.1
    assert np.exp(found["time_aloft"]) - 0.05 == pytest.approx(aloft, abs=0.03)
    still = tilt_features(time, np.zeros_like(time))
    known = dict(zip(NAMES, still, strict=True))
    assert {name for name, value in known.items() if np.isfinite(value)} == {
        "series_tilt", "contradiction", "excursions", "time_aloft",
    }  # fmt: skip
    assert known["excursions"] == 0


def test_a_noted_outcome_may_contradict_the_series() -> None:
    """Noted as overturned, but the series comes to rest; noted as standing, but it fell."""
    time, rocked = bumps((0.5, 0.8, 0.3))
    fell = np.minimum(0.5 * time**2, np.pi / 2)
    stood = [tilt_features(time, series) for series in (rocked, fell)]
    lost = np.full(len(NAMES), np.nan)
    found = np.array([stood[0], stood[0], stood[1], stood[1], lost])
    noted = noted_tilt_features(found, np.array([0.0, 1.0, 0.0, 1.0, 1.0]))
    np.testing.assert_array_equal(noted[:, 1], [0, 1, 1, 0, np.nan])
    # The series' own largest tilt counts of rocks noted as overturned, up to where none comes back.
    np.testing.assert_allclose(
        np.exp(noted[:, 0]), [np.nan, 0.3, np.nan, SERIES.fallen, np.nan], rtol=1e-3
    )
    aloft = NAMES.index("time_aloft")
    np.testing.assert_array_equal(noted[:, aloft], [*found[:2, aloft], np.nan, np.nan, np.nan])
    others = [k for k in range(2, len(NAMES)) if k != aloft]
    np.testing.assert_array_equal(noted[:, others], found[:, others])


def test_how_far_a_fall_is_seen_does_not_matter() -> None:
    time, rocked = bumps((0.5, 0.8, 0.3))
    tilt = rocked + np.where(time > 1.5, np.minimum((time - 1.5) ** 2, np.pi / 2), 0.0)
    seen = [tilt_features(time[tilt < cut], tilt[tilt < cut]) for cut in (1.2, 1.4, 2.0)]
    noted = noted_tilt_features(np.array(seen), np.ones(3))
    np.testing.assert_array_equal(noted[1:], noted[[0, 0]])


def test_a_campaign_with_series_shows_its_contradictions() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    time, rocked = bumps((0.5, 0.8, 0.3))
    fell = np.minimum(0.5 * time**2, np.pi / 2)
    trials = tuple(
        dataclasses.replace(
            t, overturned=i % 4 > 1, peak_tilt=0.3 if i % 4 < 2 else None,
            series=Series(time=time, tilt=fell if i % 2 else rocked),
        )
        for i, t in enumerate(plain.trials)
    )  # fmt: skip
    seen = observe_campaign(dataclasses.replace(plain, trials=trials))
    assert seen.tier == "T"
    names = [feature.name for feature in seen.measured]
    assert names == ["largest_tilt", *NAMES]
    column = seen.features[:, names.index("contradiction")]
    np.testing.assert_array_equal(column, np.tile([0, 1, 1, 0], 10))
    # Simulated responses are noted alike: fallen or not by the simulation's own outcome.
    series = np.tile(tilt_features(time, rocked), (2, 40, 1))
    down = np.stack([np.zeros(40), np.ones(40)])
    noted = seen.noted(down, np.full((2, 40), 0.3), series, np.random.default_rng(0))
    np.testing.assert_array_equal(noted[..., names.index("contradiction")], down)
    blank = dataclasses.replace(seen, tier="M", measured=seen.measured[:1])
    assert blank.noted(down, np.full((2, 40), 0.3), series, np.random.default_rng(0)).shape == (
        2,
        40,
        1,
    )


def test_turn_and_travel_are_those_between_the_rests() -> None:
    rows = 40
    half = 0.5 * np.linspace(0.0, 0.3, rows).clip(0, 0.2)
    orientation = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    position = np.tile([0.13, -0.04, 0.0], (rows, 1))
    tilt, table = np.zeros(rows), np.full(rows, 0.1)
    # A quaternion and its negative are one orientation.
    for sign in (1.0, -1.0):
        found = rest_features(tilt, position, sign * orientation, table)
        np.testing.assert_allclose(found, [0.2, 0.05], rtol=1e-9)
    np.testing.assert_allclose(rest_features(None, position, orientation, None), [0.2, np.nan])
    assert np.isnan(rest_features(tilt + 1.2, position, orientation, table)).all()
    alone = rest_features(tilt, None, None, table, 2 * np.pi - 2 * half)
    np.testing.assert_allclose(alone, [0.2, np.nan])


def test_series_reach_tier_t_with_a_tilt_or_an_orientation() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    time, rocked = bumps((0.5, 0.8, 0.3))
    about_y = np.stack([0 * rocked, np.sin(rocked / 2), 0 * rocked, np.cos(rocked / 2)], axis=1)

    def seen(peak, **channels):
        series = Series(time=time, **channels)
        trials = tuple(
            dataclasses.replace(t, overturned=i % 2 > 0, peak_tilt=peak, series=series)
            for i, t in enumerate(plain.trials)
        )
        return observe_campaign(dataclasses.replace(plain, trials=trials))

    still = np.zeros(len(time))
    assert [seen(peak, yaw=still, slip=still).tier for peak in (None, 0.3)] == ["B", "M"]
    tilted, turned = seen(None, tilt=rocked), seen(None, orientation=about_y)
    assert tilted.tier == turned.tier == "T"
    # But for rounding of the quaternion.
    count = len(tilted.measured)
    np.testing.assert_allclose(turned.features[..., :count], tilted.features, atol=1e-6)


def test_creep_below_the_resolution_is_taken_for_none() -> None:
    size = np.array([0.0, 0.004, 0.0099, 0.02, np.nan])
    found = rest_logarithm(size, 0.01, 0.0001)
    np.testing.assert_allclose(np.exp(found), [0.01, 0.01, 0.01, 0.02, np.nan])
    # A coarse instrument resolves less.
    np.testing.assert_allclose(np.exp(rest_logarithm(size, 0.01, 0.01))[3], 0.03)


def recorded(gain=1.0, delay=0.0, corner=0.0, seed=0, interval=0.005, noise=2e-6):
    """A shaken table: displacement and acceleration of a pulse train, with their noise.

    The accelerometer is late, scaled, and passes nothing slow (first order, `corner` in Hz).
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 8.0, interval)
    displacement = sum(
        0.02 * np.exp(-(((time - at) / 0.35) ** 2)) * np.sin(2 * np.pi * f * (time - at))
        for at, f in ((2.0, 1.1), (3.5, 2.3), (5.0, 3.1))
    )
    frequency = np.fft.rfftfreq(time.size, interval)
    # Of the second difference, which is what a sampled displacement tells, gain restored.
    spectrum = -((2 * np.pi * frequency) ** 2) * np.fft.rfft(displacement)
    spectrum *= gain * np.exp(-2j * np.pi * frequency * delay)
    if corner:
        spectrum *= 1j * frequency / (1j * frequency + corner)
    acceleration = np.fft.irfft(spectrum, time.size)
    return Record(
        name="table",
        sample_interval=interval,
        displacement=displacement + noise * rng.standard_normal(time.size),
        acceleration=acceleration + 0.02 * rng.standard_normal(time.size),
    )


def test_two_recordings_of_a_table_check_each_other() -> None:
    gain_slow, _, gain_fast, phase_fast = agreement(recorded(gain=1.03, delay=0.004))
    for value, error in (gain_slow, gain_fast):
        assert value == pytest.approx(np.log(1.03), abs=4 * error)
        assert error < 0.01
    # Most of the fast power is at 2 to 4 Hz, where 4 ms are 0.05 to 0.1 rad.
    assert -0.1 < phase_fast[0] < -0.05
    one = dataclasses.replace(recorded(), acceleration=None)
    assert np.isnan(agreement(one)).all()


def test_an_accelerometer_that_passes_nothing_slow_leads_and_is_low_there() -> None:
    found = agreement(recorded(corner=0.3))
    gain_slow, phase_slow, gain_fast, phase_fast = found[:, 0]
    # 1 / (1 - 0.3i / f) from 0.5 to 2 Hz: between 14 and 1 % low, ahead by 31 to 8.5 degrees.
    assert -0.16 < gain_slow < -0.01
    assert np.radians(8.5) < phase_slow < np.radians(31)
    assert -0.012 < gain_fast < 0.002
    assert 0.02 < phase_fast < np.radians(8.6)


def test_fast_noise_of_the_displacement_hides_no_band() -> None:
    """Sampled 800 times a second, noise of 0.02 mm is 30 m/s^2 of its second difference."""
    found = agreement(recorded(gain=1.1, interval=0.00125, noise=2e-5))
    gain_slow, _, gain_fast, _ = found
    for value, error in (gain_slow, gain_fast):
        assert value == pytest.approx(np.log(1.1), abs=4 * error)


@pytest.mark.parametrize("last", [True, False])
def test_the_ends_of_a_record_tell_nothing_of_the_instruments(last) -> None:
    """A cosine's ends are steps, which fill the fast bands."""
    time = np.arange(0.0, 6.0, 0.005)
    omega = 2 * np.pi * 0.9
    acceleration = 2.0 * np.cos(omega * time)
    acceleration[-1] *= last
    one = Record(
        name="cosine",
        sample_interval=0.005,
        displacement=2.0 / omega**2 * (1 - np.cos(omega * time)),
        acceleration=acceleration,
    )
    gain_slow, phase_slow, *fast = agreement(one)
    # Instruments in order are taken to differ by 0.01.
    assert np.abs([gain_slow[0], phase_slow[0]]).max() < 0.005
    assert np.abs(np.nan_to_num(fast)).max() < 0.01


def test_noise_alone_makes_recordings_differ_by_their_standard_errors() -> None:
    found = np.stack([agreement(recorded(seed=seed)) for seed in range(60)])
    over = found[:, :, 0] / found[:, :, 1]
    # The mean of 60 within 0.5; errors may be too large, by half, but hardly too small.
    assert np.abs(over.mean(axis=0)).max() < 0.5
    deviation = over.std(axis=0)
    assert (deviation > 0.5).all()
    assert (deviation < 1.25).all()


def table_campaign(*records):
    """Eight trials of each record."""
    plain = shaken_campaign(len(records), 8, duration=2.0)
    ids = sorted({trial.motion for trial in plain.trials})
    return dataclasses.replace(
        plain,
        trials=tuple(dataclasses.replace(t, motion_file=t.motion) for t in plain.trials),
        motions=dict(zip(ids, records, strict=True)),
    )


def test_the_table_s_residuals_are_those_that_its_null_expects() -> None:
    calm = table_residuals(table_campaign(*(recorded(seed=s) for s in range(5))), null=400)
    assert calm is not None
    assert calm.residual.shape == (4, 40)
    assert calm.null.shape == (400, 4, 40)
    np.testing.assert_allclose(calm.null.std(axis=(0, 2)), 1.0, atol=0.12)
    # Noise far below the calibration error: all records of a null campaign err together.
    assert (calm.null.mean(axis=2).std(axis=0) > 0.85).all()
    assert np.abs(calm.residual).max() < 1.5
    off = [recorded(gain=1.03, seed=s) for s in range(4)]
    one = dataclasses.replace(recorded(), acceleration=None)
    loud = table_residuals(table_campaign(*off, one), null=400)
    assert loud is not None
    known = loud.residual[0] != 0
    assert known.sum() == 32
    # ln(1.03) over 1 % and less noise.
    expected = np.log(1.03) / np.hypot(0.01, agreement(off[0])[0, 1])
    assert loud.residual[0, known].mean() == pytest.approx(expected, abs=0.4)
    assert (loud.residual[:, ~known] == 0).all()
    assert (loud.null[:, :, ~known] == 0).all()
    assert table_residuals(table_campaign(one, one, one, one), null=9) is None


def test_simulated_series_are_measured_as_the_campaign_was() -> None:
    time = np.arange(0, 2, 0.01)
    tilt = 0.1 * np.sin(np.pi * time).clip(0)
    coarse, seen = Sampling(0.05, 0.0).measured(time, tilt, None)
    np.testing.assert_allclose(np.diff(coarse), 0.05)
    np.testing.assert_allclose(seen, tilt[::5], atol=1e-12)
    noisy = Sampling(0.05, 0.002).measured(time, tilt, np.random.default_rng(1))[1]
    assert 0.001 < (noisy - seen).std() < 0.003
    assert (noisy >= 0).all()


def test_only_turns_and_travels_that_can_be_seen_scatter_between_engines() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    stood = (dataclasses.replace(t, overturned=False, peak_tilt=0.1) for t in plain.trials)
    seen = dataclasses.replace(
        observe_campaign(dataclasses.replace(plain, trials=tuple(stood)), "M"),
        tier="T",
        measured=(LARGEST_TILT, *TILT_FEATURES, *REST_FEATURES),
    )
    series = np.zeros((500, 40, len(TILT_FEATURES) + 2))
    series[..., -2:] = 0.001, 0.5
    standing = np.zeros((500, 40))
    noted = seen.noted(standing, standing + 0.1, series, np.random.default_rng(2))
    np.testing.assert_allclose(noted[..., -2], np.log(OBSERVED.rest_resolution[0]))
    assert noted[..., -1].mean() == pytest.approx(np.log(0.5), abs=0.01)
    assert noted[..., -1].std() == pytest.approx(OBSERVED.rest_scatter, rel=0.03)


def test_travel_is_that_on_the_table_wherever_its_record_begins() -> None:
    """A block that the table carries 0.1 m, and that creeps 0.03 m on it."""
    time = np.arange(0.0, 1.5, 0.01)
    carried = 0.1 * np.clip(time, 0, 1)
    position = np.stack([carried + 0.03 * np.clip(time, 0, 1), 0 * time, 0 * time], axis=1)
    series = Series(time=time, tilt=np.where(time < 1, 0.02, 0.0), position=position)
    plain = shaken_campaign(5, 8, duration=1.5)
    motions = {
        name: Record(name=name, sample_interval=0.01, displacement=0.7 + carried)
        for name in plain.motions
    }
    trials = tuple(dataclasses.replace(t, overturned=False, series=series) for t in plain.trials)
    seen = observe_campaign(dataclasses.replace(plain, trials=trials, motions=motions), "T")
    names = [feature.name for feature in seen.measured]
    np.testing.assert_allclose(np.exp(seen.features[:, names.index("final_travel")]), 0.03)


def test_repeats_are_known_by_their_recordings() -> None:
    """One motion again with a recording of its own, of nearly the same size, is a repeat."""
    plain = shaken_campaign(5, 8, duration=1.5, pga_g=(0.1, 1.6))
    trials = [dataclasses.replace(trial, overturned=False) for trial in plain.trials]
    motions = dict(plain.motions)

    def again(of: int, factor: float, **changes: object) -> None:
        record = motions[str(trials[of].motion_file)]
        name = f"again{len(trials)}"
        motions[name] = dataclasses.replace(
            record, name=name, acceleration=record.acceleration * factor
        )
        added = {"trial": name, "order": len(trials), "motion_file": name} | changes
        trials.append(dataclasses.replace(trials[of], **added))

    def found() -> tuple[list[int], int]:
        blocks = dict.fromkeys(["block", "another"], plain.specimens["block"])
        campaign = dataclasses.replace(
            plain, trials=tuple(trials), motions=motions, specimens=blocks
        )
        repeated, differ = _repeats(observe_campaign(campaign, "B"))
        return repeated.tolist(), int(differ.sum())

    assert found() == ([], 0)
    again(7, 1.015)
    assert found() == ([7], 0)
    again(7, 1.01, overturned=True)
    assert found() == ([7, 7, 40], 2), "three trials are three pairs, and the last differs from two"
    again(7, 1.05)
    again(7, 1.01, motion="another")
    again(7, 1.01, specimen="another")
    assert found() == ([7, 7, 40], 2), "another amplitude, another motion, another block"
    again(20, 1.0, motion_file=trials[20].motion_file, overturned=True)
    assert found() == ([7, 7, 20, 40], 3), "one motion file twice"


def test_a_motion_that_does_not_move_is_named() -> None:
    plain = shaken_campaign(5, 8, duration=1.5)
    trials = tuple(dataclasses.replace(trial, overturned=False) for trial in plain.trials)
    name = str(trials[7].motion_file)
    rest = dataclasses.replace(
        plain.motions[name], acceleration=np.zeros_like(plain.motions[name].acceleration)
    )
    campaign = dataclasses.replace(plain, trials=trials, motions=plain.motions | {name: rest})
    with pytest.raises(DiagnosisError, match=rf"rests in the motion '{name}' of trial 'T007'"):
        observe_campaign(campaign)


def test_one_trial_in_ten_may_lack_what_a_tier_rests_on() -> None:
    """Of 100 that stood ten may, not eleven: in floating point 1 - 0.9 is less than a tenth."""
    campaign, time = shaken_campaign(10, 10), np.arange(0.0, 5.0, 0.05)
    series = Series(time=time, tilt=0.1 * np.sin(time))

    def reached(no_tilt: int, no_series: int) -> str:
        trials = tuple(
            dataclasses.replace(
                trial,
                overturned=False,
                peak_tilt=None if i < no_tilt else 0.1,
                series=None if i < no_series else series,
            )
            for i, trial in enumerate(campaign.trials)
        )
        return _reached_tier(dataclasses.replace(campaign, trials=trials), None)

    assert reached(0, 10) == "T"
    assert reached(0, 11) == "M"
    # A series tells the largest tilt too.
    assert reached(100, 10) == "T"
    assert reached(10, 100) == "M"
    assert reached(11, 100) == "B"


@pytest.mark.parametrize("trials", [30, 39])
def test_too_small_a_campaign_is_refused(trials: int) -> None:
    campaign = shaken_campaign(8, 6, duration=3.0)
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1)
    part = observed.select([i < trials for i in range(len(observed))])
    with pytest.raises(DiagnosisError, match="needs 40 trials, of 4 motions"):
        observe_campaign(part)


def test_a_few_missing_tilts_cost_no_tier() -> None:
    campaign = shaken_campaign(8, 6, duration=3.0, pga_g=(0.55, 1.15))
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1, tier="M")
    standing = [i for i, trial in enumerate(observed.trials) if not trial.overturned]

    def without(indices):
        trials = [
            dataclasses.replace(trial, peak_tilt=None) if i in indices else trial
            for i, trial in enumerate(observed.trials)
        ]
        return dataclasses.replace(observed, trials=tuple(trials))

    overturned = set(range(len(observed))) - set(standing)
    seen = observe_campaign(without({*overturned, standing[3]}))
    assert seen.tier == "M"
    assert np.isnan(seen.features[:, 0]).sum() == len(overturned) + 1
    many = without(set(standing[: len(standing) // 5 + 1]))
    assert observe_campaign(many).tier == "B"
    first = observed.trials[standing[0]].trial
    with pytest.raises(DiagnosisError, match=rf"not M: \d+ trials without largest tilt .*{first}"):
        observe_campaign(many, "M")


def test_a_tier_that_was_not_measured_is_refused() -> None:
    campaign = shaken_campaign(8, 6, duration=3.0)
    observed = observe(campaign, PlanarSimulator(campaign), nuisance=1)
    with pytest.raises(DiagnosisError, match="reaches tier B"):
        observe_campaign(observed, "T")
