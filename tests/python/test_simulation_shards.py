"""Shards of a study: cut, run apart, merged."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from distributed_samples import STUDY, assert_same
from vsr2.cli.main import main
from vsr2.config.study import Output, Study
from vsr2.errors import ResultError, SimulationError
from vsr2.results import JOURNAL_FILE, load_result, prepare_folder
from vsr2.simulation import (
    Shard,
    merge_shards,
    run_shard,
    study_trials,
)
from vsr2.simulation.distributed import CLUSTER, _chunks
from vsr2.trial import Trial


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return study_trials(Study.model_validate(yaml.safe_load(STUDY)))


def test_chunks_hold_every_trial_once_and_are_bounded(trials: list[Trial]) -> None:
    heavy = [
        replace(t, output=Output(log_every=1, contacts_every=every))
        for t in trials
        for every in (0, 1)
    ]
    for threads in (0, 1, 7, 1000):
        for batch in (trials, heavy, trials * 20):
            chunks = list(_chunks(batch, threads))
            assert [i for chunk in chunks for i in chunk] == list(range(len(batch)))
            assert max(map(len, chunks)) <= max(1, -(-len(batch) // (4 * max(1, threads))))
            for chunk in chunks:
                size = sum(_log_size(batch[i]) for i in chunk)
                assert size <= CLUSTER.chunk_bytes or len(chunk) == 1


def _log_size(trial: Trial) -> int:
    rows = trial.motion.displacement.size
    contacts = trial.output.contacts_every
    return rows // trial.output.log_every * 144 + (rows // contacts * 4 * 160 if contacts else 0)


def shard_command(folder: Path, *more: str) -> list[str]:
    return ["run", str(folder / "study.yaml"), "--out", str(folder / "out"), "--quiet", *more]


@pytest.fixture
def sharded(tmp_path: Path) -> Path:
    """A folder with all three shards of a study run from the command line."""
    (tmp_path / "study.yaml").write_text(STUDY.replace("exact", "auto"))
    for index in (3, 1, 2):
        assert main(shard_command(tmp_path, "--shard", f"{index}/3")) == 0
    return tmp_path


def test_merged_shards_equal_the_complete_result(sharded: Path, tmp_path: Path) -> None:
    assert main(shard_command(sharded, "--merge")) == 0
    complete = tmp_path / "complete"
    shutil.copy(sharded / "study.yaml", prepare_folder(complete))
    assert main(shard_command(complete)) == 0
    assert (sharded / "out/trials.csv").read_bytes() == (complete / "out/trials.csv").read_bytes()
    merged = load_result(sharded / "out")
    assert_same(load_result(complete / "out"), merged)
    assert merged.provenance["study"] == load_result(complete / "out").provenance["study"]
    assert [facts["shard"] for facts in merged.provenance["shards"]] == ["1/3", "2/3", "3/3"]
    assert merged.provenance["shards"][0]["processor"] == merged.provenance["processor"]
    # Done again, there is nothing to do; the shards are still there to replace the result.
    assert main(shard_command(sharded, "--merge")) == 0
    assert main(shard_command(sharded, "--merge", "--overwrite")) == 0
    assert_same(load_result(complete / "out"), load_result(sharded / "out"))


def test_missing_shards_and_trials_are_named(
    sharded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shards = sharded / "out" / "shards"
    shutil.rmtree(shards / "2-of-3")
    journal = shards / "3-of-3" / JOURNAL_FILE
    lines = journal.read_bytes().splitlines(keepends=True)
    last = json.loads(lines[-1])["trial"]
    journal.write_bytes(b"".join(lines[:-1]) + lines[-1][:-9])
    assert main(shard_command(sharded, "--merge")) == 2
    error = capsys.readouterr().err
    assert "2/3 was not run" in error
    assert f"3/3 lacks trial {2 + 3 * last}" in error
    assert "1/3" not in error
    assert not (sharded / "out" / "trials.csv").exists()
    assert main(shard_command(sharded, "--shard", "3/3")) == 2
    assert "already holds" in capsys.readouterr().err
    for index in (1, 2, 3):
        assert main(shard_command(sharded, "--shard", f"{index}/3", "--resume")) == 0
    assert main(shard_command(sharded, "--merge")) == 0


def test_an_interrupted_merge_goes_on(sharded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0

    def stop(*arguments: object) -> bool:
        nonlocal count
        count += 1
        if count == 12:
            raise ResultError("the disk is full")
        return real(*arguments)

    import vsr2.simulation.shards as module

    real: Any = module.adopt_trial_log
    monkeypatch.setattr(module, "adopt_trial_log", stop)
    assert main(shard_command(sharded, "--merge")) == 2
    assert main(shard_command(sharded, "--merge")) == 0
    assert count == 33 + 1
    assert set(load_result(sharded / "out")["status"]) == {"ok"}


def test_logs_are_copied_where_they_cannot_be_linked(
    trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    few = [replace(trial, output=Output(log_every=10, npy=True)) for trial in trials[:2]]
    for index in (1, 2):
        run_shard(few, Shard(index, 2), tmp_path)
    monkeypatch.setattr(os, "link", refuse)
    merge_shards(few, tmp_path)
    for kind in ("logs/000000.npz", "npy/000000.npy"):
        merged, origin = tmp_path / kind.replace("0.", "1."), tmp_path / "shards/2-of-2" / kind
        assert merged.read_bytes() == origin.read_bytes()
        assert merged.stat().st_ino != origin.stat().st_ino


def test_shards_that_do_not_belong_are_refused(trials: list[Trial], tmp_path: Path) -> None:
    few = [replace(trial, output=Output(log_every=10)) for trial in trials[:3]]
    for index in (1, 2):
        run_shard(few, Shard(index, 2), tmp_path)
    other = [replace(trial, seed=trial.seed + 1) for trial in few]
    with pytest.raises(ResultError, match="other trials"):
        merge_shards(other, tmp_path)
    (tmp_path / "shards/2-of-2/logs/000000.npz").unlink()
    with pytest.raises(ResultError, match="log of trial 1 is gone"):
        merge_shards(few, tmp_path)
    run_shard(few, Shard(2, 3), tmp_path)
    with pytest.raises(ResultError, match="of 2 and of 3"):
        merge_shards(few, tmp_path)
    with pytest.raises(ResultError, match="holds no shards"):
        merge_shards(few, tmp_path / "elsewhere")
    with pytest.raises(SimulationError, match="at most 3 shards"):
        run_shard(few, Shard(1, 4), tmp_path)


@pytest.mark.parametrize("text", ["0/3", "4/3", "1/0", "1", "a/b", "1/3/5", "-1/3", "1/3 "])
def test_a_shard_is_one_of_n(text: str) -> None:
    with pytest.raises(SimulationError, match="shard"):
        Shard.parse(text)
    assert Shard.parse("3/8") == Shard(3, 8)
