"""Import of the published laboratory campaign: from a made-up folder of its form, and the data."""

import csv
import datetime
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from campaign_samples import assert_equal
from vsr2.analysis.baseline import Fitted, baseline_scores, peer_columns
from vsr2.campaign import check_campaign, import_lab, intensity_measures, load_campaign
from vsr2.errors import CampaignError, MotionError
from vsr2.motion import STANDARD_GRAVITY

ROOT = Path(__file__).parents[2]
FOLDER = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))

needs_data = pytest.mark.skipif(
    not (FOLDER / "trials.csv").is_file(),
    reason=f"no laboratory data in {FOLDER}; set VSR2_LAB_DATA to their folder",
)

ROWS = [
    "test,sp1_overturned,dem_a,pga_g,pgv_pga_s,date,motion,has_motion",
    "11,0,1,0.5,0.0162,20210621,RSN43,True",
    "14,1,0,0.75,0.05,20210621,RSN16,True",
    "120,1,,0.9,0.06,20210622,RSN43,False",
]
VOLT = 1e4 * np.sin(np.arange(40.0))
G = 0.1 * np.cos(np.arange(40.0))


@pytest.fixture
def source(tmp_path):
    """A packed motion, a raw one, and a trial without."""
    folder = tmp_path / "lab"
    (folder / "motions").mkdir(parents=True)
    (folder / "trials.csv").write_text("\n".join(ROWS) + "\n")
    np.savez(
        folder / "motions" / "Test011.npz",
        sample_interval_s=0.00125,
        acceleration_g=G,
        displacement_volt=VOLT,
    )
    lines = ["\t".join(["Time [s] - Plot 0", "Amplitude - Plot 0"] * 4)]
    for i, (volt, g) in enumerate(zip(VOLT, G, strict=True)):
        t = f"{i * 0.00125:.9g}"
        lines.append("\t".join([t, f"{g:.9g}", t, "0", t, f"{volt:.9g}", t, "0"]))
    (folder / "Test014.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_sessions_order_units_and_peers(source, tmp_path):
    made = import_lab(source, tmp_path / "c")
    assert check_campaign(tmp_path / "c") == []
    assert_equal(made, load_campaign(tmp_path / "c"))
    first, second, third = made.trials
    assert [t.trial for t in made.trials] == ["Test011", "Test014", "Test120"]
    assert [t.order for t in made.trials] == [11, 14, 120]
    assert [t.session for t in made.trials] == ["2021-06-21", "2021-06-21", "2021-06-22"]
    assert third.date == datetime.date(2021, 6, 22)
    assert [t.overturned for t in made.trials] == [False, True, True]
    assert first.motion == third.motion == "RSN43"
    assert third.motion_file is None
    assert first.pga_g == 0.5
    assert dict(second.extra) == {"x_dem_a": 0.0}
    assert dict(third.extra) == {}
    assert made.extra_columns == ("x_dem_a",)
    assert len(made.with_motion()) == 2
    for trial in made.with_motion().trials:
        record = made.record(trial)
        assert record.sample_interval == pytest.approx(0.00125, rel=1e-12)
        # The lab's conversion, and its accelerometer that points the other way.
        np.testing.assert_allclose(record.displacement, VOLT * 5.9797e-4 * 0.0254, rtol=1e-8)
        np.testing.assert_allclose(record.acceleration, -G * STANDARD_GRAVITY, rtol=1e-8)


def test_the_other_specimen_has_the_tables_motions_and_its_own_columns(source, tmp_path):
    rows = [ROWS[0] + ",dem_s1_kn1,dem_s2_kn1", *(f"{row},1,0" for row in ROWS[1:])]
    (source / "trials.csv").write_text("\n".join(rows) + "\n")
    kept_aside = import_lab(source, tmp_path / "aside", specimen="SP2")
    assert [t.overturned for t in kept_aside.trials] == [None] * 3
    assert {t.specimen for t in kept_aside.trials} == {"SP2"}
    assert list(kept_aside.with_motion().motions) == ["Test011", "Test014"]
    assert kept_aside.extra_columns == ("x_dem_a", "x_dem_s2_kn1")
    assert import_lab(source, tmp_path / "c").extra_columns == ("x_dem_a", "x_dem_s1_kn1")
    rows = [f"{row},{end}" for row, end in zip(rows, ("sp2_overturned", 1, 0, ""), strict=True)]
    (source / "trials.csv").write_text("\n".join(rows) + "\n")
    known = import_lab(source, tmp_path / "known", specimen="SP2")
    assert [t.overturned for t in known.trials] == [True, False, None]
    with pytest.raises(CampaignError, match="specimen is 'SP3'; give one of SP1, SP2"):
        import_lab(source, tmp_path / "none", specimen="SP3")


@pytest.mark.parametrize(
    ("row", "old", "new", "words"),
    [
        (1, "11,0,1", "11,2,1", "row 2, column sp1_overturned: '2' is not 0, 1 or blank"),
        (1, "11,0,1", "x,0,1", "row 2, column test: 'x' is no test number"),
        (1, "11,0,1", "11,0,a", "row 2, column dem_a: 'a' is no number"),
        (2, "20210621", "2021-6-1", "row 3, column date: '2021-6-1' is no date"),
        (2, "0.75", "-1", "row 3, column pga_g: '-1': is -1, must lie from 0"),
        (2, "RSN16", "", "row 3, column motion: is blank"),
        (3, "120", "14", "'Test014' is there twice"),
        (0, "dem_a", "dem a", "'x_dem a' is no name of an extra column"),
        (0, "date", "day", "column date: is missing; is this the laboratory's table?"),
    ],
)
def test_a_table_that_is_not_the_laboratorys_is_named(source, tmp_path, row, old, new, words):
    rows = list(ROWS)
    rows[row] = rows[row].replace(old, new, 1)
    (source / "trials.csv").write_text("\n".join(rows) + "\n")
    with pytest.raises(CampaignError) as error:
        import_lab(source, tmp_path / "c")
    assert words in str(error.value)
    assert not (tmp_path / "c").exists()


def test_what_is_missing_or_broken_is_named(source, tmp_path):
    with pytest.raises(CampaignError, match=r"trials\.csv: no such file"):
        import_lab(tmp_path, tmp_path / "c")
    (source / "motions" / "Test011.npz").write_bytes(b"PK")
    with pytest.raises(MotionError, match=r"Test011\.npz"):
        import_lab(source, tmp_path / "c")


@needs_data
def test_the_published_campaign_packed_and_raw(tmp_path):
    packed = import_lab(FOLDER, tmp_path / "packed")
    with (FOLDER / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(packed) == len(rows)
    assert len(packed.with_motion()) == sum(row["has_motion"] == "True" for row in rows)
    assert packed.overturned.sum() == sum(row["sp1_overturned"] == "1" for row in rows)
    assert packed.specimens["SP1"].model_file is not None
    assert {f"x_{name}" for name in rows[0] if name.startswith("dem_")} == set(peer_columns(packed))

    raw = tmp_path / "raw"
    shutil.copytree(FOLDER / "raw", raw)
    shutil.copy(FOLDER / "trials.csv", raw)
    unpacked = import_lab(raw, tmp_path / "unpacked").with_motion()
    assert len(unpacked) == len(list((FOLDER / "raw").glob("*.txt")))
    for name, record in unpacked.motions.items():
        other = packed.motions[name]
        # The packed form keeps single precision.
        np.testing.assert_allclose(record.displacement, other.displacement, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(record.acceleration, other.acceleration, rtol=1e-6, atol=1e-9)
        assert record.sample_interval == pytest.approx(other.sample_interval, rel=1e-9)

    # The published PGA is that of the accelerometer after this room's default band-pass.
    some = packed.select([name for name in list(packed.motions)[::20]])
    blank = some.__class__(
        **{
            **vars(some),
            "trials": tuple(
                t.__class__(**{**vars(t), "pga_g": None, "pgv_pga_s": None}) for t in some.trials
            ),
        }
    )
    ratio = intensity_measures(blank).pga_g / intensity_measures(some).pga_g
    assert np.median(ratio) == pytest.approx(1.0, abs=0.005)


@needs_data
def test_the_baselines_to_beat(tmp_path):
    campaign = import_lab(FOLDER, tmp_path / "c")
    scores = {(s.name, s.fitted): s.metrics for s in baseline_scores(campaign, replicates=200)}
    logistic = scores["logistic", "out_of_fold"]
    # On all 582 trials 0.900, 0.887, 0.872 and their mean 0.887 are published; this is a part of
    # them, on which five trials more or less make 0.014 of accuracy.
    assert logistic.trials == len(campaign)
    assert logistic.accuracy == pytest.approx(0.900, abs=0.02)
    assert logistic.precision == pytest.approx(0.887, abs=0.03)
    assert logistic.recall == pytest.approx(0.872, abs=0.03)
    assert logistic.objective == pytest.approx(0.887, abs=0.02)
    # A peer's figures are counts: those of the table itself.
    with (FOLDER / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    peer = scores["x_dem_s1_kn10_ks1", Fitted.GIVEN]
    agree = sum(row["sp1_overturned"] == row["dem_s1_kn10_ks1"] for row in rows)
    assert peer.accuracy == agree / len(rows)
    assert peer.objective == pytest.approx(0.855, abs=0.03)
