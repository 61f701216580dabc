"""Simulated campaigns: the form of measured ones, repeatable, with the noise that was asked for."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from campaign_samples import assert_equal
from vsr2.campaign import (
    MeasurementNoise,
    RunOptions,
    check_campaign,
    load_campaign,
    save_campaign,
    simulate_campaign,
    trial_statuses,
)
from vsr2.campaign.simulate import _FileNames
from vsr2.config import study_from_mapping
from vsr2.errors import CampaignError
from vsr2.results import JOURNAL_FILE, Status, prepare_folder
from vsr2.scene.rotation import rotate
from vsr2.simulation import run_batch, study_trials

BLOCK = {
    "name": "block",
    "rock": {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0},
    "motion": {
        "mode": "grid_cosine",
        "pga_g": {"min": 0.2, "max": 0.8, "step": 0.3},
        "pgv_pga_s": {"min": 0.08, "max": 0.16, "step": 0.08},
        "drive": "prescribed",
    },
}


@pytest.fixture(scope="module")
def study():
    return study_from_mapping(BLOCK, base=".")


@pytest.fixture(scope="module")
def plain(study):
    return simulate_campaign(study, series_every=10, sessions=4, run=RunOptions(threads=1))


def test_outcomes_are_those_of_the_batch(study, plain):
    result = run_batch(study, threads=1)
    assert set(plain.overturned) == {0.0, 1.0}
    np.testing.assert_array_equal(plain.overturned, result["outcome"] == "overturned")
    np.testing.assert_array_equal([t.peak_tilt for t in plain.trials], result["peak_tilt"])
    assert [t.motion for t in plain.trials] == list(result["motion"])
    assert [t.order for t in plain.trials] == [1, 2, 3, 4, 5, 6]
    assert [t.session for t in plain.trials] == ["1", "1", "1", "1", "2", "2"]
    assert plain.tier == "T"
    assert plain.specimens["rock"].mass == pytest.approx(0.25 * 0.5 * 1.0 * 2700)
    for trial, log in zip(plain.trials, result.logs, strict=True):
        np.testing.assert_array_equal(trial.series.time, log.time[log.time >= 0])
        np.testing.assert_array_equal(trial.series.tilt, log.tilt[log.time >= 0])


def test_series_tell_pose_from_the_rest_before(plain):
    for trial in plain.trials:
        one = trial.series
        assert np.abs(one.position[0]).max() < 1e-4
        np.testing.assert_allclose(one.orientation[0, 3], 1.0, atol=1e-6)
        # The tilt is the angle that the rotation gives the vertical: one fact in two channels. An
        # arc cosine loses half the digits near 0.
        up = rotate(one.orientation, np.tile([0.0, 0.0, 1.0], (len(one.time), 1)))
        np.testing.assert_allclose(np.arccos(np.clip(up[:, 2], -1, 1)), one.tilt, atol=1e-6)


def test_the_motion_is_what_was_driven(study, plain):
    for trial, driven in zip(plain.trials, study_trials(study), strict=True):
        record = plain.record(trial)
        assert record.sample_interval == driven.motion.time_step
        np.testing.assert_array_equal(record.displacement, driven.motion.displacement)
        np.testing.assert_array_equal(record.acceleration, driven.motion.acceleration)
        assert trial.pga_g == driven.motion.pga_g
        assert trial.pgv_pga_s == driven.motion.pgv_pga_s


def test_it_survives_its_files(plain, tmp_path):
    save_campaign(plain, tmp_path / "c")
    assert check_campaign(tmp_path / "c") == []
    assert_equal(plain, load_campaign(tmp_path / "c"))


def test_noise_has_its_standard_error_and_leaves_the_outcome_alone(study, plain):
    noise = MeasurementNoise(
        displacement=1e-4,
        acceleration=0.05,
        peak_tilt=0.01,
        tilt=0.002,
        position=3e-4,
        orientation=0.004,
    )
    noisy = simulate_campaign(
        study, series_every=10, noise=noise, seed=5, run=RunOptions(threads=1)
    )
    np.testing.assert_array_equal(noisy.overturned, plain.overturned)
    assert noisy.noise == noise

    def spread(values, expected):
        values = np.concatenate([np.ravel(value) for value in values])
        # Four standard errors of a standard deviation, 1 / sqrt(2 n) of itself.
        assert values.std() == pytest.approx(expected, rel=4 / np.sqrt(2 * values.size))
        assert abs(values.mean()) < 5 * expected / np.sqrt(values.size)

    pairs = list(zip(noisy.trials, plain.trials, strict=True))
    spread([a.series.tilt - b.series.tilt for a, b in pairs], 0.002)
    spread([a.series.position - b.series.position for a, b in pairs], 3e-4)
    # The small rotation between both: twice the vector part, about each axis.
    turns = []
    for a, b in pairs:
        inverse = b.series.orientation * [-1, -1, -1, 1]
        turns.append(2 * product(a.series.orientation, inverse)[:, :3])
    spread(turns, 0.004)
    records = [(noisy.record(a), plain.record(b)) for a, b in pairs]
    spread([a.displacement - b.displacement for a, b in records], 1e-4)
    spread([a.acceleration - b.acceleration for a, b in records], 0.05)
    assert len(noisy.motions) == len(noisy)
    differences = [abs(a.peak_tilt - b.peak_tilt) for a, b in pairs]
    assert 0 < max(differences) < 0.05
    assert all(0 <= t.peak_tilt <= np.pi for t in noisy.trials)
    assert all(t.series.noise_tilt == 0.002 for t in noisy.trials)


def product(p, q):
    """Hamilton product of quaternions x, y, z, w, written out."""
    (x, y, z, w), (a, b, c, d) = p.T, q.T
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=1,
    )


def test_seeds_decide_the_noise_and_trials_do_not_share_it(study):
    noise = MeasurementNoise(displacement=1e-4)
    one = simulate_campaign(study, noise=noise, seed=5, run=RunOptions(threads=1))
    again = simulate_campaign(study, noise=noise, seed=5, run=RunOptions(threads=1))
    other = simulate_campaign(study, noise=noise, seed=6, run=RunOptions(threads=1))
    assert_equal(replace(one, provenance={}), replace(again, provenance={}))
    errors = {}
    for label, campaign in (("one", one), ("other", other)):
        for trial, driven in zip(campaign.trials, study_trials(study), strict=True):
            error = campaign.record(trial).displacement - driven.motion.displacement
            errors[label, trial.trial] = tuple(error[:50])
    assert len(set(errors.values())) == len(errors)


def test_a_campaign_that_is_made_is_given_back(study, tmp_path):
    arguments = {
        "study": study,
        "series_every": 20,
        "noise": MeasurementNoise(tilt=0.001, peak_tilt=0.001, displacement=1e-5),
    }
    complete = simulate_campaign(**arguments, run=RunOptions(threads=1))
    assert set(trial_statuses(complete).values()) == {Status.ok}
    save_campaign(complete, tmp_path / "c")
    made = load_campaign(tmp_path / "c")
    assert simulate_campaign(**arguments, run=RunOptions(threads=1, made=made)) is made
    with pytest.raises(CampaignError, match="from another study, seed or noise"):
        simulate_campaign(**arguments, seed=1, run=RunOptions(made=made))


def test_a_campaign_of_an_older_form_does_not_say_how_its_trials_ended(plain):
    old = {key: value for key, value in plain.provenance.items() if key != "statuses"}
    with pytest.raises(CampaignError, match="does not say how its trials ended; simulate it again"):
        trial_statuses(replace(plain, provenance=old))


def test_a_checkpoint_gives_the_same_campaign_wherever_it_was_cut(study, tmp_path):
    arguments = {
        "study": study,
        "series_every": 20,
        "noise": MeasurementNoise(tilt=0.001, peak_tilt=0.001),
    }
    complete = simulate_campaign(**arguments, run=RunOptions(threads=1))
    folder = prepare_folder(tmp_path / "complete")
    kept = simulate_campaign(**arguments, run=RunOptions(threads=1, checkpoint=folder))
    assert_equal(replace(complete, provenance={}), replace(kept, provenance={}))
    lines = (folder / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    for finished in (0, 3, 6):
        (folder / JOURNAL_FILE).write_bytes(b"".join(lines[: finished + 1]))
        again = simulate_campaign(**arguments, run=RunOptions(threads=1, checkpoint=folder))
        assert_equal(replace(complete, provenance={}), replace(again, provenance={}))


def test_trials_of_ones_own_with_ids(study):
    trials = study_trials(study)[:2]
    made = simulate_campaign(
        [trials[0], replace(trials[1], motion=trials[0].motion.scaled(2.0))],
        motion_ids=["pulse", "pulse"],
        run=RunOptions(threads=1),
    )
    assert made.name == "simulated"
    assert made.motion_ids.tolist() == ["pulse", "pulse"]
    assert len(made.motions) == 2
    assert made.trials[1].pga_g == pytest.approx(2 * made.trials[0].pga_g)
    one_motion = simulate_campaign(
        [trials[0]] * 2, motion_ids=["a", "b"], run=RunOptions(threads=1)
    )
    assert len(one_motion.motions) == 1
    assert one_motion.motion_ids.tolist() == ["a", "b"]
    with pytest.raises(CampaignError, match="motion_ids has 1 entries for 2 trials"):
        simulate_campaign(trials, motion_ids=["a"])
    for size in (0, 1.5, True, "1"):
        with pytest.raises(CampaignError, match=r"trials of a session: .*give a whole number, 1"):
            simulate_campaign(trials, sessions=size)
    for step in (-1, 1.5, "a", None):
        with pytest.raises(CampaignError, match=r"series_every: .*give a whole number, 0"):
            simulate_campaign(trials, series_every=step)
    counted = simulate_campaign(
        trials, sessions=np.int64(1), series_every=np.int64(20), run=RunOptions(threads=1)
    )
    assert [trial.session for trial in counted.trials] == ["1", "2"]
    with pytest.raises(CampaignError, match="no trials"):
        simulate_campaign([])


def test_a_failed_trial_has_no_outcome_and_says_why(study):
    # At rest only when slower than any rounding lets it be, which it cannot become in time.
    settling = {"linear_speed": 1e-300, "angular_speed": 1e-300, "window": 0.01, "timeout": 0.02}
    broken = study.model_copy(update={"settling": study.settling.model_copy(update=settling)})
    made = simulate_campaign(broken, series_every=10, run=RunOptions(threads=1))
    assert {t.note for t in made.trials} == {"settling_timeout"}
    assert set(trial_statuses(made).values()) == {Status.settling_timeout}
    assert np.isnan(made.overturned).all()
    assert all(t.peak_tilt is None and t.series is None for t in made.trials)


class CountedSet(set[str]):
    """A set that counts how often it is asked."""

    asked = 0

    def __contains__(self, value: object) -> bool:
        self.asked += 1
        return super().__contains__(value)

    def __iter__(self) -> Iterator[str]:
        self.asked += len(self)
        return super().__iter__()


def test_names_of_motion_files_take_a_constant_number_of_looks_each() -> None:
    names = _FileNames()
    names.taken = counted = CountedSet()
    given = [names.free(name) for name in ["a b", "A_b", "a_b-2", "", "a:b", *["pulse"] * 2000]]
    assert given[:6] == ["a_b", "A_b-2", "a_b-2-2", "motion", "a_b-3", "pulse"]
    assert given[-1] == "pulse-2000"
    assert len({name.lower() for name in given}) == len(given)
    assert counted.asked <= 3 * len(given)
