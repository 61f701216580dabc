"""Batches: independence of threads and order, statuses, interruption, preallocated outputs."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vsr2 import _native
from vsr2.config.study import Outcome, Output, Settling, Study
from vsr2.errors import SimulationError
from vsr2.motion import Motion, build_recorded_motion, cosine_motion, read_record
from vsr2.report.messages.runs import trial_end
from vsr2.results import BatchResult
from vsr2.scene import Pose
from vsr2.simulation import Simulation, run_batch, study_trials
from vsr2.simulation.native_trials import QUEUE, _settled_start, _specification, run_native
from vsr2.simulation.planning import log_bytes
from vsr2.trial import Trial

ROOT = Path(__file__).resolve().parents[2]


def block_study(
    *,
    mode: str = "auto",
    skip: str = "quiet",
    size: tuple[float, float, float] = (0.25, 0.5, 1.0),
    **output: object,
) -> Study:
    return Study.model_validate(
        {
            "engine": {"mode": mode, "skip": skip},
            "rock": {"shape": "box", "size": list(size), "density": 2700.0},
            "motion": {
                "mode": "grid_cosine",
                "pga_g": {"min": 0.2, "max": 0.6, "step": 0.2},
                "pgv_pga_s": {"min": 0.1, "max": 0.2, "step": 0.1},
            },
            "output": {"log_every": 5, **output},
        }
    )


def assert_same(a: BatchResult, b: BatchResult, order: list[int] | None = None) -> None:
    order = order or list(range(len(a)))
    for name in a.trials:
        if name not in ("trial", "seed"):
            np.testing.assert_array_equal(a[name][order], b[name], err_msg=name)
    for i, j in enumerate(order):
        left, right = a.logs[j], b.logs[i]
        assert (left is None) == (right is None)
        if left is not None and right is not None:
            assert left.state.tobytes() == right.state.tobytes()
            assert left.contacts.tobytes() == right.contacts.tobytes()


def test_threads_of_the_core_go_on_while_trials_are_made() -> None:
    """Whoever lets go of a motion last needs the interpreter's lock, which is not given up here."""
    trials = study_trials(block_study(log_every=0))
    finished: list[int] = []
    at_first_look: list[int] = []

    def made() -> Iterator[Trial]:
        yield from trials
        before = sys.getswitchinterval()
        sys.setswitchinterval(1e3)
        until = time.perf_counter() + 3.0  # They take some 0.1 s together.
        while time.perf_counter() < until:
            pass
        sys.setswitchinterval(before)

    def stopped() -> bool:
        at_first_look.append(len(finished))
        return False

    run_native(made(), 1, take=lambda i, *_: finished.append(i), stopped=stopped)
    assert at_first_look[0] == len(trials)


def test_outcomes_grow_with_the_motion() -> None:
    result = run_batch(block_study())
    assert set(result["status"]) == {"ok"}
    assert result["outcome"][0] == "stable"
    assert result["outcome"][-1] == "overturned"
    assert np.all(np.isnan(result["overturning_time"]) == (result["outcome"] != "overturned"))
    assert result.stack("tilt").shape == (6, max(len(log.state) for log in result.logs if log))


@pytest.mark.parametrize("contacts_every", [0, 50])
def test_bits_do_not_depend_on_threads_order_or_company(contacts_every: int) -> None:
    # A log of contacts takes every step; without one there are quiet stretches.
    trials = study_trials(block_study(contacts_every=contacts_every))
    reference = run_batch(trials, threads=1)
    for threads in (2, 3, 8):
        assert_same(reference, run_batch(trials, threads=threads))
    order = [4, 0, 5, 2, 1, 3]
    assert_same(reference, run_batch([trials[i] for i in order], threads=2), order)
    alone = [run_batch([trial], threads=1) for trial in trials]
    for i, single in enumerate(alone):
        assert_same(reference, single, [i])


@pytest.mark.parametrize("skip", ["none", "quiet"])
def test_interactive_world_and_batch_share_the_core(skip: str) -> None:
    trial = study_trials(block_study(skip=skip))[3]
    # A log of contacts needs every step.
    trial = replace(trial, output=Output(log_every=1, contacts_every=100))
    log = run_batch([trial]).log(0)
    simulation = Simulation(trial.scene, drive="prescribed")
    simulation.settle(trial.settling)
    if skip == "none":
        # The batch starts a fresh world from the pose of rest and settles there once more.
        state = simulation.state
        simulation = Simulation(trial.scene, drive="prescribed", spawn=False)
        simulation._world.spawn_rock(position=state.position, orientation=state.body_orientation)
        simulation.settle(trial.settling)
    steps = min(len(log.state), trial.motion.displacement.size)
    assert steps > 500
    for k in range(1, steps):
        state = simulation.step(float(trial.motion.displacement[k]))
        assert state is not None
        assert state.position.tobytes() == log.position[k].tobytes()


