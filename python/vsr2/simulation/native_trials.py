"""Trials in native threads of this process: handed to the core, taken back as they finish."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from vsr2 import _native
from vsr2.config.study import Settling
from vsr2.motion import Motion
from vsr2.results import FLOAT_COLUMNS, RESULT_COLUMNS, HandOver, Outcome, Status, TrialLog
from vsr2.scene import Pose
from vsr2.simulation.native_drive import native_drive
from vsr2.simulation.native_scenes import POINT_BYTES, hull_points, native_scene
from vsr2.simulation.planning import log_bytes
from vsr2.trial import Trial


@dataclass(frozen=True)
class QueueConstants:
    """How far trials are handed over ahead of their results; no result depends on it.

    Chosen by hand, judged by `python benchmarks/threads.py` and
    `python benchmarks/million_trials.py`.

    Attributes:
        poll: how often finished trials are collected and Ctrl-C is looked for, at least [s].
        pause: share of the time that the core is busy anyway, for which finished trials may lie.
        trials: most that the core holds, waiting, running or not yet taken.
        bytes: most that their samples, logs and scenes can take, unless two trials a thread take
            more.
        refill: share of either down to which they run out before more are made.
        starts: settled starts of a scene that are kept for later trials.
        scenes: of which they are kept, those used last.
    """

    poll: float = 0.1
    pause: float = 0.1
    trials: int = 1024
    bytes: int = 2**25
    refill: float = 0.5
    starts: int = 4096
    scenes: int = 16


QUEUE = QueueConstants()


def _settled_start(
    scene: _native.Scene, drive: _native.Drive, body: Pose, settling: Settling, log_every: int
) -> _native.SettledStart:
    return _native.SettledStart(
        scene=scene,
        drive=drive,
        position=np.asarray(body.position),
        orientation=np.asarray(body.orientation),
        log_every=log_every,
        **settling.model_dump(),
    )


class _SettledStarts:
    """Equal starts settle once.

    Those not used for a while go, and those of scenes not used for a while, so memory does not
    grow.
    """

    def __init__(self) -> None:
        self._of: OrderedDict[_native.Scene, Callable[..., _native.SettledStart]] = OrderedDict()

    def __call__(self, scene: _native.Scene, *start: Any) -> _native.SettledStart:
        if scene not in self._of:
            self._of[scene] = lru_cache(QUEUE.starts)(partial(_settled_start, scene))
        self._of.move_to_end(scene)
        if len(self._of) > QUEUE.scenes:
            self._of.popitem(last=False)
        return self._of[scene](*start)


def _specification(
    trial: Trial, settled_start: Callable[..., _native.SettledStart]
) -> _native.TrialSpec:
    """A trial as the core takes it; the motion is lent."""
    cosine = trial.motion.kind == "cosine"
    drive = native_drive(trial.drive, beside_x=trial.goes_beside_x, cosine=cosine)
    scene, output = trial.scene, trial.output
    body = scene.body_pose(trial.start_pose)
    log_every = output.log_every if output.log_settling else 0
    return _native.TrialSpec(
        start=settled_start(native_scene(scene), drive, body, trial.settling, log_every),
        **_lent(trial.motion),
        log_every=output.log_every,
        contacts_every=output.contacts_every,
        **trial.outcome.model_dump(),
    )


def run_native(
    trials: Iterable[Trial],
    threads: int,
    *,
    take: Callable[[int, Trial, dict[str, Any], TrialLog | None], None],
    stopped: Callable[[], bool],
) -> None:
    """Run trials in native threads of this process.

    Trials are handed to the core a little ahead of those that are finished and taken, so that
    neither what waits nor what `take` has not caught up with grows with the batch. They are asked
    for one by one and let go of as they are taken: where they are made then, their motions are in
    memory no longer than their run.

    Args:
        trials: what to run; they passed :func:`check_trials`.
        threads: how many at a time.
        take: called with index, trial, row and log of each as it finishes.
        stopped: asked every `poll`; once true, trials that run end with status `cancelled` and no
            others begin.
    """
    settled_start = _SettledStarts()
    native = _native.Batch(threads=threads)
    # Specifications are kept: who lets go of a motion last needs the interpreter's lock, for which
    # a thread of the core would wait while trials are made.
    under_way: dict[int, tuple[Trial, _native.TrialSpec, float]] = {}
    ahead, began, taken = 0.0, time.monotonic(), 0
    scenes: Counter[str] = Counter()
    waiting = iter(trials)
    following = next(waiting, None)
    try:
        while not native.exhausted():
            # Trials are made, and taken, many at a time: this thread wakes less often.
            share = QUEUE.refill
            while following is not None:
                # A scaled motion's samples are made for its trial.
                size = log_bytes(following) + 16 * following.motion.size
                full = len(under_way) >= share * QUEUE.trials or ahead + size > share * QUEUE.bytes
                if full and len(under_way) >= 2 * threads:
                    break
                share = 1.0
                specification = _specification(following, settled_start)
                under_way[native.add(specification)] = following, specification, size
                ahead += size
                if not scenes[following.scene.sha256]:
                    ahead += POINT_BYTES * hull_points(following.scene)
                scenes[following.scene.sha256] += 1
                following = next(waiting, None)
            else:
                native.close()
            busy = len(under_way) * (time.monotonic() - began) / max(taken, 1)
            time.sleep(min(QUEUE.poll, QUEUE.pause * busy) if taken else 0.0)
            for i in native.wait(QUEUE.poll):
                result = native.take(i)
                trial, _, size = under_way.pop(i)
                ahead -= size
                scenes[trial.scene.sha256] -= 1
                if not scenes[trial.scene.sha256]:
                    del scenes[trial.scene.sha256]
                    ahead -= POINT_BYTES * hull_points(trial.scene)
                taken += 1
                take(i, trial, _row(result), _log(trial, result))
            if stopped():
                native.cancel()
                following = None
    finally:
        native.cancel()
        native.join()


def _lent(motion: Motion) -> dict[str, Any]:
    """A motion's channels as the core borrows them: their memory is not copied."""
    return {
        "motion_position": _native.Samples(values=motion.displacement),
        "motion_velocity": _native.Samples(values=motion.velocity),
    } | {
        name: None if side is None else _native.Samples(values=side.displacement)
        for name, side in motion.sides.items()
    }


def _row(result: _native.TrialResult) -> dict[str, Any]:
    row = {name: getattr(result, name) for name in RESULT_COLUMNS}
    return row | {"engine": result.engine or ""}


def failed_row(trial: Trial, message: str) -> dict[str, Any]:
    """The row of a trial that could not be run to an end of its own, with status `error`."""
    engine = native_scene(trial.scene).engine.name
    facts = {"message": message, "engine": engine, "hand_over": HandOver.none}
    codes = {"status": Status.error, "outcome": Outcome.failed, "steps": 0}
    return dict.fromkeys(FLOAT_COLUMNS, np.nan) | facts | codes


def _log(trial: Trial, result: _native.TrialResult) -> TrialLog | None:
    state = result.take_log()
    if len(state) == 0:
        return None
    frame = trial.scene.body_frame
    return TrialLog(
        state=state,
        contacts=result.take_contacts(),
        excursions=result.take_excursions(),
        pivot=np.array([*trial.scene.pedestal.origin[:2], trial.scene.pitch_pivot]),
        settled_position=np.asarray(result.settled_position),
        settled_orientation=np.asarray(result.settled_orientation),
        foot=np.asarray(result.foot),
        mass_center=np.asarray(frame.position),
        principal_axes=np.asarray(frame.orientation),
    )
