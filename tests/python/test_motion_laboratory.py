"""The laboratory campaign's recordings, where they are at hand."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from vsr2.config.motion_source import AllRecordings, Filter
from vsr2.motion import (
    band_pass,
    build_motions,
    build_recorded_motion,
    channel_noise,
    fuse,
    input_uncertainty,
    kinematics,
    pga_g,
    read_record,
)

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))

pytestmark = pytest.mark.skipif(
    not (FOLDER / "trials.csv").is_file(),
    reason=f"no laboratory data in {FOLDER}; set VSR2_LAB_DATA to their folder",
)


@pytest.fixture(scope="module")
def trials():
    with (FOLDER / "trials.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["has_motion"] == "True"]
    return {f"Test{int(row['test']):03d}": row for row in rows}


def record_of(name):
    return read_record(FOLDER / "motions" / f"{name}.npz")


def test_published_pga_is_the_accelerometers_peak_after_the_band_pass(trials):
    sample = list(trials)[:: len(trials) // 15]
    ratios = []
    for name in sample:
        record = record_of(name)
        peak = pga_g(band_pass(record.acceleration, record.sample_interval, Filter()))
        ratios.append(peak / float(trials[name]["pga_g"]))
    assert len(ratios) >= 15
    assert np.median(ratios) == pytest.approx(1.0, abs=1e-3)


def test_raw_text_and_npz_hold_the_same_record():
    files = sorted((FOLDER / "raw").glob("*.txt"))
    assert files
    for file in files:
        text, packed = read_record(file), record_of(file.stem)
        assert text.sample_interval == packed.sample_interval == 0.00125
        # both carry the six printed digits; float32 keeps seven
        np.testing.assert_allclose(text.displacement, packed.displacement, rtol=1e-6)
        np.testing.assert_allclose(text.acceleration, packed.acceleration, rtol=1e-6)


def test_both_channels_point_the_same_way(trials):
    strong = [name for name in trials if 0.4 < float(trials[name]["pga_g"]) < 0.9][::10]
    assert strong
    for name in strong:
        record = record_of(name)
        driven = build_recorded_motion(record, 0.00125, filter=Filter(low=2.0, high=12.0))
        measured = build_recorded_motion(
            record, 0.00125, channel="acceleration", filter=Filter(low=2.0, high=12.0)
        )
        # coherent above 0.9 only between 2 and 12 Hz
        assert np.corrcoef(driven.acceleration, measured.acceleration)[0, 1] > 0.8


def test_recordings_drive_as_in_the_original(trials):
    chosen = AllRecordings(
        mode="all_recordings", folder=FOLDER / "motions", pattern="Test?[05]5.npz", filter=Filter()
    )
    motions = build_motions(chosen, 0.001)
    assert len(motions) >= 5
    for motion in motions:
        record = record_of(motion.name)
        # the record's own time, not one sample a step
        assert motion.duration == pytest.approx(record.duration, abs=0.0021)
        # noise of 0.045 mm below 25 Hz, at twice the interval: far below a nanometre each
        assert motion.resampling_error < 1e-8


def strong_names(trials, count=4):
    names = [name for name in trials if 0.3 < float(trials[name]["pga_g"]) < 1.2]
    return names[:: max(1, len(names) // count)][:count]


def test_noise_at_rest_is_that_of_the_instruments(trials):
    noises = [channel_noise(record_of(name)) for name in list(trials)[::40]]
    # about 0.045 mm at rest, and an accelerometer of some thousandths of g
    assert np.median([n.displacement.deviation for n in noises]) == pytest.approx(5e-5, rel=0.3)
    assert 0.02 < np.median([n.acceleration.deviation for n in noises]) < 0.06


def test_the_channels_disagree_as_is_known(trials):
    reported = [input_uncertainty(record_of(name)) for name in strong_names(trials)]
    bands = [tuple(band) for band in reported[0].bands]
    gain = np.median([t.gain for t in reported], axis=0)
    coherence = np.median([t.coherence for t in reported], axis=0)
    # about 1 at 3-5 Hz, 1.3-1.6 at 8-12 Hz; coherent only between 2 and 12 Hz
    assert gain[bands.index((2.0, 4.0))] == pytest.approx(1.0, abs=0.1)
    assert 1.1 < gain[bands.index((8.0, 12.0))] < 1.7
    assert coherence[bands.index((2.0, 4.0))] > 0.95
    assert coherence[bands.index((12.0, 25.0))] < 0.8


def test_fused_motions_follow_each_channel_in_its_band(trials):
    for name in strong_names(trials):
        record = record_of(name)
        fused = fuse(record)
        assert np.isfinite(fused.displacement_error).all()
        # slow: the transducer, within a few of its noise's deviations
        assert np.std(fused.displacement - record.displacement) < 4e-4
        # fast: nearer to the accelerometer than the transducer differentiated twice is
        fused_a, by_a, by_x = (
            kinematics(record, channel=channel, filter=Filter(low=8.0, high=20.0)).acceleration
            for channel in ("fused", "acceleration", "displacement")
        )
        assert np.std(fused_a - by_a) < 0.7 * np.std(by_x - by_a)