def test_reset_is_exact_a_thousand_times() -> None:
    trial = study_trials(block_study())[2]
    simulation = Simulation(trial.scene, drive="prescribed")

    def story() -> bytes:
        for k in range(1, 20):
            simulation.step(0.001 * k)
        return simulation.state.position.tobytes() + simulation.state.velocity.tobytes()

    first = story()
    for _ in range(999):
        simulation.reset()
    simulation.reset()
    assert story() == first


def test_one_bad_trial_loses_no_other() -> None:
    trials = study_trials(block_study())
    # The rock starts 1 km up: it cannot come to rest in time.
    trials[1] = replace(
        trials[1],
        start=Pose((0.0, 0.0, 1000.0), (0.0, 0.0, 0.0, 1.0)),
        settling=Settling(timeout=0.5),
    )
    result = run_batch(trials)
    assert result["status"][1] == "settling_timeout"
    assert result["outcome"][1] == "failed"
    assert result["message"][1] == ""
    assert "come to rest within 0.5 s" in trial_end(list(result)[1])
    assert set(np.delete(result["status"], 1)) == {"ok"}
    assert np.isnan(result["peak_tilt"][1])


def test_preallocated_outputs_are_filled_in_place() -> None:
    trials = study_trials(block_study())
    plain = run_batch(trials)
    state = np.empty((len(trials), 400, 18))
    tilt = np.empty(len(trials))
    run_batch(trials, out={"state": state, "peak_tilt": tilt}, keep_logs=False)
    np.testing.assert_array_equal(tilt, plain["peak_tilt"])
    for i, log in enumerate(plain.logs):
        assert log is not None
        rows = min(400, len(log.state))
        np.testing.assert_array_equal(state[i, :rows], log.state[:rows])
        assert np.isnan(state[i, rows:]).all()


@pytest.mark.parametrize(
    ("out", "text"),
    [
        ({"state": np.empty((6, 10, 17))}, "shape"),
        ({"state": np.empty((6, 10, 18), dtype=np.float32)}, "float32"),
        ({"tilt": np.empty(6)}, "unknown array"),
        ({"peak_tilt": np.empty(5)}, "shape"),
    ],
)
def test_wrong_outputs_are_refused(out: dict[str, np.ndarray], text: str) -> None:
    with pytest.raises(SimulationError, match=text):
        run_batch(block_study(), out=out)


def test_impossible_requests_are_refused_before_any_work() -> None:
    with pytest.raises(SimulationError, match="empty"):
        run_batch([])
    with pytest.raises(SimulationError, match="threads"):
        run_batch(block_study(), threads=0)
    count: Any
    for count in (True, 1.5):
        with pytest.raises(SimulationError, match="whole number from 1 to 1024"):
            run_batch(block_study(), threads=count)
    trial = study_trials(block_study())[0]
    slow = cosine_motion(0.1, 1.0, 2e-3)
    with pytest.raises(SimulationError, match="resample"):
        run_batch([replace(trial, motion=slow)])
    with pytest.raises(SimulationError, match="contact_trials"):
        run_batch(block_study(contacts_every=1, contact_trials=[6]))


def test_contacts_are_logged_for_the_chosen_trials_only() -> None:
    result = run_batch(block_study(contacts_every=20, contact_trials=[1, 3]))
    assert [len(log.contacts) > 0 for log in result.logs if log] == [
        False, True, False, True, False, False,
    ]  # fmt: skip


def test_a_log_is_no_longer_than_is_said_and_no_shorter() -> None:
    trials = study_trials(block_study(contacts_every=10))
    trials = [
        replace(one, outcome=one.outcome.model_copy(update={"stop_early": False})) for one in trials
    ]
    for trial, log in zip(trials, run_batch(trials, threads=2).logs, strict=True):
        assert log is not None
        most = log_bytes(trial, contacts=False)
        assert log.state.nbytes <= most
        assert log_bytes(trial, contacts=False, least=True) <= log.state.nbytes
        assert log.contacts.nbytes <= log_bytes(trial) - most


