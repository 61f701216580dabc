"""One parameter set against all trials of a campaign: the unit of a calibration's cost."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vsr2 import _native
from vsr2.calibration.calibration_study import CalibrationStudy, study_values
from vsr2.calibration.evaluation_store import Evaluation, EvaluationStore, joined
from vsr2.campaign import Campaign
from vsr2.config.extended import Plain
from vsr2.config.motion_source import AllRecordings
from vsr2.config.study import Study
from vsr2.effects import apply_effects
from vsr2.ensemble import DEFAULT_NUISANCES
from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
from vsr2.ensemble.simulated.nuisance_draws import NuisanceDraws
from vsr2.ensemble.simulated.scene_effects import SceneEffects
from vsr2.errors import CampaignError, MotionError
from vsr2.motion import ChannelNoise, Motion, Noise, build_recorded_motion, channel_noise
from vsr2.results import has_journal, prepare_folder
from vsr2.scene import PedestalBody, RockBody, Scene, build_pedestal, build_rock
from vsr2.scene.placement import start_pose
from vsr2.simulation import plan_sha256, run_batch
from vsr2.trial import Trial, rows_only

if TYPE_CHECKING:
    import distributed

MAX_SAMPLES_HELD = 100_000_000
"""Samples of motions kept between evaluations: 2.4 GB."""
NUISANCES = (*DEFAULT_NUISANCES, *CONTACT_FAMILY)
"""What each replicate draws."""
RUNNING = "running"
"""Folder with the journal of the evaluation that is under way."""

Evaluate = Callable[[Mapping[str, Plain]], Evaluation]
"""Gives the predictions of a parameter set."""


class CalibrationInterrupted(KeyboardInterrupt):
    """Ctrl-C between or within evaluations; what is finished is on disk."""


def usable_trials(campaign: Campaign) -> Campaign:
    """The trials that can be simulated and judged: with a motion and an outcome.

    Raises:
        CampaignError: there is none.
    """
    kept = [t.motion_file is not None and t.overturned is not None for t in campaign.trials]
    if not any(kept):
        raise CampaignError(
            f"campaign {campaign.name!r}: no trial has both a motion and an outcome"
        )
    return campaign.select(kept)


def campaign_sha256(campaign: Campaign) -> str:
    """Hash of ids, outcomes and motions of a campaign's trials."""
    digest = hashlib.sha256()
    for trial in campaign.trials:
        text = repr((trial.trial, trial.motion, trial.motion_file, trial.overturned))
        digest.update(text.encode() + b"\0")
    for name, record in sorted(campaign.motions.items()):
        digest.update(f"{name}\0{record.sample_interval!r}".encode())
        for channel in (record.displacement, record.velocity, record.acceleration):
            digest.update(b"-" if channel is None else np.ascontiguousarray(channel).tobytes())
    return digest.hexdigest()


def _noises(campaign: Campaign) -> dict[str, ChannelNoise]:
    """Noise of each motion's channels; one without rest has the median noise of the others.

    Raises:
        MotionError: no motion has any rest, or one lacks a channel.
    """
    found: dict[str, ChannelNoise] = {}
    refused: dict[str, MotionError] = {}
    for name, record in campaign.motions.items():
        try:
            found[name] = channel_noise(record)
        except MotionError as error:
            if record.displacement is None or record.acceleration is None:
                raise
            refused[name] = error
    if not found:
        raise next(iter(refused.values()))

    def median(channel: str) -> Noise:
        noises = [getattr(one, channel) for one in found.values()]
        return Noise(
            *(
                float(np.median([getattr(one, key) for one in noises]))
                for key in ("deviation", "share", "persistence")
            )
        )

    typical = ChannelNoise(median("displacement"), median("acceleration"))
    return {name: found.get(name, typical) for name in campaign.motions}


