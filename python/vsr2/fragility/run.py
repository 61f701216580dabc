"""From a fragility study to its result: trials, intensities, fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.intervals import INTERVALS
from vsr2.config.extended import ExtendedStudy
from vsr2.config.problems import shown
from vsr2.effects import apply_effects
from vsr2.errors import ResultError, SimulationError
from vsr2.fragility.fit import FragilityFit, fit_fragility
from vsr2.fragility.settings import FIT, FragilitySettings, FragilityStudy
from vsr2.fragility.trials import PlannedTrial, effect_seed, fragility_trials
from vsr2.motion import Motion, intensity_measures
from vsr2.one_line import OneLine
from vsr2.results import BatchResult, finished_plan, load_result
from vsr2.simulation import plan_sha256, run_batch
from vsr2.simulation.run_constants import run_constants
from vsr2.trial import Trial

if TYPE_CHECKING:
    import distributed

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class FragilityResult(OneLine):
    """What a fragility study found.

    Attributes:
        settings: measures, azimuths, replicates, perturbations.
        batch: one row a trial.
        planned: what sets each trial apart.
        measures: every intensity measure of each trial's motion as driven, before effects, by name,
            shape (trials,).
        used: trials with an outcome and positive measures, shape (trials,).
        curves: for every measure over all azimuths, by name.
        azimuth_curves: the same of each azimuth alone, by (name, azimuth); empty for one azimuth.
        surface: in both measures; None where there is one.
        provenance: of the batch, with the settings.
    """

    settings: FragilitySettings
    batch: BatchResult
    planned: tuple[PlannedTrial, ...]
    measures: Mapping[str, Array]
    used: NDArray[np.bool_]
    curves: Mapping[str, FragilityFit]
    azimuth_curves: Mapping[tuple[str, float], FragilityFit]
    surface: FragilityFit | None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def facts(self) -> Mapping[str, object]:
        """Trials, how many overturned, and the measures that have a curve."""
        return {
            "trials": len(self.batch),
            "overturned": int(self.overturned.sum()),
            "curves": list(self.curves),
        }

    @property
    def overturned(self) -> NDArray[np.bool_]:
        """Of each trial, shape (trials,)."""
        return self.batch.overturned

    @property
    def azimuth(self) -> Array:
        """Of each trial [degree], shape (trials,)."""
        return np.array([one.azimuth for one in self.planned])

    @property
    def motion(self) -> NDArray[np.str_]:
        """Ground motion of each trial, shape (trials,)."""
        return np.array([one.motion for one in self.planned], dtype=np.str_)


def run_fragility(
    study: FragilityStudy,
    folder: str | Path | None = None,
    *,
    threads: int | None = None,
    progress: bool = False,
    client: distributed.Client | None = None,
) -> FragilityResult | BatchResult:
    """Run a fragility study's trials and fit its curves.

    Args:
        study: what is run.
        folder: for the journal of finished trials, made ready by
            :func:`vsr2.results.prepare_folder`; the same call there runs the others only. None: no
            journal.
        threads: as in :func:`vsr2.simulation.run_batch`; no result depends on it.
        progress: show a progress bar on standard error.
        client: run on its Dask cluster; None: in threads of this process.

    Returns:
        The result; where Ctrl-C interrupted, the batch as far as it came.

    Raises:
        GeometryError, MotionError, SimulationError: the study cannot be run.
        ResultError: the folder cannot be used, or no trial can be judged.
    """
    if not isinstance(study, ExtendedStudy):
        raise SimulationError(
            f"run_fragility: got {shown(study)}, a {type(study).__name__}; give what "
            "`load_fragility` reads from a file"
        )
    asked, planned = fragility_trials(study)
    batch = run_batch(
        with_effects(study, asked, planned),
        threads=threads,
        progress=progress,
        keep_logs=False,
        checkpoint=folder,
        client=client,
    )
    if batch.provenance["interrupted"]:
        return batch
    return _fitted(study, batch, planned, [trial.motion for trial in asked])


def is_fragility_finished(study: FragilityStudy, folder: str | Path) -> bool:
    """Whether a folder holds the finished result of a study, with these settings.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: the study cannot be run.
        ResultError: the folder holds a result that cannot be read.
    """
    plan = finished_plan(folder)
    if not plan or plan != plan_sha256(with_effects(study, *fragility_trials(study))):
        return False
    settings = load_result(folder, logs=False).provenance.get("fragility")
    return bool(settings == study.own.fragility.model_dump(mode="json"))


def with_effects(
    study: FragilityStudy, trials: list[Trial], planned: list[PlannedTrial]
) -> list[Trial]:
    """The trials with the study's effects in them.

    Every replicate is a campaign of its own to them, with its own draws, so that more replicates
    leave the earlier ones as they are.

    Raises:
        ConfigError, GeometryError, MotionError, SimulationError: one cannot be applied.
    """
    changed = list(trials)
    for replicate in sorted({one.replicate for one in planned}):
        chosen = [i for i, one in enumerate(planned) if one.replicate == replicate]
        seed = effect_seed(study.study.seed, replicate)
        some = apply_effects([trials[i] for i in chosen], study.study.effects, seed=seed)
        for i, trial in zip(chosen, some, strict=True):
            changed[i] = trial
    return changed


def _fitted(
    study: FragilityStudy,
    batch: BatchResult,
    planned: list[PlannedTrial],
    motions: list[Motion],
) -> FragilityResult:
    """Fit the curves of a finished batch."""
    settings = study.own.fragility
    measures = _measures(motions)
    used = batch.judged
    for name in settings.measures:
        used &= measures[name] > 0
    if not used.any():
        raise ResultError("no trial has an outcome and positive intensities: nothing to fit")
    overturned = batch.overturned
    groups = np.array([one.motion for one in planned], dtype=np.str_)
    azimuth = np.array([one.azimuth for one in planned])

    def fit(names: tuple[str, ...], chosen: NDArray[np.bool_]) -> FragilityFit:
        return fit_fragility(
            np.stack([measures[name][chosen] for name in names], axis=1),
            overturned[chosen],
            groups[chosen],
            names=names,
            level=settings.level,
            surface=settings.surface,
        )

    azimuths = list(dict.fromkeys(azimuth.tolist()))
    single = [(name, turn) for name in settings.measures for turn in azimuths]
    return FragilityResult(
        settings=settings,
        batch=batch,
        planned=tuple(planned),
        measures=measures,
        used=used,
        curves={name: fit((name,), used) for name in settings.measures},
        azimuth_curves={
            (name, turn): fit((name,), used & (azimuth == turn))
            for name, turn in single
            if len(azimuths) > 1 and (used & (azimuth == turn)).any()
        },
        surface=fit(settings.measures, used) if len(settings.measures) == 2 else None,
        provenance=dict(batch.provenance)
        | {
            "study": study.study.model_dump(mode="json"),
            "fragility": settings.model_dump(mode="json"),
            "constants": fragility_constants(),
        },
    )


def fragility_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that curves rest on, by what they are of."""
    return {**run_constants(), "fit": asdict(FIT), "intervals": asdict(INTERVALS)}


def _measures(motions: list[Motion]) -> dict[str, Array]:
    """Each measure of each trial's motion; equal motions are measured once."""
    known: dict[int, dict[str, float]] = {}
    for motion in motions:
        if id(motion) not in known:
            known[id(motion)] = intensity_measures(motion).as_dict()
    names = next(iter(known.values()))
    return {name: np.array([known[id(motion)][name] for motion in motions]) for name in names}