def test_a_slow_taker_bounds_what_the_core_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whatever the batch's length: trials are handed to the core as results are taken.
    queue = "vsr2.simulation.native_trials.QUEUE"
    monkeypatch.setattr(queue, replace(QUEUE, trials=5))
    asked: list[int] = []
    taken: list[int] = []

    def watched(batch: list[Trial]) -> Iterator[Trial]:
        # The next one is made while the core is full.
        for i, trial in enumerate(batch):
            asked.append(i)
            assert i <= len(taken) + 5
            yield trial

    trials = study_trials(block_study(mode="fast"))
    batch = [trials[i % 6] for i in range(24)]
    reference = run_batch(trials)
    for limit in (5, 10**9):
        # The size of logs is a limit too; two trials a thread are always handed over.
        size = 2**40 if limit == 5 else 0
        monkeypatch.setattr(queue, replace(QUEUE, trials=limit, bytes=size))
        asked.clear()
        taken.clear()
        rows: dict[int, dict[str, object]] = {}

        def take(i: int, trial: Trial, row: dict[str, object], log: object) -> None:
            assert trial is batch[i]
            taken.append(i)
            rows[i] = row  # noqa: B023

        run_native(watched(batch), 2, take=take, stopped=lambda: False)
        assert sorted(taken) == list(range(24))
        assert all(rows[i]["peak_tilt"] == reference["peak_tilt"][i % 6] for i in range(24))


