"""What a time step costs in truth, for the scene and the motions of a study."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.overturning_margin import MARGIN, seek_margins
from vsr2.config import Study
from vsr2.errors import SimulationError, Vsr2Error
from vsr2.one_line import counted
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation import check_trials, run_batch, study_trials
from vsr2.simulation.run_constants import run_constants
from vsr2.trial import Trial, rows_only

if TYPE_CHECKING:
    import distributed

Array = NDArray[np.float64]
TrialsOf = Callable[[Study], Sequence[Trial]]
"""Makes the trials of a study, at the time step that it states."""


@dataclass(frozen=True)
class TimeStepConstants:
    """How time steps are compared; chosen by hand.

    Attributes:
        steps: that are compared by default, the first with all others [s].
        motions: that are used at most; of more, some are drawn by the study's seed.
        replicates: starts of each motion.
        place: standard deviation of a start's place along x and y [m]; of its turn about the
            vertical [rad]. Far above rounding and far below what a set-up repeats to: responses
            part, and stay those of the same trial.
        reach: greatest size of a margin.
        halvings: of that range, so that a margin is good to 0.01.
        fewest: motions with a margin, below which nothing is said.
        tolerance: change of the mean margin that is borne by default.
        errors: standard errors that an estimate may be off by, where a tolerance is to hold.
    """

    steps: tuple[float, ...] = (0.00025, 0.0005, 0.001, 0.002, 0.004)
    motions: int = 100
    replicates: int = 2
    place: float = 1e-4
    reach: float = 1.0
    halvings: int = 7
    fewest: int = 8
    tolerance: float = 0.02
    errors: float = 2.0


TIME_STEPS = TimeStepConstants()


def time_step_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a comparison rests on, by what they are of."""
    return {"time_steps": asdict(TIME_STEPS), "margin": asdict(MARGIN), **run_constants()}


@dataclass(frozen=True)
class TimeStepError:
    """What one time step costs.

    Attributes:
        time_step: [s].
        motions: number that have a margin at this step and at the least one.
        margin_change: mean change of the margin against the least step; above zero, rocks overturn
            later than they should.
        standard_error: of that mean, over motions; not below that of the halving's rounding.
        scatter: standard deviation of the change in single trials.
        cpu_time: of a trial [s].
    """

    time_step: float
    motions: int
    margin_change: float
    standard_error: float
    scatter: float
    cpu_time: float

    def within(self, tolerance: float) -> bool:
        """Whether the mean margin surely changes by no more than a tolerance."""
        return abs(self.margin_change) + TIME_STEPS.errors * self.standard_error <= tolerance


class TooFewMarginsError(SimulationError):
    """So few motions overturn the rock that nothing can be said of a time step."""


def drawn_trials(motions: Sequence[Hashable], seed: int) -> list[int]:
    """One trial of each motion, of `TimeStepConstants.motions` at most, drawn and in order.

    Args:
        motions: of each trial.
        seed: of the draw.
    """
    # A spawn key, so that no start of a trial has the same stream.
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    first: dict[Hashable, int] = {}
    for i in rng.permutation(len(motions)).tolist():
        first.setdefault(motions[i], i)
    return sorted([*first.values()][: TIME_STEPS.motions])


def longest_time_step(found: Sequence[TimeStepError], tolerance: float) -> float | None:
    """The longest time step that keeps a tolerance, as all shorter ones do [s]; None: none does.

    Args:
        found: by rising time step, the first the one that others were compared with.
        tolerance: of the mean margin: 0.02 are 2 % in the strength of a motion.
    """
    out = None
    for one in found[1:]:
        if not one.within(tolerance):
            break
        out = one.time_step
    return out


