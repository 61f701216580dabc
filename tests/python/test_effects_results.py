"""Effects in what is kept of a batch: plans, journals and shards; null effects in studies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vsr2 import Study, run_batch
from vsr2.config import study_from_mapping
from vsr2.effects import effect, in_order, library
from vsr2.errors import ResultError
from vsr2.results import prepare_folder
from vsr2.simulation import Shard, merge_shards, plan_sha256, run_shard, study_trials
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]
SEVERAL = {
    "edge_rounding": {"radius": 0.006},
    "restitution": {"energy_ratio": 0.8},
    "table_pitch": {"compliance": 0.005},
    "placement": {"yaw": 5.0},
    "outcome_rule": {"flips": 0.03},
}


def study(effects: object, mode: str = "auto") -> Study:
    return study_from_mapping(
        {
            "rock": {"shape": "box", "size": [0.3, 0.5, 1.0], "density": 2700.0},
            "motion": {
                "mode": "grid_cosine",
                "pga_g": {"min": 0.3, "max": 0.6, "step": 0.1},
                "pgv_pga_s": {"min": 0.1, "max": 0.1, "step": 0.1},
            },
            "engine": {"mode": mode},
            "outcome": {"tail": 1.0},
            "output": {"log_every": 1},
            "effects": effects,
        },
        ROOT,
    )


def trials(**changed: object) -> list[Trial]:
    return study_trials(study(SEVERAL | changed))


@pytest.mark.parametrize("mode", ["exact", "fast"])
def test_all_null_effects_at_once_change_no_bit(mode: str) -> None:
    # As a study can write them; effects of which it cannot write a null are off by absence.
    null = {
        own.name: {name: value for name, value in own.null().items() if np.isfinite(value)}
        for own in in_order(library())
    }
    null = {
        name: values
        for name, values in null.items()
        if not all(effect(name).parameter(one).secondary for one in values)
    }
    assert len(null) >= 24
    plain, same = study_trials(study({}, mode)), study_trials(study(null, mode))
    assert plan_sha256(same) == plan_sha256(plain)
    for before, after in zip(
        run_batch(plain, threads=1).logs, run_batch(same, threads=1).logs, strict=True
    ):
        assert before is not None
        assert after is not None
        assert before.state.tobytes() == after.state.tobytes()


def test_a_journal_with_other_effects_is_refused(tmp_path: Path) -> None:
    folder = prepare_folder(tmp_path / "run")
    run_batch(trials(), checkpoint=folder, threads=1)
    # What reaches the scene, the motion, the start, and the label alone.
    for changed in (
        {"edge_rounding": {"radius": 0.007}},
        {"table_pitch": {"compliance": 0.006}},
        {"placement": {"yaw": 5.1}},
        {"outcome_rule": {"tilt": 0.3}},
        {"adhesion": {"strength": 1.0}},
    ):
        with pytest.raises(ResultError, match="other trials"):
            run_batch(trials(**changed), checkpoint=folder)
    with pytest.raises(ResultError, match="other trials"):
        run_batch(study_trials(study({})), checkpoint=folder)


def test_shards_carry_effects(tmp_path: Path) -> None:
    # Many flips: a rule that is applied twice would show.
    with pytest.warns(UserWarning, match="outside the prior"):
        batch = trials(outcome_rule={"flips": 0.6})
    complete = run_batch(batch, threads=1, checkpoint=prepare_folder(tmp_path / "complete"))
    for index in (1, 2):
        run_shard(batch, Shard(index, 2), tmp_path / "parts", threads=1)
    merge_shards(batch, tmp_path / "parts")
    merged = run_batch(batch, threads=1, checkpoint=tmp_path / "parts")
    for name in complete.trials:
        np.testing.assert_array_equal(merged[name], complete[name], err_msg=name)
    assert merged.provenance["effects"] == complete.provenance["effects"]
    assert complete.provenance["effects"]["outcome_rule"][0]["flips"] == 0.6
    with pytest.raises(ResultError, match="other trials"):
        merge_shards(trials(), tmp_path / "parts")