@pytest.mark.parametrize("ended", [True, False])
def test_motions_may_go_while_their_trials_run(
    ended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The last to let go of a motion's memory is then a thread of the core, which has no GIL, or,
    # not `ended`, the batch that goes with trials that wait and run.
    class Lent(np.ndarray):
        """An array that can be referred to weakly."""

    alive: list[weakref.ref[Lent]] = []

    def lend(values: np.ndarray) -> _native.Samples:
        owner = values.copy()
        owner.setflags(write=False)
        array = owner.view(Lent)
        alive.append(weakref.ref(array))
        return _native.Samples(values=array)

    def lent(motion: Motion) -> dict[str, object]:
        sides = dict.fromkeys(motion.sides)
        return {
            "motion_position": lend(motion.displacement),
            "motion_velocity": lend(motion.velocity),
            **sides,
        }

    trials = study_trials(block_study(mode="fast"))
    reference = run_batch(trials)
    monkeypatch.setattr("vsr2.simulation.native_trials._lent", lent)
    batch = _native.Batch(threads=3)
    for i in range(24):
        batch.add(_specification(trials[i % 6], _settled_start))
    batch.close()
    assert len(alive) == 48
    assert any(array() is not None for array in alive)
    if ended:
        results: dict[int, _native.TrialResult] = {}
        while not batch.exhausted():
            results |= {i: batch.take(i) for i in batch.wait(0.05)}
        batch.join()
        for name in ("peak_tilt", "final_slip", "simulated_time"):
            values = [getattr(results[i], name) for i in range(24)]
            np.testing.assert_array_equal(values, np.tile(reference[name], 4))
    else:
        del batch
    gc.collect()
    assert all(array() is None for array in alive)


def test_exception_in_the_callback_reaches_the_caller() -> None:
    def fail(index: int, log: object) -> None:
        raise RuntimeError(f"no room for {index}")

    with pytest.raises(RuntimeError, match="no room"):
        run_batch(block_study(), on_trial=fail)


def test_runs_outside_the_main_thread() -> None:
    found: list[BatchResult] = []
    worker = threading.Thread(target=lambda: found.append(run_batch(block_study(), threads=1)))
    worker.start()
    worker.join()
    assert set(found[0]["status"]) == {"ok"}


def test_ctrl_c_keeps_what_is_finished(tmp_path: Path) -> None:
    script = tmp_path / "long.py"
    script.write_text(
        textwrap.dedent(
            """
            import sys
            from vsr2.config.study import Study
            from vsr2.motion import cosine_motion
            from vsr2.simulation import run_batch, study_trials
            from dataclasses import replace
            import numpy as np
            from vsr2.motion import Motion
            study = Study.model_validate({
                "rock": {"shape": "box", "size": [0.25, 0.5, 1.0], "density": 2700.0},
                "motion": {"mode": "single_cosine", "pga_g": 0.2, "pgv_pga_s": 0.1},
                "engine": {"skip": "none"},
            })
            [first] = study_trials(study)
            still = np.zeros(1_900_000)
            endless = Motion("endless", 1e-3, still, still, still, "recording")
            trials = [first, replace(first, motion=endless), replace(first, motion=endless)]
            def tell(index, log):
                print("finished", index, flush=True)
            result = run_batch(trials, threads=2, on_trial=tell)
            print("status", *result["status"], result.provenance["interrupted"], flush=True)
            """
        )
    )
    child = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    assert child.stdout is not None
    assert child.stdout.readline().strip() == "finished 0"
    child.send_signal(signal.SIGINT)
    rest, _ = child.communicate(timeout=30)
    # The third trial may not have begun: the first one's thread takes it after the word is out.
    last = rest.splitlines()[-1]
    assert last in ("status ok cancelled cancelled True", "status ok cancelled not_run True")
    assert child.returncode == 0


def with_and_without_early_stop(trials: list[Trial]) -> tuple[BatchResult, BatchResult]:
    return tuple(
        run_batch([replace(t, outcome=Outcome(stop_early=early, tail=6.0)) for t in trials])
        for early in (True, False)
    )  # type: ignore[return-value]


def test_early_stop_keeps_the_outcome() -> None:
    # Bodies near their threshold, standing anyhow to the shaking, under embedded records.
    records = [
        build_recorded_motion(read_record(ROOT / f"configs/motions/synthetic_{k:02d}.csv"), 1e-3)
        for k in (3, 7)
    ]
    rng = np.random.default_rng(3)
    trials = []
    for size in ((0.25, 0.5, 1.0), (0.3, 0.35, 0.9)):
        [first, *_] = study_trials(block_study(mode="fast", size=size, log_every=0))
        for motion in records:
            for scale in rng.uniform(2.0, 9.0, 5) / motion.peak_acceleration:
                half = rng.uniform(0, np.pi) / 2
                start = Pose(
                    first.scene.rock.start.position, (0.0, 0.0, np.sin(half), np.cos(half))
                )
                trials.append(replace(first, start=start, motion=motion.scaled(float(scale))))
    early, late = with_and_without_early_stop(trials)
    np.testing.assert_array_equal(early["outcome"], late["outcome"])
    np.testing.assert_array_equal(early["overturning_time"], late["overturning_time"])
    assert {"overturned", "rocked"} <= set(early["outcome"])
    # A rock that rests to the end takes no steps either way.
    assert early["steps"].sum() < late["steps"].sum()


@pytest.mark.parametrize("mode", ["exact", "fast"])
def test_a_rock_that_creeps_on_is_not_stopped_before_it_has_slid(mode: str) -> None:
    # The table speeds up more gently than friction allows, to 0.1 m/s, and stops at once; the rock
    # slides on for v^2 / (2 mu g) = 51 mm, slower than the rest speed given all the while.
    time = np.arange(2001) * 1e-3
    velocity = np.append(0.05 * time, 0.0)
    displacement = np.append(0.025 * time**2, 0.025 * time[-1] ** 2)
    motion = Motion("ramp", 1e-3, displacement, velocity, np.gradient(velocity, 1e-3), "recording")
    block = block_study(mode=mode, size=(0.6, 0.6, 0.3), log_every=0)
    slippery = {part: {"lateral_friction": 0.1} for part in ("rock", "pedestal")}
    trial = study_trials(
        Study.model_validate(block.model_dump(exclude_unset=True) | {"contact": slippery})
    )[0]
    slid = {}
    for early in (True, False):
        outcome = Outcome(
            stop_early=early, tail=3.0, rest_linear_speed=0.2, rest_window=0.1, slid_distance=0.045
        )
        result = run_batch([replace(trial, motion=motion, outcome=outcome)], threads=1)
        slid[early] = (result["outcome"][0], result["final_slip"][0])
    assert slid[False][1] == pytest.approx(0.051, abs=0.002)
    assert slid[True][0] == slid[False][0] == "slid"


def test_early_stop_takes_no_pause_at_the_point_of_balance_for_rest() -> None:
    trial = study_trials(block_study(mode="fast", log_every=0))[3]
    low, high = 0.5, 2.0
    # The nearer to the threshold, the longer the block pauses on its edge.
    for _ in range(6):
        scales = np.linspace(low, high, 9)
        near = [replace(trial, motion=trial.motion.scaled(float(s))) for s in scales]
        early, late = with_and_without_early_stop(near)
        np.testing.assert_array_equal(early["outcome"], late["outcome"])
        first = int(np.argmax(late["outcome"] == "overturned"))
        assert first > 0
        low, high = scales[first - 1], scales[first]
    paused = late["overturning_time"][first] - trial.motion.duration
    assert paused > 1.5


def test_mirrored_records_mirror_the_slip() -> None:
    trial = study_trials(block_study())[0]
    shape = Study.model_validate(
        {
            "rock": {"shape": "box", "size": [1.0, 1.0, 0.3], "density": 2700.0},
            "contact": {"rock": {"lateral_friction": 0.5}, "pedestal": {"lateral_friction": 0.5}},
            "motion": {"mode": "single_cosine", "pga_g": 0.6, "pgv_pga_s": 0.1},
        }
    )
    [flat] = study_trials(shape)
    motion = flat.motion
    mirrored = Motion(
        "mirrored",
        motion.time_step,
        -motion.displacement,
        -motion.velocity,
        -motion.acceleration,
        "cosine",
    )
    result = run_batch([flat, Trial(flat.scene, mirrored, output=trial.output)])
    a, b = (result.log(i).slip[-1, 0] for i in range(2))
    assert abs(a) > 0.005
    assert a == pytest.approx(-b, rel=1e-3)
    assert list(result["outcome"]) == ["slid", "slid"]