def compare_time_steps(
    study: Study,
    steps: Sequence[float] = TIME_STEPS.steps,
    *,
    trials_of: TrialsOf = study_trials,
    replicates: int = TIME_STEPS.replicates,
    threads: int | None = None,
    client: distributed.Client | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[TimeStepError]:
    """Overturning margins of a study's trials at several time steps.

    A margin is the logarithm of the factor on a motion at which the rock overturns, sought by
    halving from 1 / e to e times the motion. All steps see the same motions, resampled in time, and
    the same starts. Responses are chaotic near the boundary, so single trials differ at any two
    steps; their mean tells what a step costs. A comparison of overturned shares does not: trials
    that are borderline at one step are less so at all others.

    Args:
        study: its scene, effects and motions; its own time step counts for nothing.
        steps: time steps, of which the least is the truth [s].
        trials_of: makes its trials, each of another motion; by default those of its own motions.
        replicates: starts of each motion.
        threads: as of :func:`vsr2.run_batch`; no result depends on it.
        client: as there.
        progress: called with batches done and all.

    Returns:
        One row a step, rising, up to the first at which the study cannot be compared, as where a
        record needs a filter at a coarse step.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: the study cannot be run at the
            two least steps.
        TooFewMarginsError: there too few of its motions have a margin within the range.
        KeyboardInterrupt: Ctrl-C came.
    """
    ordered = sorted(set(steps))
    if len(ordered) < 2 or ordered[0] <= 0:
        raise SimulationError(f"time steps {list(steps)}: give at least two, each above 0 s")
    if replicates < 1:
        raise SimulationError(f"replicates is {replicates}; give at least 1")
    batches = len(ordered) * TIME_STEPS.halvings
    margins, cpu = [], []
    for k, step in enumerate(ordered):

        def done(halvings: int, before: int = k * TIME_STEPS.halvings) -> None:
            if progress is not None:
                progress(before + halvings, batches)

        try:
            trials = _replicated(trials_of(study.at_time_step(step)), study.seed, replicates)
        except Vsr2Error:
            if k < 2:
                raise
            break
        if len(trials) < TIME_STEPS.fewest * replicates:
            raise TooFewMarginsError(
                f"study {study.name!r}: {len(trials) // replicates} motions; a comparison of time "
                f"steps needs {TIME_STEPS.fewest}; give more motions"
            )
        found, seconds = _margins(trials, threads, client, done)
        margins.append(found.reshape(-1, replicates))
        cpu.append(seconds)
    return _rows(study.name, ordered, margins, cpu)


def _rows(
    name: str, steps: Sequence[float], margins: Sequence[Array], cpu: Sequence[float]
) -> list[TimeStepError]:
    """What each step costs, as far as there are margins of it.

    Args:
        name: of the study.
        steps: rising [s].
        margins: of each step, NaN where there is none, shape (motions, replicates).
        cpu: time of a trial at each step [s].
    """
    rows: list[TimeStepError] = []
    for step, margin, seconds in zip(steps, margins, cpu, strict=False):
        change = margin - margins[0]
        own = [row[np.isfinite(row)].mean() for row in change if np.isfinite(row).any()]
        if len(own) < TIME_STEPS.fewest:
            if len(rows) > 1:
                break
            raise TooFewMarginsError(
                f"study {name!r}: {len(own)} of {counted(len(margin), 'motion')} overturn the rock "
                "at a strength between 1/e and e times their own; a comparison needs "
                f"{TIME_STEPS.fewest}; give more motions, or scale them (motion.scale) to where "
                "the rock overturns"
            )
        # Where hardly any margin changes its cell of the halving, its rounding is what is known:
        # of a difference of two, width / sqrt(6).
        known = max(float(np.std(own, ddof=1)), _width() / np.sqrt(6)) if rows else 0.0
        error = known / np.sqrt(len(own))
        rows.append(
            TimeStepError(
                step, len(own), float(np.mean(own)), float(error), float(np.nanstd(change)), seconds
            )
        )
    return rows


def _width() -> float:
    """Of the range in which a margin lies after all halvings."""
    return 2 * TIME_STEPS.reach / 2.0**TIME_STEPS.halvings


def _replicated(trials: Sequence[Trial], seed: int, replicates: int) -> list[Trial]:
    """Some of the trials, each with its starts in turn."""
    out = []
    for i in drawn_trials(range(len(trials)), seed):
        trial = trials[i]
        start = trial.start or trial.scene.rock.start
        x, y, z = start.position
        for replicate in range(replicates):
            draws = np.random.default_rng([seed, i, replicate]).standard_normal(3)
            dx, dy, turn = (TIME_STEPS.place * draws).tolist()
            turned = multiply(yaw_quaternion(turn), start.orientation)
            out.append(
                replace(
                    trial,
                    start=Pose((x + dx, y + dy, z), turned),
                    output=rows_only(trial.output),
                )
            )
    check_trials(out)
    return out


def _margins(
    trials: list[Trial],
    threads: int | None,
    client: distributed.Client | None,
    done: Callable[[int], None],
) -> tuple[Array, float]:
    """Margins, NaN where none lies within the range or a trial failed, and CPU time a trial [s]."""
    halving = 0

    def overturns(logs: Array) -> Array:
        nonlocal halving
        scaled = [
            replace(trial, motion=trial.motion.scaled(float(factor)))
            for trial, factor in zip(trials, np.exp(logs), strict=True)
        ]
        found = run_batch(scaled, threads=threads, keep_logs=False, client=client)
        if found.provenance["interrupted"]:
            raise KeyboardInterrupt
        halving += 1
        done(halving)
        return np.where(found.judged, found.overturned, np.nan)

    began = time.process_time()
    ends = (-TIME_STEPS.reach, TIME_STEPS.reach)
    margin = seek_margins(overturns, (len(trials),), ends, TIME_STEPS.halvings)
    spent = (time.process_time() - began) / (len(trials) * TIME_STEPS.halvings)
    beyond = np.abs(margin) > TIME_STEPS.reach - _width()
    return np.where(beyond, np.nan, margin), spent
