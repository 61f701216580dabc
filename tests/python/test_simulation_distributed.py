"""More than one machine: a real Dask scheduler and worker processes over TCP, and shards."""

from __future__ import annotations

import contextlib
import os
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

from distributed_samples import STUDY, assert_same
from vsr2 import _native
from vsr2.cli.main import main
from vsr2.config.study import Outcome, Output, Study
from vsr2.effects import apply_effects
from vsr2.errors import SimulationError
from vsr2.fragility import load_fragility, run_fragility
from vsr2.results import JOURNAL_FILE, BatchResult, load_result, load_trial_log, prepare_folder
from vsr2.scene import build_scene
from vsr2.simulation import (
    connect,
    run_batch,
    study_trials,
)
from vsr2.trial import Trial

TIMEOUT = 30.0

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return study_trials(Study.model_validate(yaml.safe_load(STUDY)))


@pytest.fixture(scope="module")
def local(trials: list[Trial]) -> BatchResult:
    return run_batch(trials, threads=2)


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
    from vsr2.campaign import RunOptions, simulate_campaign

    local = simulate_campaign(trials[:6], series_every=20, run=RunOptions(threads=1))
    far = simulate_campaign(
        trials[:6],
        series_every=20,
        run=RunOptions(client=client, checkpoint=prepare_folder(tmp_path / "c")),
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


def test_a_scheduler_file_that_is_not_there_is_not_waited_for_for_ever(tmp_path: Path) -> None:
    (tmp_path / "scheduler.json").write_text("{}")
    with pytest.raises(SimulationError, match=r"after 0\.1 s; did you mean .*scheduler"):
        connect(str(tmp_path / "schedulr.json"), timeout=0.1)


def test_effects_of_a_file_reach_a_cluster_whose_workers_do_not_read_it(
    cluster: Cluster, client: Any, tmp_path: Path
) -> None:
    pad = Path(__file__).resolve().parents[2] / "docs" / "examples" / "soft_pad.py"
    study = tmp_path / "study.yaml"
    study.write_text(STUDY.replace("step: 0.05}\n  pgv_m_s", "step: 0.25}\n  pgv_m_s"))
    soft = tmp_path / "soft.yaml"
    soft.write_text(f"{study.read_text()}effects: {{soft_pad: {{compliance: 3.0e-8}}}}\n")
    line = ["--quiet", "--effects", str(pad)]
    script = "import sys; from vsr2.cli.main import main; sys.exit(main(sys.argv[1:]))"
    found = []
    # In processes of their own, so that the effect joins the library of no other test.
    for name, file, more in (
        ("plain", study, []),
        ("here", soft, ["--threads", "1"]),
        ("there", soft, ["--scheduler", str(cluster.file)]),
    ):
        run = ["run", str(file), "--out", str(tmp_path / name), *line, *more]
        subprocess.run([sys.executable, "-c", script, *run], check=True)
        found.append(load_result(tmp_path / name))
    plain, here, there = found
    assert_same(here, there)
    assert np.any(plain["peak_tilt"] != here["peak_tilt"])


def test_fragility_runs_on_a_cluster(client: Any, tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    loaded = load_fragility(study)
    here, there = run_fragility(loaded, threads=2), run_fragility(loaded, client=client)
    for name in here.batch.trials:
        np.testing.assert_array_equal(here.batch[name], there.batch[name], err_msg=name)


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
