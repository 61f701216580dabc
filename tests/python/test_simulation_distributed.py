"""More than one machine: a real Dask scheduler and worker processes over TCP, and shards."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from vsr2 import _native
from vsr2.cli.main import main
from vsr2.config.study import Outcome, Output, Study
from vsr2.effects import apply_effects
from vsr2.errors import ResultError, SimulationError
from vsr2.results import JOURNAL_FILE, BatchResult, load_result, load_trial_log, prepare_folder
from vsr2.scene import build_scene
from vsr2.simulation import (
    Shard,
    connect,
    merge_shards,
    run_batch,
    run_shard,
    study_trials,
)
from vsr2.simulation.distributed import CLUSTER, _chunks
from vsr2.trial import Trial

# Not the fastest engine, so that there is time to interfere.
STUDY = """
name: far
engine: {mode: exact}
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga: {min: 0.1, max: 0.6, step: 0.05}
  pgv_pga: {min: 0.1, max: 0.2, step: 0.05}
output: {log_every: 10, contacts_every: 100, figures: false}
"""
TIMEOUT = 30.0
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return study_trials(Study.model_validate(yaml.safe_load(STUDY)))


@pytest.fixture(scope="module")
def local(trials: list[Trial]) -> BatchResult:
    return run_batch(trials, threads=2)


def assert_same(a: BatchResult, b: BatchResult, *, but: int | None = None) -> None:
    assert len(a) == len(b)
    kept = [i for i in range(len(a)) if i != but]
    for name in a.trials:
        np.testing.assert_array_equal(a[name][kept], b[name][kept], err_msg=name)
    for i in kept:
        left, right = a.logs[i], b.logs[i]
        assert left is not None
        assert right is not None
        for name in ("state", "contacts", "settled_position", "settled_orientation", "foot"):
            assert getattr(left, name).tobytes() == getattr(right, name).tobytes()
        assert left.mass_center.tobytes() == right.mass_center.tobytes()
        assert left.principal_axes.tobytes() == right.principal_axes.tobytes()


class Cluster:
    """A scheduler and workers of one thread each, processes of their own."""

    def __init__(self, folder: Path, workers: int) -> None:
        self._processes: list[subprocess.Popen[bytes]] = []
        self._log = (folder / "log.txt").open("wb")
        file = folder / "scheduler.json"
        self._launch("scheduler", "--host", "tcp://127.0.0.1", "--port", "0",
                     "--scheduler-file", str(file), "--no-dashboard",
                     "--idle-timeout", "60s")  # fmt: skip
        for _ in range(workers):
            self._launch("worker", "--scheduler-file", str(file), "--host", "127.0.0.1",
                         "--nthreads", "1", "--no-dashboard", "--memory-limit", "0",
                         "--local-directory", str(folder), "--death-timeout", "20")  # fmt: skip
        deadline = time.monotonic() + TIMEOUT
        while not file.exists():
            assert time.monotonic() < deadline, (folder / "log.txt").read_text()
            time.sleep(0.02)
        self.file = str(file)

    def _launch(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "dask", *arguments]
        settings = {
            # A worker that fetches from a dead one tries as long as this, 30 s by default.
            "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "2s",
            # It drops copies that no task waits for at the moment, every 2 s; tests count fetches.
            "DASK_DISTRIBUTED__SCHEDULER__ACTIVE_MEMORY_MANAGER__START": "False",
        }
        self._processes.append(
            subprocess.Popen(
                command,
                stdout=self._log,
                stderr=self._log,
                start_new_session=True,
                env=os.environ | settings,
            )
        )

    def kill_scheduler(self) -> None:
        os.killpg(self._processes[0].pid, signal.SIGKILL)

    def close(self) -> None:
        for process in reversed(self._processes):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(timeout=TIMEOUT)
        self._log.close()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed", reason="the extra `parallel` installs Dask distributed")
    running = Cluster(tmp_path_factory.mktemp("cluster"), workers=2)
    yield running
    running.close()


@pytest.fixture(scope="module")
def client(cluster: Cluster) -> Iterator[Any]:
    with connect(cluster.file, timeout=TIMEOUT) as connected:
        connected.wait_for_workers(2, timeout=TIMEOUT)
        yield connected


def processes(client: Any) -> dict[str, int]:
    return dict(client.run(os.getpid))


def test_a_cluster_gives_the_bits_of_this_machine(
    client: Any, trials: list[Trial], local: BatchResult
) -> None:
    arrays = {"state": np.empty((len(trials), 100, 18)), "peak_tilt": np.empty(len(trials))}
    seen: list[int] = []
    result = run_batch(trials, client=client, out=arrays, on_trial=lambda i, log: seen.append(i))
    assert_same(local, result)
    assert sorted(seen) == list(range(len(trials)))
    np.testing.assert_array_equal(arrays["peak_tilt"], local["peak_tilt"])
    np.testing.assert_array_equal(arrays["state"][3], local.log(3).state[:100])
    assert result.provenance["workers"] == 2
    assert result.provenance["processors"] == [result.provenance["processor"]]
    assert result.provenance["scheduler"].startswith("tcp://127.0.0.1:")


def test_a_cluster_carries_effects(client: Any, trials: list[Trial]) -> None:
    changed = apply_effects(
        trials[::8],
        {
            "edge_rounding": {"radius": 0.006}, "restitution": {"energy_ratio": 0.8},
            "table_pitch": {"compliance": 0.005}, "base_slope": {"angle": 1.0},
            "placement": {"yaw": 5.0}, "outcome_rule": {"tilt": 0.1},
        },
    )  # fmt: skip
    here, there = run_batch(changed, threads=1), run_batch(changed, client=client)
    assert_same(here, there)
    assert there.provenance["effects"] == here.provenance["effects"]
    np.testing.assert_array_equal(here["outcome"] == "overturned", here["peak_tilt"] >= 0.1)


def test_a_killed_worker_loses_nothing(
    client: Any, trials: list[Trial], local: BatchResult
) -> None:
    before = processes(client)
    seen: list[int] = []
    lost: list[str] = []

    def kill(i: int, log: object) -> None:
        if not seen:
            busy = [worker for worker, tasks in client.processing().items() if tasks]
            lost.append(busy[0])
            os.kill(before[busy[0]], signal.SIGKILL)
        seen.append(i)

    result = run_batch(trials, client=client, on_trial=kill)
    assert_same(local, result)
    assert sorted(seen) == list(range(len(trials)))
    client.wait_for_workers(2, timeout=TIMEOUT)
    assert not set(lost) & set(processes(client))


class Deadly(Outcome):
    """Ends the process that reads it."""

    def __reduce__(self) -> Any:
        return os._exit, (9,)


def test_a_trial_that_kills_its_workers_loses_no_other(
    client: Any, trials: list[Trial], local: BatchResult
) -> None:
    deadly = list(trials)
    deadly[4] = replace(trials[4], outcome=Deadly())
    # Fewer deaths than usual before Dask gives a task up: each restart takes a while.
    allow_failures(client, 0)
    try:
        result = run_batch(deadly, client=client)
    finally:
        allow_failures(client, 3)
    assert_same(local, result, but=4)
    assert result["status"][4] == "error"
    assert result["outcome"][4] == "failed"
    assert "died" in result["message"][4]
    client.wait_for_workers(2, timeout=TIMEOUT)


def allow_failures(client: Any, count: int) -> None:
    def allow(dask_scheduler: Any = None) -> None:
        dask_scheduler.allowed_failures = count

    client.run_on_scheduler(allow)


def test_meshes_and_motions_travel_once(
    client: Any, trials: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Motions that no worker has seen, and twins of them, for which identity does not do.
    motions = [trial.motion.scaled(1.01) for trial in trials[:4]]
    twins = [motion.scaled(1.0, name=f"twin {i}") for i, motion in enumerate(motions)]
    scan = {"shape": "mesh", "file": str(ROOT / "models/pbr_scan.obj"), "density": 2650.0}
    scene = build_scene(Study.model_validate(yaml.safe_load(STUDY) | {"rock": scan}))
    light = replace(trials[0], scene=scene, output=Output(log_every=0))
    batch = [replace(light, motion=(motions * 10 + twins)[i], seed=i) for i in range(44)]
    sent: list[tuple[str, int]] = []
    submit = client.submit

    def counted(function: Any, *arguments: Any, key: str, **options: Any) -> Any:
        size = sum(len(a) for a in arguments if isinstance(a, bytes))
        sent.append((key, size))
        return submit(function, *arguments, key=key, **options)

    monkeypatch.setattr(client, "submit", counted)
    monkeypatch.setattr("vsr2.simulation.distributed._held", {})  # meshes of earlier tests
    result = run_batch(batch, client=client)
    assert set(result["status"]) == {"ok"}
    contents = [key for key, _ in sent if not key.startswith("vsr2-trials-")]
    assert len([key for key in contents if key.startswith("vsr2-motion-")]) == 4
    assert len([key for key in contents if key.startswith("vsr2-mesh-")]) == 1
    chunks = [size for key, size in sent if key.startswith("vsr2-trials-")]
    assert len(chunks) >= 8
    assert max(chunks) < 4000 < trials[0].motion.displacement.nbytes
    # The next batch finds it there.
    sent.clear()
    run_batch(batch, client=client)
    assert all(key.startswith("vsr2-trials-") for key, _ in sent)

    def fetched(dask_worker: Any = None) -> list[str]:
        return [key for entry in dask_worker.transfer_incoming_log for key in entry["keys"]]

    # However many chunks needed it, no worker fetched it from the other more than once.
    for keys in client.run(fetched).values():
        counts = [keys.count(key) for key in contents if "motion" in key]
        assert max(counts) <= 1


def test_a_checkpoint_resumes_on_a_cluster(
    client: Any, trials: list[Trial], local: BatchResult, tmp_path: Path
) -> None:
    folder = prepare_folder(tmp_path / "run")
    run_batch(trials, threads=2, checkpoint=folder)
    lines = (folder / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    (folder / JOURNAL_FILE).write_bytes(b"".join(lines[:20]) + b'{"trial":')
    ran: list[int] = []
    resumed = run_batch(
        trials, client=client, checkpoint=folder, on_trial=lambda i, log: ran.append(i)
    )
    assert len(ran) == len(trials) - 19
    for name in local.trials:
        np.testing.assert_array_equal(local[name], resumed[name], err_msg=name)
    for i in range(len(trials)):
        assert load_trial_log(folder, i).state.tobytes() == local.log(i).state.tobytes()


def test_a_campaign_is_simulated_on_a_cluster(
    client: Any, trials: list[Trial], tmp_path: Path
) -> None:
    from campaign_samples import assert_equal
    from vsr2.campaign import simulate_campaign

    local = simulate_campaign(trials[:6], series_every=20, threads=1)
    far = simulate_campaign(
        trials[:6], series_every=20, client=client, checkpoint=prepare_folder(tmp_path / "c")
    )
    assert far.provenance["workers"] >= 1
    assert_equal(replace(local, provenance={}), replace(far, provenance={}))


def test_ctrl_c_keeps_what_is_finished(
    client: Any, trials: list[Trial], local: BatchResult
) -> None:
    when = 0.0

    def interrupt(i: int, log: object) -> None:
        nonlocal when
        if not when:
            when = time.monotonic()
            os.kill(os.getpid(), signal.SIGINT)

    result = run_batch(trials * 10, client=client, on_trial=interrupt)
    assert time.monotonic() - when < 1.0
    assert result.provenance["interrupted"]
    statuses = list(result["status"])
    assert 1 <= statuses.count("ok") < len(statuses)
    assert set(statuses) == {"ok", "not_run"}
    for i in np.flatnonzero(result["status"] == "ok"):
        assert result["peak_tilt"][i] == local["peak_tilt"][i % len(trials)]
    # The workers are free for the next batch.
    assert_same(local, run_batch(trials, client=client))


def test_a_client_that_does_not_serve_is_refused(
    client: Any, trials: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SimulationError, match="threads does not apply"):
        run_batch(trials, client=client, threads=2)
    with pytest.raises(SimulationError, match=r"must be a distributed\.Client"):
        run_batch(trials, client="tcp://127.0.0.1:8786")  # type: ignore[arg-type]
    slow = replace(trials[0], motion=replace(trials[0].motion, time_step=0.002))
    with pytest.raises(SimulationError, match="resample"):
        run_batch([slow], client=client)
    facts = _native.build_facts() | {"version": "0.0.0"}
    monkeypatch.setattr("vsr2.simulation.distributed._native.build_facts", lambda: facts)
    with pytest.raises(SimulationError, match=r"not the client's .*0\.0\.0"):
        run_batch(trials, client=client)


def test_the_command_line_uses_a_cluster(
    cluster: Cluster,
    client: Any,
    local: BatchResult,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    address = client.scheduler_info()["address"]
    run = ["run", str(study), "--out", str(tmp_path / "out")]
    assert main([*run, "--scheduler", address, "--quiet"]) == 0
    assert_same(local, load_result(tmp_path / "out"))
    # A cluster that does not answer costs no result.
    assert main([*run, "--overwrite", "--scheduler", "nonsense://127.0.0.1:1"]) == 2
    assert "cannot be reached" in capsys.readouterr().err
    assert main([*run, "--overwrite", "--scheduler", address, "--threads", "2"]) == 2
    assert "--threads" in capsys.readouterr().err
    assert_same(local, load_result(tmp_path / "out"))


def test_a_lost_scheduler_is_an_error_that_keeps_what_is_finished(
    client: Any, trials: list[Trial], tmp_path: Path
) -> None:
    other = Cluster(tmp_path, workers=1)
    folder = prepare_folder(tmp_path / "run")
    try:
        with connect(other.file, timeout=TIMEOUT) as alone:
            seen: list[int] = []

            def kill(i: int, log: object) -> None:
                if not seen:
                    other.kill_scheduler()
                seen.append(i)

            with pytest.raises(SimulationError, match="kept where there is a checkpoint"):
                run_batch(trials, client=alone, checkpoint=folder, on_trial=kill)
    finally:
        other.close()
    ran: list[int] = []
    run_batch(trials, threads=2, checkpoint=folder, on_trial=lambda i, log: ran.append(i))
    assert len(ran) == len(trials) - len(seen)


def test_without_distributed_the_error_names_the_extra(
    trials: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SimulationError, match=r"vsr2\[parallel\]"):
        connect("tcp://127.0.0.1:8786")
    with pytest.raises(SimulationError, match=r"vsr2\[parallel\]"):
        run_batch(trials, client=object())  # type: ignore[arg-type]


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


# Shards -------------------------------------------------------------------------------------------


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
