"""The file of evaluations: nothing finished is lost, nothing foreign is taken."""

from __future__ import annotations

import numpy as np
import pytest

from vsr2.calibration import Evaluation, EvaluationStore, prepare_calibration_folder
from vsr2.errors import ResultError


def evaluation(p: float = 0.1, plan: str = "plan") -> Evaluation:
    return Evaluation({"p": p, "word": "a"}, np.array([1.0, 0.0, np.nan]), plan, 1.5)


def test_what_was_stored_is_found_again(tmp_path):
    with EvaluationStore(tmp_path, "c", 3) as store:
        store.add("k1", evaluation(1 / 3))
        store.add("k2", evaluation(2.0, "other"))
    with EvaluationStore(tmp_path, "c", 3) as store:
        assert len(store) == 2
        found = store.by_key("k1")
        assert found.values == {"p": 1 / 3, "word": "a"}
        np.testing.assert_array_equal(found.predicted, [1.0, 0.0, np.nan])
        assert found.failed == 1
        assert store.by_plan("other").values["p"] == 2.0
        assert store.by_key("k3") is None


def test_a_torn_last_line_is_dropped_and_a_damaged_one_is_not(tmp_path):
    with EvaluationStore(tmp_path, "c", 3) as store:
        store.add("k1", evaluation())
    path = tmp_path / "evaluations.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"key":"k2","plan":"x","val')
    with EvaluationStore(tmp_path, "c", 3) as store:
        assert len(store) == 1
        store.add("k2", evaluation())
    assert path.read_bytes().startswith(whole)
    with EvaluationStore(tmp_path, "c", 3) as store:
        assert len(store) == 2
    path.write_bytes(whole + whole.splitlines()[1].replace(b"10x", b"1?x") + b"\n")
    with pytest.raises(ResultError, match=r"evaluations.jsonl:3: damaged"):
        EvaluationStore(tmp_path, "c", 3)


def test_another_campaign_or_process_is_refused(tmp_path):
    with EvaluationStore(tmp_path, "c", 3), pytest.raises(ResultError, match="another process"):
        EvaluationStore(tmp_path, "c", 3)
    with pytest.raises(ResultError, match="another campaign"):
        EvaluationStore(tmp_path, "d", 3)
    with pytest.raises(ResultError, match="another campaign"):
        EvaluationStore(tmp_path, "c", 4)


def test_a_folder_with_a_calibration_is_not_overwritten_unasked(tmp_path):
    folder = prepare_calibration_folder(tmp_path / "new" / "one")
    with EvaluationStore(folder, "c", 3) as store:
        store.add("k", evaluation())
    with pytest.raises(ResultError, match="already holds a calibration"):
        prepare_calibration_folder(folder)
    prepare_calibration_folder(folder, resume=True)
    assert (folder / "evaluations.jsonl").exists()
    (folder / "mine.txt").write_text("kept")
    prepare_calibration_folder(folder, overwrite=True)
    assert [file.name for file in folder.iterdir()] == ["mine.txt"]
