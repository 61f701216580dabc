"""Campaigns out of a scene and motions, in the form of measured ones."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2.argument_names import checked_names
from vsr2.campaign.campaign import (
    Campaign,
    CampaignTrial,
    MeasurementNoise,
    Specimen,
)
from vsr2.campaign.series import Series
from vsr2.config.problems import shown
from vsr2.config.seeds import checked_seed
from vsr2.config.study import MeshRock, Study
from vsr2.effects import apply_effects, chosen
from vsr2.errors import CampaignError
from vsr2.motion import Motion, Record
from vsr2.one_line import counted
from vsr2.results import (
    JUDGED,
    BatchResult,
    Outcome,
    Status,
    TrialLog,
    load_trial_log,
)
from vsr2.scene.rotation import quaternion_product
from vsr2.trial import Trial, rows_only

if TYPE_CHECKING:
    import distributed


Array = NDArray[np.float64]

SPECIMEN = "rock"
"""Id of the specimen of a simulated campaign."""


@checked_names(CampaignError)
@dataclass(frozen=True, eq=False)
class RunOptions:
    """How trials are run, which changes nothing in what they give.

    Attributes:
        threads, progress, checkpoint, client: as :func:`vsr2.simulation.run_batch` takes them. With
            a checkpoint a call that was killed, made again, runs only the other trials and gives
            the same campaign.
        made: a campaign that the same call gave before: it is given back, and nothing is run.
    """

    threads: int | None = None
    progress: bool = False
    checkpoint: str | os.PathLike[str] | None = None
    client: distributed.Client | None = None
    made: Campaign | None = None


RUN = RunOptions()


@checked_names(CampaignError)
def simulate_campaign(
    study: Study | Sequence[Trial],
    *,
    effects: Mapping[str, Mapping[str, float | str]] | None = None,
    motion_ids: Sequence[str] | None = None,
    sessions: Sequence[str] | int | None = None,
    noise: MeasurementNoise | None = None,
    seed: int = 0,
    series_every: int = 0,
    run: RunOptions = RUN,
) -> Campaign:
    """Run trials and write down what an experimenter would have measured.

    The motion drives the rock as it is; :class:`MeasurementNoise` is added to what is written,
    drawn for each trial from `seed` and its index alone. Effects act on the trials, not on what is
    written of their motions, which an experimenter who does not know of the effect would have so.
    Trials are run in the order given, which is their `order`.

    Args:
        study: a study, or trials made before, whose scenes and settings may differ. The campaign
            has the study's name, else "simulated".
        effects: to add, by name, each with its parameters; an effect of the study's own that is
            named here is replaced. Order and sessions are the campaign's.
        motion_ids: ground motion of each trial, where several are scalings of one; by default the
            name of its motion.
        sessions: of each trial, or how many trials make a session; by default all are of "1".
        noise: standard errors; None, and channels not stated: none.
        seed: of the noise and of what effects draw.
        series_every: keep a row of the series every so many time steps; 0: no series.
        run: threads, progress, checkpoint and the like.

    Returns:
        The campaign. Failed and interrupted trials have no outcome; :func:`trial_statuses` tells
        how each ended, and its note says so to people.

    Raises:
        CampaignError: lists of another length than the trials, no whole numbers, or `run.made` is
            of another call.
        Vsr2Error: as `run_batch`.
    """
    series_every = _integer(series_every, "series_every", 0)
    seed = checked_seed(seed, CampaignError)
    noise = _noise(noise)
    asked, wanted = _asked(study, dict(effects or {}), series_every)
    names = _motion_ids(motion_ids, asked)
    held = _sessions(sessions, len(asked))
    trials = apply_effects(asked, wanted, sessions=held, seed=seed)
    digest = _digest(trials, noise, seed)
    if run.made is not None:
        if run.made.provenance.get("digest") != digest:
            raise CampaignError(
                f"campaign {run.made.name!r} was made from another study, seed or noise; simulate "
                "into a new folder, or replace it with `--overwrite` in place of `--resume`"
            )
        return run.made
    rows, written = _unjudged(asked, names, held, noise, seed)
    result, series = _run(trials, noise, seed, run)
    ends = {}
    for i, row in enumerate(rows):
        if result["status"][i] != Status.ok:
            ends[row.trial] = str(result["status"][i])
        rows[i] = _judged(
            row, result, i, noise, _generator(seed, i, _Draws.MEASURED), series.get(i)
        )
    facts = _facts(study, wanted, noise, seed, series_every)
    provenance = {"digest": digest, **facts, **result.provenance, **facts, "statuses": ends}
    return Campaign(
        name=study.name if isinstance(study, Study) else "simulated",
        trials=tuple(rows),
        motions=written,
        specimens={SPECIMEN: Specimen("simulated", asked[0].scene.rock.mass.mass, _model(study))},
        noise=noise,
        provenance=json.loads(json.dumps(provenance, default=str)),
    )


def _motion_ids(given: Sequence[str] | None, asked: Sequence[Trial]) -> Sequence[str]:
    """One a trial; none given: the names of their motions."""
    names = [trial.motion.name for trial in asked] if given is None else given
    if len(names) != len(asked):
        raise CampaignError(
            f"motion_ids has {len(names)} entries for {counted(len(asked), 'trial')}"
        )
    return names


def _asked(
    study: Study | Sequence[Trial], effects: dict[str, Any], series_every: int
) -> tuple[list[Trial], dict[str, Mapping[str, float | str]]]:
    """Trials without the effects, logging what the campaign keeps, and all effects to add."""
    from vsr2.simulation import study_trials

    if isinstance(study, Study):
        effects = {**study.effects, **effects}
        chosen(effects)  # refused before any mesh is read
        trials = study_trials(study.model_copy(update={"effects": {}}))
    else:
        trials = list(study)
        wrong = [one for one in trials if not isinstance(one, Trial)]
        if wrong or isinstance(study, str):
            got = study if isinstance(study, str) else wrong[0]
            raise CampaignError(
                f"simulate_campaign: got {shown(got)}, a {type(got).__name__}; give a Study, as "
                "`load_study` reads it, or trials"
            )
    if not trials:
        raise CampaignError("no trials to simulate: give at least one")
    return [replace(one, output=rows_only(one.output, series_every)) for one in trials], effects


def _sessions(sessions: Sequence[str] | int | None, count: int) -> Sequence[str]:
    if sessions is not None and not isinstance(sessions, int | float | np.number | str):
        if len(sessions) != count:
            raise CampaignError(f"sessions has {len(sessions)} entries for {count} trials")
        return sessions
    size = count if sessions is None else _integer(sessions, "trials of a session", 1)
    return [str(i // size + 1) for i in range(count)]


def _integer(given: Any, what: str, least: int) -> int:
    """A whole number as Python's own."""
    integral = isinstance(given, Integral) and not isinstance(given, bool)
    number = int(given) if integral else -1
    if number < least:
        raise CampaignError(f"{what}: {shown(given)}; give a whole number, {least} or more")
    return number


