"""Campaigns out of a scene and motions, in the form of measured ones."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign.campaign import (
    Campaign,
    CampaignTrial,
    MeasurementNoise,
    Series,
    Specimen,
)
from vsr2.config.study import MeshRock, Study
from vsr2.effects import apply_effects, chosen
from vsr2.errors import CampaignError
from vsr2.motion import Motion, Record
from vsr2.results import BatchResult, TrialLog, load_trial_log, quaternion_product

if TYPE_CHECKING:
    import distributed

    from vsr2.trial import Trial

Array = NDArray[np.float64]

JUDGED = ("ok", "tail_timeout")
"""Statuses with which a trial's outcome is known."""
UNFINISHED = ("cancelled", "not_run")
"""Statuses of trials that an interruption left; resuming runs them."""


def simulate_campaign(
    study: Study | Sequence[Trial],
    *,
    motions: Sequence[Motion] | None = None,
    effects: Mapping[str, Mapping[str, float | str]] | None = None,
    name: str | None = None,
    description: str = "",
    specimen: str = "rock",
    motion_ids: Sequence[str] | None = None,
    records: Sequence[Record] | None = None,
    sessions: Sequence[str] | int | None = None,
    noise: MeasurementNoise | None = None,
    seed: int = 0,
    series_every: int = 0,
    threads: int | None = None,
    progress: bool = False,
    resume: Campaign | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    client: distributed.Client | None = None,
) -> Campaign:
    """Run trials and write down what an experimenter would have measured.

    The motion drives the rock as it is; noise is added to what is written. It is normal, white in
    time, independent between trials and channels, and drawn for each trial from `seed` and the
    trial's place alone, so that leaving trials out changes none of the others. Noise of the
    largest tilt is cut at 0 and pi; noise of the orientation is a small rotation about a random
    axis. Trials are run in the order given, which is their `order`.

    Effects act on the trials, not on what is written of their motions: the motions are those that
    the study asks for, as an experimenter who does not know of the effect would have them.

    Args:
        study: a study, or trials made before, whose scenes and settings may differ.
        motions: with a study: drive these instead of its own.
        effects: to add, by name, each with its parameters; an effect of the study's own that is
            named here is replaced. Order and sessions are the campaign's.
        name: of the campaign; by default the study's, else "simulated".
        description: of the campaign.
        specimen: id of the rock.
        motion_ids: ground motion of each trial; by default the name of its motion. Give it where
            several trials are scalings of one motion.
        records: what the table's instruments recorded in each trial, before noise; by default
            displacement and acceleration as driven without effects.
        sessions: of each trial, or how many trials make a session; by default all are of session
            "1".
        noise: standard errors; None, and channels not stated: none.
        seed: of the noise and of what effects draw.
        series_every: keep a row of the series every so many time steps; 0: no series.
        threads: as in :func:`vsr2.simulation.run_batch`.
        progress: show a progress bar on standard error.
        resume: a campaign of the same call that was interrupted; only trials that it lacks are run.
        checkpoint: a folder in which finished trials are kept, as in
            :func:`vsr2.simulation.run_batch`: a call that was killed, made again, runs only the
            others and gives the same campaign. Not together with `resume`.
        client: of a Dask distributed cluster, as in :func:`vsr2.simulation.run_batch`.

    Returns:
        The campaign. Trials whose outcome cannot be trusted (failed, interrupted) have no outcome
        and carry their status as note. Its provenance holds study, seed, noise and versions.

    Raises:
        CampaignError: lists of another length than the trials, or `resume` is of another call or
            given with a checkpoint.
        ConfigError, GeometryError, MotionError, SimulationError: as `run_batch`, before any trial
            runs.
        ResultError: the checkpoint cannot be used, or belongs to other trials.
    """
    from vsr2.simulation import run_batch, study_trials

    wanted = dict(effects or {})
    if isinstance(study, Study):
        wanted = {**study.effects, **wanted}
        chosen(wanted)
        trials = study_trials(study.model_copy(update={"effects": {}}), motions=motions)
    elif motions is None:
        trials = list(study)
    else:
        raise CampaignError("motions can be given only together with a study")
    if not trials:
        raise CampaignError("no trials to simulate: give at least one")
    noise = MeasurementNoise() if noise is None else noise
    if sessions is None or isinstance(sessions, int):
        size = len(trials) if sessions is None else sessions
        if size < 1:
            raise CampaignError(f"sessions of {size} trials; give 1 or more")
        sessions = [str(i // size + 1) for i in range(len(trials))]
    for label, given in (("motion_ids", motion_ids), ("records", records), ("sessions", sessions)):
        if given is not None and len(given) != len(trials):
            raise CampaignError(f"{label} has {len(given)} entries for {len(trials)} trials")
    if resume is not None and checkpoint is not None:
        raise CampaignError("give either resume or checkpoint, not both")
    if series_every < 0 or seed < 0:
        raise CampaignError(f"series_every ({series_every}) and seed ({seed}) must be 0 or more")
    output = {
        "log_every": series_every,
        "log_settling": False,
        "contacts_every": 0,
        "contact_trials": None,
        "npy": False,
    }
    trials = [replace(trial, output=trial.output.model_copy(update=output)) for trial in trials]
    asked = trials
    trials = apply_effects(trials, wanted, sessions=sessions, seed=seed)
    digest = _digest(trials, noise, seed)
    ids = [f"T{i + 1:0{max(3, len(str(len(trials))))}d}" for i in range(len(trials))]
    kept = _finished(resume, digest)
    pending = [i for i, trial in enumerate(ids) if trial not in kept]
    result: BatchResult | None = None
    series: dict[int, Series] = {}

    def keep(index: int, log: TrialLog | None) -> None:
        if log is not None:
            i = pending[index]
            one = _series(log, noise, _generator(seed, i, 2))
            if one is not None:
                series[i] = one

    if pending:
        result = run_batch(
            [trials[i] for i in pending],
            threads=threads,
            progress=progress,
            keep_logs=False,
            on_trial=keep,
            checkpoint=checkpoint,
            client=client,
        )
        if checkpoint is not None and series_every:
            # Of trials that were finished before; there is no resumed campaign then.
            for i in range(len(trials)):
                if i not in series and result["status"][i] in JUDGED:
                    keep(i, load_trial_log(checkpoint, i))
    files, written = _records(asked, ids, records, noise, seed)
    rows: list[CampaignTrial] = []
    for i, trial in enumerate(asked):
        row = CampaignTrial(
            trial=ids[i],
            motion=trial.motion.name if motion_ids is None else motion_ids[i],
            session=sessions[i],
            order=i + 1,
            specimen=specimen,
            motion_file=files[i],
            pga=trial.motion.pga if records is None else None,
            pgv_pga=trial.motion.pgv_pga if records is None else None,
        )
        if ids[i] in kept:
            old = kept[ids[i]]
            row = replace(
                row,
                overturned=old.overturned,
                peak_tilt=old.peak_tilt,
                note=old.note,
                series=old.series,
            )
        elif result is not None:
            at = pending.index(i) if len(pending) < len(trials) else i
            row = _judged(row, result, at, noise, _generator(seed, i, 1), series.get(i))
        rows.append(row)
    rock = asked[0].scene.rock
    provenance: dict[str, Any] = {
        "digest": digest,
        "study": study.model_dump(mode="json") if isinstance(study, Study) else None,
        "seed": seed,
        "noise": asdict(noise),
        "series_every": series_every,
        "effects": {name: _finite(values) for name, values in wanted.items()},
    }
    if result is not None:
        facts = result.provenance.items()
        provenance |= {key: value for key, value in facts if key not in ("study", "effects")}
    elif resume is not None:
        provenance = dict(resume.provenance)
    return Campaign(
        name=name or (study.name if isinstance(study, Study) else "simulated"),
        description=description,
        trials=tuple(rows),
        motions=written,
        specimens={
            specimen: Specimen(
                description="simulated", mass=rock.mass.mass, model_file=_model(study)
            )
        },
        noise=noise,
        provenance=json.loads(json.dumps(provenance, default=str)),
    )


def _finite(values: Mapping[str, float | str]) -> dict[str, float | str | None]:
    """None where a value is infinite or NaN, which stands for none given."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def _generator(seed: int, trial: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, stream)))


def _digest(trials: Sequence[Trial], noise: MeasurementNoise, seed: int) -> str:
    """Of everything that decides what a trial gives."""
    from vsr2.simulation import plan_sha256

    content = [plan_sha256(trials), asdict(noise), seed]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _finished(resume: Campaign | None, digest: str) -> dict[str, CampaignTrial]:
    if resume is None:
        return {}
    if resume.provenance.get("digest") != digest:
        raise CampaignError(
            f"campaign {resume.name!r} was made from another study, seed or noise; simulate into a "
            "new folder, or overwrite it without resuming"
        )
    return {trial.trial: trial for trial in resume.trials if trial.note not in UNFINISHED}


def _judged(
    row: CampaignTrial,
    result: BatchResult,
    at: int,
    noise: MeasurementNoise,
    rng: np.random.Generator,
    series: Series | None,
) -> CampaignTrial:
    status, outcome = str(result["status"][at]), str(result["outcome"][at])
    note = "" if status == "ok" else status
    if status not in JUDGED or outcome == "failed":
        return replace(row, note=note or "failed")
    peak = float(result["peak_tilt"][at])
    if noise.peak_tilt:
        peak += noise.peak_tilt * float(rng.standard_normal())
    return replace(
        row,
        overturned=outcome == "overturned",
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


def _records(
    trials: Sequence[Trial],
    ids: Sequence[str],
    given: Sequence[Record] | None,
    noise: MeasurementNoise,
    seed: int,
) -> tuple[list[str], dict[str, Record]]:
    """Names of the trials' motion files, and the files: shared where nothing tells them apart."""
    noisy = bool(noise.displacement or noise.acceleration)
    files: list[str] = []
    out: dict[str, Record] = {}
    shared: dict[str | int, str] = {}
    for i, trial in enumerate(trials):
        source: str | int = trial.motion.sha256 if given is None else id(given[i])
        if not noisy and source in shared:
            files.append(shared[source])
            continue
        if given is None:
            motion = trial.motion
            record = Record(
                name=motion.name,
                sample_interval=motion.time_step,
                displacement=motion.displacement,
                acceleration=motion.acceleration,
            )
        else:
            record = given[i]
        file = ids[i] if noisy else _file_name(record.name, out)
        shared[source] = file
        files.append(file)
        out[file] = _recorded(record, file, noise, _generator(seed, i, 0))
    return files, out


def _recorded(
    record: Record, name: str, noise: MeasurementNoise, rng: np.random.Generator
) -> Record:
    draws = rng.standard_normal((2, record.size))
    displacement, acceleration = record.displacement, record.acceleration
    if displacement is not None and noise.displacement:
        displacement = displacement + noise.displacement * draws[0]
    if acceleration is not None and noise.acceleration:
        acceleration = acceleration + noise.acceleration * draws[1]
    return Record(
        name=name,
        sample_interval=record.sample_interval,
        displacement=displacement,
        acceleration=acceleration,
    )


def _file_name(name: str, taken: dict[str, Record]) -> str:
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:80].strip("._-") or "motion"
    lower = {other.lower() for other in taken}
    file, number = plain, 1
    while file.lower() in lower:
        number += 1
        file = f"{plain}-{number}"
    return file


def _model(study: Study | Sequence[Trial]) -> Path | None:
    if isinstance(study, Study) and isinstance(study.rock, MeshRock) and study.rock.scale == 1.0:
        return study.rock.file
    return None
