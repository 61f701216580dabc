"""The campaign's types refuse what makes no sense and tell what they hold."""

import math
from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from campaign_samples import campaign, record, series
from vsr2.campaign import (
    Campaign,
    CampaignTrial,
    MeasurementNoise,
    Series,
    Specimen,
    campaign_summary,
    intensity_measures,
)
from vsr2.errors import CampaignError
from vsr2.motion import cosine_motion
from vsr2.motion.recording import Record
from vsr2.report.messages.data import campaign_text

BASE = {"trial": "T1", "motion": "m", "session": "1", "order": 1, "specimen": "rock"}


def trial(**changes):
    return CampaignTrial(**(BASE | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trial": "a/b"}, "is no id"),
        ({"trial": ""}, "is no id"),
        ({"trial": "a\n"}, "is no id"),
        ({"trial": 12}, "trial: 12 is no id, as it is no text; put it in quotes"),
        ({"trial": 12e34}, r"1\.2e\+35 is no id, .* put it in quotes, as it is written"),
        ({"trial": np.int64(7)}, "put it in quotes"),
        ({"trial": date(2020, 1, 1)}, "put it in quotes"),
        ({"motion": ""}, "motion: is blank"),
        ({"motion": " m"}, "outer blanks"),
        ({"session": "a\nb"}, "line breaks"),
        ({"order": -1}, "order: is -1"),
        ({"order": True}, "no whole number"),
        ({"order": 1.5}, "no whole number"),
        ({"overturned": 2}, "not True, False or None"),
        ({"motion_file": "../m"}, "is no id"),
        ({"peak_tilt": 3.2}, "must lie from 0 to 3.14159 rad; check sign and unit"),
        ({"peak_tilt": math.nan}, "is nan"),
        ({"pga_g": -1.0}, "check sign and unit"),
        ({"pgv_pga_s": math.inf}, "is inf"),
        ({"extra": {"peer": 1.0}}, "no name of an extra column"),
        ({"extra": {"x_max_tilt_rad": 0.1}}, "no diagnosis reads anything; call it peak_tilt_rad"),
        ({"extra": {"x_peakTilt_deg": 5.0}}, "no diagnosis reads anything; call it peak_tilt_rad"),
        ({"extra": {"x_tiltmax": 0.1}}, "no diagnosis reads anything; call it peak_tilt_rad"),
        ({"extra": {"x_peer": math.nan}}, "x_peer: is nan"),
        ({"note": "x" * 1001}, "shorten it"),
    ],
)
def test_a_trial_refuses_and_names_the_field(changes, words):
    with pytest.raises(CampaignError, match=words):
        trial(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tilt": None, "position": None, "orientation": None}, "neither tilt nor position"),
        ({"time": np.zeros(20)}, "must increase"),
        ({"time": np.arange(19.0)}, "tilt has 20 rows, time has 19"),
        ({"time": np.arange(20.0) * 1e6}, "beyond 100000 s"),
        ({"tilt": np.full(20, np.nan)}, "tilt is nan"),
        ({"tilt": np.full(20, 57.0)}, "check the unit"),
        ({"tilt": "steep"}, "series: tilt is not an array of numbers"),
        ({"position": np.zeros((20, 2))}, r"wanted is \(20, 3\)"),
        ({"orientation": np.zeros((20, 4))}, "has the norm 0"),
        ({"noise_tilt": -1.0}, "noise_tilt: is -1"),
    ],
)
def test_a_series_refuses_and_names_the_array(changes, words):
    with pytest.raises(CampaignError, match=words):
        replace(series(), **changes)


def test_a_series_is_a_read_only_copy_and_knows_its_interval():
    tilt = np.zeros(20)
    one = replace(series(), tilt=tilt)
    tilt[0] = 1.0
    assert one.tilt[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        one.tilt[0] = 1.0
    assert one.interval == pytest.approx(0.02, rel=1e-12)
    assert Series(time=[0.0, 0.1, 0.3], tilt=[0, 0, 0]).interval is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trials": ()}, "has 0 trials"),
        ({"trials": (trial(), trial(trial="t1", order=2))}, "is there twice"),
        ({"trials": (trial(), trial(trial="T2"))}, "order 1 is both"),
        ({"trials": (trial(specimen="stone"),)}, "unknown specimen 'stone'"),
        ({"trials": (trial(motion_file="gone"),)}, "motion file 'gone'"),
        ({"specimens": {"rock": Specimen(), "a b": Specimen()}}, "is no id"),
        ({"name": ""}, "name: is blank"),
    ],
)
def test_a_campaign_refuses_what_does_not_fit_together(changes, words):
    values = {"name": "c", "trials": (trial(),), "specimens": {"rock": Specimen()}}
    Campaign(**values)
    with pytest.raises(CampaignError, match=words):
        Campaign(**(values | changes))