def _run(
    trials: Sequence[Trial],
    noise: MeasurementNoise,
    seed: int,
    options: RunOptions,
) -> tuple[BatchResult, dict[int, Series]]:
    """Results of the trials, and their series by index."""
    from vsr2.simulation import run_batch

    series: dict[int, Series] = {}

    def keep(index: int, log: TrialLog | None) -> None:
        one = None if log is None else _series(log, noise, _generator(seed, index, _Draws.SERIES))
        if one is not None:
            series[index] = one

    result = run_batch(
        trials,
        threads=options.threads,
        progress=options.progress,
        keep_logs=False,
        on_trial=keep,
        checkpoint=options.checkpoint,
        client=options.client,
    )
    if options.checkpoint is not None and trials[0].output.log_every:
        # Of trials that were finished before.
        for i in range(len(trials)):
            if i not in series and result["status"][i] in JUDGED:
                keep(i, load_trial_log(options.checkpoint, i))
    return result, series


def _facts(
    study: Study | Sequence[Trial],
    effects: Mapping[str, Mapping[str, float | str]],
    noise: MeasurementNoise,
    seed: int,
    series_every: int,
) -> dict[str, Any]:
    """For the provenance; None where a value of an effect is infinite or NaN: none given."""
    return {
        "study": study.model_dump(mode="json") if isinstance(study, Study) else None,
        "seed": seed,
        "noise": asdict(noise),
        "series_every": series_every,
        "effects": {
            name: {
                key: None if isinstance(value, float) and not math.isfinite(value) else value
                for key, value in values.items()
            }
            for name, values in effects.items()
        },
    }


class _Draws(IntEnum):
    """Streams of random numbers of a trial."""

    RECORDED = 0
    MEASURED = 1
    SERIES = 2


def _generator(seed: int, trial: int, stream: _Draws) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, stream)))


def _noise(asked: MeasurementNoise | None) -> MeasurementNoise:
    """What simulated measurements have noise of."""
    noise = asked or MeasurementNoise()
    if noise.yaw is not None or noise.slip is not None:
        raise CampaignError(
            "noise of yaw and slip: simulated series have orientation and position instead; give "
            "their noise"
        )
    return noise


def _digest(trials: Sequence[Trial], noise: MeasurementNoise, seed: int) -> str:
    """Of everything that decides what a trial gives."""
    from vsr2.simulation import plan_sha256

    content = [plan_sha256(trials), asdict(noise), seed]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def trial_statuses(campaign: Campaign) -> dict[str, Status]:
    """How each trial of a simulated campaign ended, by its id.

    Raises:
        CampaignError: the campaign was not simulated, or does not hold how its trials ended.
    """
    ends = campaign.provenance.get("statuses")
    if not isinstance(ends, Mapping) or not set(ends.values()) <= set(Status.__members__):
        raise CampaignError(
            f"campaign {campaign.name!r}: its provenance does not say how its trials ended; "
            "simulate it again with this VSR2"
        )
    return {trial.trial: Status[ends.get(trial.trial, Status.ok)] for trial in campaign.trials}


