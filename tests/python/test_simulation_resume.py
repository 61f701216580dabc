"""Nothing finished is lost: real kills, resumed batches, damaged journals."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsr2.config.study import Output, Study
from vsr2.errors import ResultError
from vsr2.motion import Motion
from vsr2.results import (
    JOURNAL_FILE,
    BatchResult,
    load_trial_log,
    prepare_folder,
    remove_temporaries,
)
from vsr2.simulation import run_batch, study_trials
from vsr2.trial import Trial

STUDY = """
name: killed
rock: {shape: box, size: [0.25, 0.5, 1.0], density: 2700.0}
motion:
  mode: grid_cosine
  pga_g: {min: 0.1, max: 0.6, step: 0.05}
  pgv_pga_s: {min: 0.1, max: 0.2, step: 0.05}
output: {log_every: 10, figures: false}
"""


def trials() -> list[Trial]:
    import yaml

    return study_trials(Study.model_validate(yaml.safe_load(STUDY)))[:12]


def assert_same(a: BatchResult, b: BatchResult) -> None:
    for name in a.trials:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_a_batch_resumed_at_any_point_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    complete = prepare_folder(tmp_path / "complete")
    reference = run_batch(trials(), threads=1, checkpoint=complete)
    lines = (complete / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    assert len(lines) == 13
    for finished in (0, 1, 5, 11, 12):
        for torn in (b"", b'{"trial":11,"sta'):
            part = prepare_folder(tmp_path / f"part{finished}{len(torn)}")
            (part / JOURNAL_FILE).write_bytes(b"".join(lines[: finished + 1]) + torn)
            if (complete / "logs").is_dir():
                shutil.copytree(complete / "logs", part / "logs")
            ran: list[int] = []
            resumed = run_batch(
                trials(),
                threads=2,
                checkpoint=part,
                on_trial=lambda i, log, ran=ran: ran.append(i),
            )
            assert_same(reference, resumed)
            assert len(ran) == 12 - finished
            for i in range(12):
                a, b = load_trial_log(complete, i), load_trial_log(part, i)
                assert a.state.tobytes() == b.state.tobytes()


@pytest.mark.parametrize("harm", ["deleted", "cut", "changed"])
def test_a_finished_trial_whose_log_was_lost_is_run_again(harm: str, tmp_path: Path) -> None:
    folder = prepare_folder(tmp_path / "out")
    reference = run_batch(trials(), checkpoint=folder)
    path = folder / "logs" / "000004.npz"
    intact = path.read_bytes()
    if harm == "deleted":
        path.unlink()
    else:
        path.write_bytes(intact[:-1] if harm == "cut" else intact[:-1] + bytes([intact[-1] ^ 1]))
    ran: list[int] = []
    resumed = run_batch(trials(), checkpoint=folder, on_trial=lambda i, log: ran.append(i))
    assert ran == [4]
    assert_same(reference, resumed)
    np.testing.assert_array_equal(
        load_trial_log(folder, 4).state, run_batch(trials()[4:5]).logs[0].state
    )
    # What was made again is taken the next time.
    run_batch(trials(), checkpoint=folder, on_trial=lambda i, log: ran.append(i))
    assert ran == [4]


def test_outputs_are_filled_for_resumed_trials_too(tmp_path: Path) -> None:
    folder = prepare_folder(tmp_path / "run")
    batch = trials()[:3]
    arrays = {"state": np.empty((3, 200, 18)), "peak_tilt": np.empty(3)}
    run_batch(batch, checkpoint=folder, out=arrays)
    again = {name: np.empty_like(array) for name, array in arrays.items()}
    run_batch(batch, checkpoint=folder, out=again)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, again[name])
    assert np.isfinite(arrays["peak_tilt"]).all()


def test_a_journal_of_other_trials_is_refused(tmp_path: Path) -> None:
    folder = prepare_folder(tmp_path / "run")
    batch = trials()[:2]
    run_batch(batch, checkpoint=folder)
    other = [replace(trial, output=Output(log_every=3)) for trial in batch]
    for wrong in (other, batch[:1], list(reversed(batch))):
        with pytest.raises(ResultError, match="other trials"):
            run_batch(wrong, checkpoint=folder)


def test_a_journal_with_other_columns_are_refused_in_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (tmp_path / "study.yaml").write_text(STUDY)
    run_batch(trials()[:1], checkpoint=prepare_folder(folder))
    newer = (
        "import sys\n"
        "from vsr2 import _native\n"
        "added = _native.Column(name='peak_tilt_time', unit='s', description='of the peak tilt',\n"
        "    missing='', dtype='float64')\n"
        "columns = [*_native.result_columns(), added]\n"
        "_native.result_columns = lambda: columns\n"
        "_native.TrialResult.peak_tilt_time = 0.0\n"
        "from vsr2.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    run = [sys.executable, "-c", newer, *run_cli(tmp_path, "--resume")[3:]]
    refused = subprocess.run(run, check=False, capture_output=True, text=True)
    assert refused.returncode == 2, refused.stderr
    line = refused.stderr.strip()
    assert "\n" not in line
    assert re.search(
        r"journal\.jsonl: is a vsr2 journal of version '5 with columns \w+', this", line
    )


def run_cli(folder: Path, *more: str) -> list[str]:
    return [
        sys.executable, "-m", "vsr2.cli.main", "run", str(folder / "study.yaml"),
        "--out", str(folder / "out"), "--threads", "2", "--quiet", *more,
    ]  # fmt: skip


def test_kill_9_at_any_moment_loses_no_finished_trial(tmp_path: Path) -> None:
    calm = tmp_path / "calm"
    calm.mkdir()
    (calm / "study.yaml").write_text(STUDY)
    subprocess.run(run_cli(calm), check=True)
    table = (calm / "out" / "trials.csv").read_bytes()

    wild = tmp_path / "wild"
    wild.mkdir()
    (wild / "study.yaml").write_text(STUDY)
    journal = wild / "out" / JOURNAL_FILE
    kills = 0
    for target in (2, 9, 20):
        child = subprocess.Popen(run_cli(wild, "--resume"))
        deadline = time.monotonic() + 60
        while child.poll() is None and time.monotonic() < deadline:
            if journal.is_file() and journal.read_bytes().count(b"\n") > target:
                child.send_signal(signal.SIGKILL)
                break
            time.sleep(0.001)
        kills += child.wait() == -signal.SIGKILL
    assert kills >= 2, "the runs ended before they could be killed: the test shows nothing"
    before = journal.read_bytes().rpartition(b"\n")[0]
    finished = [json.loads(line)["trial"] for line in before.splitlines()[1:]]
    logs = [wild / "out" / "logs" / f"{i:06d}.npz" for i in finished]
    written = [log.stat().st_mtime_ns for log in logs]
    (wild / "out" / "logs" / f".{logs[0].name}.0123456789ab.tmp").write_bytes(b"torn")
    # Killed once more, when the whole result is written but the journal still there.
    code = (
        "import os, sys, vsr2.results\n"
        "vsr2.results.remove_journal = lambda folder: os._exit(9)\n"
        "from vsr2.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    late = subprocess.run([sys.executable, "-c", code, *run_cli(wild, "--resume")[3:]], check=False)
    assert late.returncode == 9
    assert (wild / "out" / "provenance.json").exists()
    subprocess.run(run_cli(wild, "--resume"), check=True)
    # No finished trial ran again.
    assert [log.stat().st_mtime_ns for log in logs] == written
    assert not list((wild / "out").rglob("*.tmp"))
    assert not journal.exists()
    assert before.count(b"\n") >= 9
    assert (wild / "out" / "trials.csv").read_bytes() == table
    for log in sorted((calm / "out" / "logs").iterdir()):
        a = load_trial_log(calm / "out", int(log.stem))
        b = load_trial_log(wild / "out", int(log.stem))
        assert a.state.tobytes() == b.state.tobytes()


def test_interrupt_then_resume_from_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(STUDY)
    journal = tmp_path / "out" / JOURNAL_FILE
    child = subprocess.Popen(run_cli(tmp_path), stderr=subprocess.PIPE, text=True)
    while child.poll() is None:
        if journal.is_file() and journal.read_bytes().count(b"\n") > 3:
            child.send_signal(signal.SIGINT)
            break
        time.sleep(0.001)
    _, errors = child.communicate(timeout=30)
    assert child.returncode == 130
    assert "--resume" in errors
    # Without --resume an unfinished run is not overwritten by accident.
    refused = subprocess.run(run_cli(tmp_path), capture_output=True, text=True)
    assert refused.returncode == 2
    assert "already holds a result" in refused.stderr
    assert subprocess.run(run_cli(tmp_path, "--resume")).returncode == 0


def test_a_full_disk_stops_with_an_error_and_leaves_complete_lines(tmp_path: Path) -> None:
    # A limit on file sizes stands for the full disk: writes fail in the middle of a line.
    code = (
        "import resource, signal, sys\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1500, 1500))\n"
        "from vsr2.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    (tmp_path / "study.yaml").write_text(STUDY)
    arguments = run_cli(tmp_path, "--set", "output.log_every=0")[3:]
    out = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60
    )
    assert out.returncode == 2, out.stderr
    assert "cannot be written" in out.stderr
    content = (tmp_path / "out" / JOURNAL_FILE).read_bytes()
    assert content.endswith(b"\n")
    assert not (tmp_path / "out" / "trials.csv").exists()
    done = subprocess.run(
        [sys.executable, "-m", "vsr2.cli.main", *arguments, "--resume"], timeout=60
    )
    assert done.returncode == 0


def test_logs_that_cannot_fit_are_refused_at_the_start(tmp_path: Path) -> None:
    from vsr2.config.study import Outcome

    still = np.zeros(1_500_000)
    endless = Motion("endless", 1e-3, still, still, still, "recording")
    long = replace(
        trials()[0],
        motion=endless,
        outcome=Outcome(stop_early=False),
        output=Output(log_every=1),
    )
    count = 2 + int(shutil.disk_usage(tmp_path).free / (still.size * 18 * 8))
    folder = prepare_folder(tmp_path / "run")
    with pytest.raises(ResultError, match="needs at least"):
        run_batch([long] * count, checkpoint=folder)
    assert len((folder / JOURNAL_FILE).read_bytes().splitlines()) == 1


FULL = """
mount -t tmpfs -o size={size} none {mount} || exit 77
mkdir {mount}/out
[ {filler} = 0 ] || head -c {filler} /dev/zero > {mount}/filler 2>/dev/null
[ {remount} = 0 ] || mount -o remount,ro {mount}
{command}
code=$?
cat {mount}/out/journal.jsonl > {copy}/journal.jsonl 2>/dev/null
find {mount}/out -type f > {copy}/files
for log in {mount}/out/logs/*.npz; do cp $log {copy}/ 2>/dev/null; done
exit $code
"""


def run_on_small_disk(tmp_path: Path, **facts: object) -> subprocess.CompletedProcess[str]:
    """Runs the study on a file system of its own, in a name space where that may be mounted."""
    (tmp_path / "study.yaml").write_text(STUDY)
    mount, copy = tmp_path / "mount", tmp_path / "copy"
    mount.mkdir()
    copy.mkdir()
    command = shlex.join(run_cli(tmp_path)).replace(str(tmp_path / "out"), str(mount / "out"))
    script = FULL.format(command=command, mount=mount, copy=copy, **facts)
    unshare = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
    try:
        done = subprocess.run(unshare, capture_output=True, text=True, timeout=100)
    except FileNotFoundError:
        pytest.skip("there is no unshare")
    if done.returncode == 77 or "unshare:" in done.stderr:
        pytest.skip("this system lets users mount nothing in a name space of their own")
    return done


def test_a_read_only_folder_and_a_full_disk_are_reported_at_the_start(tmp_path: Path) -> None:
    for name, filler, remount in (("read-only", 0, 1), ("full", 10**6, 0)):
        folder = tmp_path / name
        folder.mkdir()
        done = run_on_small_disk(folder, size="64k", filler=filler, remount=remount)
        assert done.returncode == 2, done.stderr
        reason = "Read-only file system" if remount else "No space left on device"
        assert reason in done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert (folder / "copy" / "files").read_text() == ""


def test_a_disk_that_fills_up_leaves_complete_files_only(tmp_path: Path) -> None:
    done = run_on_small_disk(tmp_path, size="300k", filler=0, remount=0)
    assert done.returncode == 2, done.stderr
    assert "No space left on device" in done.stderr
    copy = tmp_path / "copy"
    lines = (copy / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert all(line.endswith(b"}\n") for line in lines)
    finished = [json.loads(line)["trial"] for line in lines[1:]]
    assert 0 < len(finished) < 33
    (copy / "logs").mkdir()
    for log in copy.glob("*.npz"):
        log.rename(copy / "logs" / log.name)
    for i in finished:
        assert len(load_trial_log(copy, i).state) > 10
    files = (copy / "files").read_text().splitlines()
    assert not [name for name in files if name.endswith(("trials.csv", "provenance.json", ".tmp"))]


@pytest.mark.parametrize("inner", ["", "logs", "npy", "models", "figures"])
def test_what_a_killed_writer_left_is_removed(inner: str, tmp_path: Path) -> None:
    folder = tmp_path / inner
    folder.mkdir(exist_ok=True)
    for name in (f".rock.npz.{'0' * 12}.tmp", ".mine.tmp"):
        (folder / name).touch()
    remove_temporaries(tmp_path)
    assert [one.name for one in folder.iterdir()] == [".mine.tmp"]