def test_specimen_and_noise_refuse_bad_numbers():
    with pytest.raises(CampaignError, match="mass: is 0, must lie above 0"):
        Specimen(mass=0.0)
    with pytest.raises(CampaignError, match="tilt: is -1"):
        MeasurementNoise(tilt=-1.0)


def test_the_tier_is_what_all_trials_with_an_outcome_share():
    def of(*trials):
        numbered = tuple(replace(t, trial=f"T{i}", order=i) for i, t in enumerate(trials))
        return Campaign(name="c", trials=numbered, specimens={"rock": Specimen()}).tier

    blank, outcome = trial(peak_tilt=0.1), trial(overturned=True)
    tilted = trial(overturned=False, peak_tilt=0.1)
    complete = trial(overturned=False, series=series())
    assert of(blank) == "B"
    assert of(outcome, complete) == "B"
    assert of(tilted, complete, blank) == "M"
    assert of(complete, replace(complete, peak_tilt=0.2), blank) == "T"


def test_columns_and_selections_keep_the_order_and_drop_unused_motions():
    full = campaign(motions={"pulse": record("pulse"), "spare": record("spare")})
    np.testing.assert_array_equal(full.overturned, [0.0, 1.0, np.nan])
    assert full.motion_ids.tolist() == ["pulse one", "pulse one", "other"]
    order = [3, 9, 5]
    moved = [replace(t, order=o) for t, o in zip(full.trials, order, strict=True)]
    assert replace(full, trials=tuple(moved)).relative_order.tolist() == [0.0, 1.0, 1 / 3]
    assert full.select([True, False, False]).relative_order.tolist() == [0.0]
    assert full.extra_columns == ("x_peer", "x_other")
    np.testing.assert_array_equal(full.extra("x_other"), [-2.5e-7, np.nan, np.nan])
    assert [t.trial for t in full.with_motion().trials] == ["A1", "A2"]
    assert [t.trial for t in full.select(["B", "A1"]).trials] == ["A1", "B"]
    assert set(full.with_motion().motions) == {"pulse"}
    assert full.select([False, False, True]).motions == {}
    assert full.record(full.trials[0]) is full.motions["pulse"]
    assert full.record(full.trials[2]) is None
    with pytest.raises(CampaignError, match="no extra column 'x_no'; there are x_peer"):
        full.extra("x_no")
    with pytest.raises(CampaignError, match="has no trial 'Z'"):
        full.select(["Z"])
    with pytest.raises(CampaignError, match="2 values for 3 trials"):
        full.select([True, False])
    with pytest.raises(CampaignError, match="has 0 trials"):
        full.select([False] * 3)


def test_intensity_is_the_published_one_else_that_of_the_motion():
    # A cosine of 2 Hz within the band-pass: PGV/PGA = 1 / (2 pi F), whatever the amplitude.
    motion = cosine_motion(0.01, 2.0, 0.001)
    rest = np.zeros(4000)
    shaken = Record(
        name="cosine",
        sample_interval=0.001,
        acceleration=np.concatenate([rest, np.tile(motion.acceleration[:-1], 8), rest]),
    )
    full = campaign(motions={"pulse": shaken})
    found = intensity_measures(full)
    assert found.pga_g[0] == 1.25
    assert found.pgv_pga_s[0] == 0.08
    # The band-pass rings at the sharp ends of the shaking, hence not closer.
    assert found.pga_g[1] == pytest.approx(motion.pga_g, rel=0.1)
    assert found.pgv_pga_s[1] == pytest.approx(1 / (4 * np.pi), rel=0.1)
    assert np.isnan(found.pga_g[2])
    assert np.isnan(found.pgv_pga_s[2])


def test_the_summary_counts():
    summary = campaign_summary(campaign())
    assert summary["trials"] == 3
    assert (summary["overturned"], summary["standing"], summary["outcome_unknown"]) == (1, 1, 1)
    assert (summary["ground_motions"], summary["motion_files"], summary["sessions"]) == (2, 1, 2)
    assert summary["with_motion"] == 2
    assert summary["specimens"]["block"] == {"trials": 2, "mass_kg": 120.5, "model_file": None}
    assert summary["tier"] == "B"
    text = campaign_text(summary)
    assert "3: 1 overturned, 1 not, 1 unknown" in text
    assert "rock: 1 trial, mass unknown" in text