class Evaluator:
    """Simulates a campaign's trials under parameter sets, each set and replicate once.

    A replicate draws the nuisances of :func:`vsr2.predict`, with the seed of the study: equal ones
    for all sets.

    Args:
        study: what is calibrated.
        campaign: :func:`usable_trials` of one.
        store: where evaluations are kept and found.
        folder: of the calibration; an evaluation under way keeps its journal below it.
        threads: as in :func:`vsr2.simulation.run_batch`.
        client: as there.

    Attributes:
        simulated: runs of a set that were simulated, rather than found.
    """

    def __init__(
        self,
        study: CalibrationStudy,
        campaign: Campaign,
        store: EvaluationStore,
        folder: Path,
        *,
        threads: int | None = None,
        client: distributed.Client | None = None,
    ) -> None:
        self._study = study
        self._campaign = campaign
        self._store = store
        self._folder = folder
        self._threads = threads
        self._client = client
        self._bodies: dict[str, tuple[RockBody, PedestalBody]] = {}
        self._motions: OrderedDict[str, dict[str, Motion]] = OrderedDict()
        self._sha256 = campaign_sha256(campaign)
        self._order = list(campaign.relative_order)
        self._sessions = [trial.session for trial in campaign.trials]
        motions = [trial.motion for trial in campaign.trials]
        seed = study.study.seed
        self._draws = NuisanceDraws(NUISANCES, self._order, self._sessions, motions, seed)
        self.simulated = 0

    def __call__(
        self,
        values: Mapping[str, Plain],
        *,
        among: NDArray[np.bool_] | None = None,
        keys: Mapping[str, Plain] | None = None,
    ) -> Evaluation:
        """The predictions of a parameter set.

        Args:
            values: by parameter.
            among: trials that are wanted, shape (trials,); None: all. Others may be unknown.
            keys: values of further keys of the study, by dotted key.

        Raises:
            CalibrationInterrupted: Ctrl-C; the next call with the same set goes on.
            ConfigError, GeometryError, MotionError, SimulationError: a set that cannot be run.
        """
        study = self._study.with_values(study_values(self._study, dict(values)) | dict(keys or {}))
        bodies = self._placed(study)
        wanted = np.ones(len(self._campaign), dtype=np.bool_) if among is None else among
        count = self._study.own.replicates
        numbers = range(1, count + 1) if count > 1 else (0,)
        runs = []
        for replicate in numbers:
            key = self._key(study, bodies, replicate)
            found = self._store.by_key(key)
            if found is None or found.lacking(wanted).any():
                trials = self._trials(study, bodies, replicate)
                found = self._run(key, dict(values), trials, wanted)
            runs.append(replace(found, values=dict(values)))
        return runs[0] if count == 1 else joined(runs, self._campaign.overturned == 1)

    def _placed(self, study: Study) -> tuple[RockBody, PedestalBody]:
        """Rock and pedestal, read once; the rock stands where the study says."""
        clearance = 2.0 * study.engine.collision_margin
        rock = study.rock.model_dump_json(exclude={"start"})
        key = f"{rock}\0{study.pedestal.model_dump_json()}\0{clearance!r}"
        if key not in self._bodies:
            pedestal = build_pedestal(study.pedestal)
            self._bodies[key] = (
                build_rock(study.rock, pedestal, clearance=clearance),
                pedestal,
            )
        body, pedestal = self._bodies[key]
        start = start_pose(study.rock.start, body.parts, body.mass, pedestal, clearance=clearance)
        return replace(body, start=start), pedestal

    def _key(self, study: Study, bodies: tuple[RockBody, PedestalBody], replicate: int) -> str:
        """Hash of the settings that predictions depend on; replicate 0 has no draws.

        It is known without building any motion, so that a resumed search is quick; the plan's
        hash, which needs them, is kept beside it.
        """
        data = study.model_dump(mode="json", exclude={"name", "seed", "output"})
        if study.effects or replicate:
            data["seed"] = study.seed  # of what they draw
        for section in ("rock", "pedestal"):
            data[section].pop("file", None)
        for place in ("folder", "pattern", "mode"):
            data["motion"].pop(place, None)
        content: list[Any] = [
            str(_native.build_facts()["version"]),
            self._sha256,
            data,
            [body.sha256 for body in bodies],
        ]
        if replicate:
            content.append([replicate, [one.to_json() for one in NUISANCES]])
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def _trials(
        self, study: Study, bodies: tuple[RockBody, PedestalBody], replicate: int
    ) -> list[Trial]:
        """Of a replicate; 0: as the study has them."""
        scene = Scene(*bodies, study.engine, study.contact)
        motions = self._driven(study)
        output = rows_only(study.output)
        trials = [
            Trial.of_study(
                study, scene, motions[str(trial.motion_file)], name=trial.trial, output=output
            )
            for trial in self._campaign.trials
        ]
        if replicate:
            return self._drawn(study, trials, replicate)
        return apply_effects(
            trials,
            study.effects,
            relative_order=self._order,
            sessions=self._sessions,
            seed=study.seed,
        )

    def _drawn(self, study: Study, trials: list[Trial], replicate: int) -> list[Trial]:
        """With the study's effects and nuisances, as a simulated campaign has them."""
        own, every = SceneEffects(study), range(len(trials))
        nominal = own.drawn_by([study.seed, 0, 0])
        ((_, first),) = self._draws.applied(trials, trials[0], 0, 0, [0], nominal)
        drawn = own.drawn_by([study.seed, replicate, 1])
        made = dict(self._draws.applied(trials, first, replicate, 1, every, drawn))
        return [made[i] for i in every]

    def _driven(self, study: Study) -> dict[str, Motion]:
        """The motions by file; a scale is put on those of scale 1, which are kept."""
        source = study.motion
        assert isinstance(source, AllRecordings)
        filter_text = "" if source.filter is None else source.filter.model_dump_json()
        key = f"{source.channel}\0{filter_text}\0{study.engine.time_step!r}"
        if key in self._motions:
            self._motions.move_to_end(key)
        else:
            noises = _noises(self._campaign) if source.channel == "fused" else {}
            self._motions[key] = {
                name: build_recorded_motion(
                    record,
                    study.engine.time_step,
                    channel=source.channel,
                    filter=source.filter,
                    noise=noises.get(name),
                    name=name,
                )
                for name, record in self._campaign.motions.items()
            }
            self._forget_old_motions()
        motions = self._motions[key]
        if source.scale == 1.0:
            return motions
        return {name: one.scaled(source.scale, name=name) for name, one in motions.items()}

    def _forget_old_motions(self) -> None:
        def held() -> int:
            return sum(
                m.displacement.size for some in self._motions.values() for m in some.values()
            )

        while len(self._motions) > 1 and held() > MAX_SAMPLES_HELD:
            self._motions.popitem(last=False)

    def _run(
        self,
        key: str,
        values: dict[str, Plain],
        trials: list[Trial],
        wanted: NDArray[np.bool_],
    ) -> Evaluation:
        plan = plan_sha256(trials)
        found = self._store.by_plan(plan)
        missing = wanted if found is None else found.lacking(wanted)
        predicted = np.full(len(trials), np.nan)
        seconds = 0.0
        if missing.any():
            started = time.monotonic()
            chosen = [trial for trial, needed in zip(trials, missing, strict=True) if needed]
            predicted[missing] = self._simulate(chosen)
            seconds = time.monotonic() - started
            self.simulated += 1
        self._store.keep(key, Evaluation(values, predicted, plan, seconds, missing))
        # The journal goes only now: killed in between, the next run reads it instead.
        shutil.rmtree(self._folder / RUNNING, ignore_errors=True)
        done = self._store.by_key(key)
        assert done is not None
        return done

    def _simulate(self, trials: list[Trial]) -> NDArray[np.float64]:
        checkpoint = self._folder / RUNNING / plan_sha256(trials)[:16]
        if not has_journal(checkpoint):
            # Of a set that an earlier run did not finish, and this one does not begin with.
            shutil.rmtree(self._folder / RUNNING, ignore_errors=True)
            prepare_folder(checkpoint)
        result = run_batch(
            trials,
            threads=self._threads,
            keep_logs=False,
            checkpoint=checkpoint,
            client=self._client,
        )
        if result.provenance["interrupted"]:
            raise CalibrationInterrupted
        return np.where(result.judged, result.overturned.astype(np.float64), np.nan)
