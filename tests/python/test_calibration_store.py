"""The file of evaluations: nothing finished is lost, nothing foreign is taken."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from vsr2.calibration import Evaluation, EvaluationStore, prepare_calibration_folder
from vsr2.calibration.evaluation import _noises
from vsr2.errors import MotionError, ResultError
from vsr2.motion import Record, build_recorded_motion, channel_noise


def evaluation(p: float = 0.1, plan: str = "plan") -> Evaluation:
    return Evaluation({"p": p, "word": "a"}, np.array([1.0, 0.0, np.nan]), plan, 1.5)


def test_what_was_stored_is_found_again(tmp_path):
    with EvaluationStore(tmp_path, "c", 3) as store:
        store.keep("k1", evaluation(1 / 3))
        store.keep("k2", evaluation(2.0, "other"))
    with EvaluationStore(tmp_path, "c", 3) as store:
        assert len(store) == 2
        found = store.by_key("k1")
        assert found.values == {"p": 1 / 3, "word": "a"}
        np.testing.assert_array_equal(found.predicted, [1.0, 0.0, np.nan])
        assert found.failed == 1
        assert store.by_plan("other").values["p"] == 2.0
        assert store.by_key("k3") is None


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("[1, 2]", "is no record"),
        ("7" * 5000, "is no JSON of VSR2"),
        ("[" * 100_000, "is no JSON of VSR2"),
        ("{}", "key is missing"),
    ],
)
def test_a_damaged_line_is_reported_without_words_of_the_language(line, said, tmp_path):
    with EvaluationStore(tmp_path, "c", 3) as store:
        store.keep("k1", evaluation())
    file = tmp_path / "evaluations.jsonl"
    file.write_text(f"{file.read_text()}{line}\n")
    with pytest.raises(ResultError, match=rf":3: damaged \({said}\)"):
        EvaluationStore(tmp_path, "c", 3)


@pytest.mark.parametrize("inner", ["running", "running/0123", "figures"])
def test_overwriting_a_calibration_follows_no_link(inner, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    kept = elsewhere / "0123" / "journal.jsonl"
    kept.parent.mkdir(parents=True)
    kept.write_text("not ours")
    folder = prepare_calibration_folder(tmp_path / "out")
    (folder / inner).parent.mkdir(exist_ok=True)
    (folder / inner).symlink_to(kept.parent if "/" in inner else elsewhere)
    with pytest.raises(ResultError, match="is a link, through which no result"):
        prepare_calibration_folder(folder, overwrite=True)
    assert kept.read_text() == "not ours"


def test_a_folder_with_a_calibration_is_not_overwritten_unasked(tmp_path):
    folder = prepare_calibration_folder(tmp_path / "new" / "one")
    with EvaluationStore(folder, "c", 3) as store:
        store.keep("k", evaluation())
    with pytest.raises(ResultError, match="already holds a calibration"):
        prepare_calibration_folder(folder)
    prepare_calibration_folder(folder, resume=True)
    assert (folder / "evaluations.jsonl").exists()
    (folder / "mine.txt").write_text("kept")
    prepare_calibration_folder(folder, overwrite=True)
    assert [file.name for file in folder.iterdir()] == ["mine.txt"]


def noisy_record(name: str, *, rest: bool) -> Record:
    """Both channels of a pulse with white noise; without rest the channels never rest together."""
    rng = np.random.default_rng(len(name))
    time = np.arange(4000) * 0.002
    quiet = np.exp(-((time - 4.0) ** 2))
    loud = 0.05 * np.sin(2 * np.pi * 2.0 * time)
    displacement = 0.05 * quiet + 1e-4 * rng.standard_normal(time.size)
    acceleration = quiet + 0.05 * rng.standard_normal(time.size)
    if not rest:
        # One channel shakes while the other rests, and the other way round.
        displacement += loud * (time < 4.0)
        acceleration += 20.0 * loud * (time >= 4.0)
    return Record(name, 0.002, displacement=displacement, acceleration=acceleration)


def test_a_record_without_rest_has_the_others_noise():
    records = {name: noisy_record(name, rest=True) for name in ("a", "bb", "ccc")}
    shaken = noisy_record("dddd", rest=False)
    with pytest.raises(MotionError, match="both channels rest"):
        channel_noise(shaken)
    found = _noises(SimpleNamespace(motions={**records, "dddd": shaken}))
    deviations = sorted(found[name].displacement.deviation for name in records)
    assert found["dddd"].displacement.deviation == deviations[1]
    motion = build_recorded_motion(shaken, 0.001, channel="fused", noise=found["dddd"])
    assert "fused" in motion.source
    with pytest.raises(MotionError, match="noise has no effect on the displacement channel"):
        build_recorded_motion(shaken, 0.001, channel="displacement", noise=found["dddd"])
    with pytest.raises(MotionError, match="both channels rest"):
        _noises(SimpleNamespace(motions={"dddd": shaken}))


def test_trials_simulated_later_are_added_to_their_set(tmp_path):
    known = np.array([True, False, True])
    first = Evaluation({"p": 1.0}, np.array([1.0, np.nan, np.nan]), "plan", 2.0, known)
    with EvaluationStore(tmp_path, "c", 3) as store:
        store.keep("key", first)
        found = store.by_key("key")
        assert found is not None
        assert found.lacking(np.ones(3, dtype=bool)).tolist() == [False, True, False]
        store.keep("other key", Evaluation({"p": 1.0}, np.array([np.nan, 0.0, np.nan]), "plan", 1.0,
                                          ~known))  # fmt: skip
    with EvaluationStore(tmp_path, "c", 3) as store:
        for key in ("key", "other key"):
            found = store.by_key(key)
            np.testing.assert_array_equal(found.predicted, [1.0, 0.0, np.nan])
            assert not found.lacking(np.ones(3, dtype=bool)).any()
            assert found.seconds == 3.0
            assert found.failed == 1