def _judged(
    row: CampaignTrial,
    result: BatchResult,
    at: int,
    noise: MeasurementNoise,
    rng: np.random.Generator,
    series: Series | None,
) -> CampaignTrial:
    status, outcome = str(result["status"][at]), str(result["outcome"][at])
    note = "" if status == Status.ok else status
    if status not in JUDGED or outcome == Outcome.failed:
        return replace(row, note=note or outcome)
    peak = float(result["peak_tilt"][at])
    if noise.peak_tilt:
        peak += noise.peak_tilt * float(rng.standard_normal())
    if noise.peak_tilt_relative:
        peak *= float(np.exp(noise.peak_tilt_relative * rng.standard_normal()))
    return replace(
        row,
        overturned=outcome == Outcome.overturned,
        peak_tilt=float(np.clip(peak, 0.0, np.pi)) if np.isfinite(peak) else None,
        note=note,
        series=series,
    )


def _series(log: TrialLog, noise: MeasurementNoise, rng: np.random.Generator) -> Series | None:
    kept = (log.time >= 0) & np.isfinite(log.state).all(axis=1)
    if not kept.any():
        return None
    rows = int(kept.sum())
    tilt = log.tilt[kept]
    position, orientation = log.from_rest(kept)
    # Drawn whether used or not, so that one channel's noise does not depend on another's.
    draws = rng.standard_normal((rows, 7))
    if noise.tilt:
        tilt = tilt + noise.tilt * draws[:, 0]
    if noise.position:
        position = position + noise.position * draws[:, 1:4]
    if noise.orientation:
        half = 0.5 * noise.orientation * draws[:, 4:7]
        small = np.concatenate([half, np.ones((rows, 1))], axis=1)
        orientation = quaternion_product(
            small / np.linalg.norm(small, axis=1, keepdims=True), orientation
        )
    return Series(
        time=log.time[kept],
        tilt=tilt,
        position=position,
        orientation=orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
        noise_tilt=noise.tilt,
        noise_position=noise.position,
        noise_orientation=noise.orientation,
    )


def _unjudged(
    trials: Sequence[Trial],
    motions: Sequence[str],
    sessions: Sequence[str],
    noise: MeasurementNoise,
    seed: int,
) -> tuple[list[CampaignTrial], dict[str, Record]]:
    """Rows without outcomes, and the motion files: equal motions have one, unless noisy."""
    noisy = bool(noise.displacement or noise.acceleration)
    digits = max(3, len(str(len(trials))))
    rows: list[CampaignTrial] = []
    files: dict[str, Record] = {}
    file_of: dict[str, str] = {}
    names = _FileNames()
    for i, trial in enumerate(trials):
        motion, name = trial.motion, f"T{i + 1:0{digits}d}"
        file = None if noisy else file_of.get(motion.sha256)
        if file is None:
            file = name if noisy else names.free(motion.name)
            file_of[motion.sha256] = file
            files[file] = _recorded(motion, file, noise, _generator(seed, i, _Draws.RECORDED))
        rows.append(
            CampaignTrial(
                trial=name,
                motion=motions[i],
                session=sessions[i],
                order=i + 1,
                specimen=SPECIMEN,
                motion_file=file,
                pga_g=motion.pga_g,
                pgv_pga_s=motion.pgv_pga_s,
            )
        )
    return rows, files


def _recorded(
    motion: Motion, name: str, noise: MeasurementNoise, rng: np.random.Generator
) -> Record:
    """What the table's instruments record of a motion."""
    draws = rng.standard_normal((2, motion.displacement.size))
    displacement, acceleration = motion.displacement, motion.acceleration
    if noise.displacement:
        displacement = displacement + noise.displacement * draws[0]
    if noise.acceleration:
        acceleration = acceleration + noise.acceleration * draws[1]
    return Record(name, motion.time_step, displacement=displacement, acceleration=acceleration)


class _FileNames:
    """File names out of names of motions, each once whatever its case."""

    def __init__(self) -> None:
        self.taken: set[str] = set()
        self._last: dict[str, int] = {}

    def free(self, name: str) -> str:
        """A name that was not given yet: plain, or with the least free number behind it."""
        plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:80].strip("._-") or "motion"
        # Numbers up to the last given one are taken, as names are never given back.
        file, number = plain, self._last.get(plain.lower(), 1)
        while file.lower() in self.taken:
            number += 1
            file = f"{plain}-{number}"
        self._last[plain.lower()] = number
        self.taken.add(file.lower())
        return file


def _model(study: Study | Sequence[Trial]) -> Path | None:
    if isinstance(study, Study) and isinstance(study.rock, MeshRock) and study.rock.scale == 1.0:
        return study.rock.file
    return None
