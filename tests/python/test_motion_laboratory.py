"""The laboratory campaign's recordings, where they are at hand."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from vsr2.config.study import AllRecordings, Filter
from vsr2.motion import (
    STANDARD_GRAVITY,
    build_motions,
    build_recorded_motion,
    read_record,
    recorded_pga,
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
    ratios = [
        recorded_pga(record_of(name)) / STANDARD_GRAVITY / float(trials[name]["pga_g"])
        for name in sample
    ]
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
