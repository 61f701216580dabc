"""Campaigns written to their folder: they come back equal."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaign_samples import assert_equal, campaign, record
from vsr2.campaign import (
    Campaign,
    CampaignTrial,
    MeasurementNoise,
    Series,
    Specimen,
    load_campaign,
    save_campaign,
)
from vsr2.errors import CampaignError


def test_a_campaign_comes_back_equal(tmp_path):
    model = tmp_path / "stone.OBJ"
    model.write_text("v 0 0 0\n")
    specimens = {"block": Specimen("granite", 120.5, model), "rock": Specimen()}
    one = campaign(specimens=specimens)
    save_campaign(one, tmp_path / "a")
    read = load_campaign(tmp_path / "a")
    assert_equal(one, read)
    assert read.specimens["block"].model_file == tmp_path / "a" / "models" / "block.obj"
    # Again, from what was read: the form has no detail that a round trip loses.
    save_campaign(read, tmp_path / "b")
    for name in ("campaign.yaml", "trials.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert_equal(read, load_campaign(tmp_path / "b"))


TEXT = st.text(max_size=30).map(
    lambda text: "".join(c for c in text if c.isprintable()).strip() or "1e7"
)


@settings(max_examples=40, deadline=None)
@given(
    name=TEXT,
    motion=TEXT,
    session=TEXT,
    note=st.just("") | TEXT,
    pga_g=st.none() | st.floats(0, 1e5),
    extra=st.floats(allow_nan=False, allow_infinity=False),
    provenance=st.dictionaries(
        TEXT | st.just("<<"),
        st.none() | st.booleans() | st.integers(-(10**18), 10**18) | TEXT,
        max_size=4,
    ),
)
def test_any_text_and_number_survives_the_files(
    tmp_path_factory, name, motion, session, note, pga_g, extra, provenance
):
    trial = CampaignTrial(
        trial="T",
        motion=motion,
        session=session,
        order=0,
        specimen="s",
        note=note,
        pga_g=pga_g,
        extra={"x_a": extra},
    )
    one = Campaign(
        name=name,
        trials=(trial,),
        specimens={"s": Specimen()},
        description=note,
        provenance=provenance,
    )
    folder = tmp_path_factory.mktemp("campaign") / "c"
    save_campaign(one, folder)
    read = load_campaign(folder)
    # A description is prose in YAML, where runs of blanks mean one.
    assert read.description == " ".join(note.split())
    assert_equal(one.__class__(**{**vars(one), "description": read.description}), read)


def test_saving_refuses_other_folders_and_replaces_only_on_request(tmp_path):
    one = campaign()
    target = tmp_path / "c"
    target.mkdir()
    save_campaign(one, target)
    with pytest.raises(CampaignError, match="already holds a campaign"):
        save_campaign(one, target)
    smaller = one.select(["B"])
    save_campaign(smaller, target, overwrite=True)
    assert_equal(smaller, load_campaign(target))
    assert not (target / "motions").exists()
    (target / "thesis.tex").write_text("x")
    with pytest.raises(CampaignError, match=r"holds 'thesis\.tex', which is no part"):
        save_campaign(one, target, overwrite=True)
    (tmp_path / "file").write_text("x")
    with pytest.raises(CampaignError, match="is no folder"):
        save_campaign(one, tmp_path / "file", overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "file"]


def test_a_save_that_fails_leaves_what_was_there(tmp_path):
    target = tmp_path / "c"
    save_campaign(campaign(), target)
    broken = campaign(
        specimens={"block": Specimen("x", 1.0, tmp_path / "gone.obj"), "rock": Specimen()}
    )
    with pytest.raises(CampaignError, match=r"gone\.obj is no file of the kinds"):
        save_campaign(broken, target, overwrite=True)
    with pytest.raises(CampaignError, match="provenance cannot be written"):
        save_campaign(campaign(provenance={"a": object()}), target, overwrite=True)
    assert_equal(campaign(), load_campaign(target))
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_a_motion_of_acceleration_alone_comes_back_without_displacement(tmp_path):
    complete = record("pulse")
    alone = complete.__class__(
        name="pulse", sample_interval=complete.sample_interval, acceleration=complete.acceleration
    )
    save_campaign(campaign(motions={"pulse": alone}), tmp_path / "c")
    read = load_campaign(tmp_path / "c").motions["pulse"]
    assert read.displacement is None
    np.testing.assert_array_equal(read.acceleration, complete.acceleration)


def test_yaw_and_slip_are_channels_of_a_series(tmp_path):
    time = np.arange(5) * 0.1
    series = Series(time, yaw=0.1 * time, slip=-0.01 * time, noise_yaw=0.002, noise_slip=0.001)
    trial = replace(campaign().trials[0], series=series, final_yaw=-0.1, final_slip=0.02)
    noise = MeasurementNoise(peak_tilt_relative=0.02, yaw=0.001, slip=0.002)
    written = campaign(trials=(trial,), noise=noise)
    save_campaign(written, tmp_path / "c")
    read = load_campaign(tmp_path / "c")
    assert read.noise == noise
    assert (read.trials[0].final_yaw, read.trials[0].final_slip) == (-0.1, 0.02)
    np.testing.assert_array_equal(read.trials[0].series.slip, series.slip)
    np.testing.assert_array_equal(read.trials[0].series.yaw, series.yaw)
    assert (read.trials[0].series.noise_yaw, read.trials[0].series.noise_slip) == (0.002, 0.001)
