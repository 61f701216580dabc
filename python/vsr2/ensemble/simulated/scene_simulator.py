"""The campaign's trials simulated in full: the scene of a study, the native core, the library."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign
from vsr2.config.motion_source import AllRecordings, Filter, SingleRecording
from vsr2.config.study import Study
from vsr2.effects import Effect, in_order, with_effects
from vsr2.effects.apply import MadeEarlier, Sought, sees_motion
from vsr2.ensemble.observed.features import (
    REST_FEATURES,
    SERIES,
    TILT_FEATURES,
    Sampling,
    rest_features,
    tilt_features,
)
from vsr2.ensemble.observed.observations import series_sampling
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.nuisance_draws import Caused, NuisanceDraws
from vsr2.ensemble.simulated.scene_effects import SceneEffects
from vsr2.ensemble.simulated.simulator import (
    FINE_SOLVER,
    HALF_STEP,
    PERTURBED,
    SIMULATION,
    Effects,
    Request,
    Responses,
)
from vsr2.errors import DiagnosisError, GeometryError, Vsr2Error
from vsr2.motion import Motion, Record, build_recorded_motion
from vsr2.results import Outcome, TrialLog
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion

if TYPE_CHECKING:
    import distributed

    from vsr2.trial import Trial

Array = NDArray[np.float64]
_logger = logging.getLogger(__name__)

HYPOTHESES = Hypotheses()
"""All registered effects, and the default nuisances."""
OF_RECORDS = SingleRecording | AllRecordings
KEPT_SCENES = 2
"""Scenes of which it is kept what effects made of bodies and motions: those asked for last."""
KEPT_MOTIONS = 64
"""Trials of each whose motions are kept."""


class SceneSimulator:
    """Simulates a campaign's trials with the native core.

    Args:
        campaign: every trial needs a motion; in order of execution.
        study: of the nominal scene, its effects included; its own motions are not used, but how
            recordings are turned into the driven motion is (channel, filter, scale, drive).
        hypotheses: effects and nuisances.
        series: also draw features from the tilt's series; a sampling: so, where the campaign has no
            series.
        threads: of the native core; None: all.
        client: of a Dask cluster that runs the trials.
        seed: of nuisances and of what belongs to single trials.

    Attributes:
        library: effects that this scene can have.
        excluded: those that are not looked for.
        unavailable: those that it cannot have, with the error; among them those that act in the
            scene already and cannot act twice.
        nuisances: that are drawn.
        nuisance_names: of those drawn once a campaign.
        identity: hash of scene and its effects, motions, schedule, nuisances and seed, but not of
            the library: a simulation is asked for by the values of what acts.
        variants: half the time step, twice the solver's iterations.

    Raises:
        DiagnosisError: a trial without motion, an unknown name in `hypotheses.exclude`, or a
            nuisance that cannot act beside the scene's own effect.
        ConfigError: an effect of the scene that cannot be used.
        GeometryError, MotionError, SimulationError: the scene or a motion cannot be used.
    """

    def __init__(
        self,
        campaign: Campaign,
        study: Study,
        *,
        hypotheses: Hypotheses = HYPOTHESES,
        series: bool | Sampling = False,
        threads: int | None = None,
        client: distributed.Client | None = None,
        seed: int = 0,
    ) -> None:
        offered = hypotheses.offered
        self.nuisances = (*hypotheses.nuisances, *hypotheses.contact_family)
        self.variants = (HALF_STEP, FINE_SOLVER)
        self._series = bool(series)
        self._threads = threads
        self._client = client
        self._seed = seed
        self._campaign, self._study = campaign, study
        asked = series if isinstance(series, Sampling) else None
        self._sampling = series_sampling(campaign) or asked if series else None
        self._measured = () if self._sampling is None else (self._sampling,)
        interval = SERIES.row if self._sampling is None else self._sampling.interval
        self._row = min(SERIES.row, interval) if series else None
        self._order = list(campaign.relative_order)
        self._sessions = [trial.session for trial in campaign.trials]
        motions = [trial.motion for trial in campaign.trials]
        self._draws = NuisanceDraws(self.nuisances, self._order, self._sessions, motions, seed)
        self._earlier: dict[_Scene, MadeEarlier] = {}
        self.nuisance_names = self._draws.names
        self._own_effects = SceneEffects(study)
        self._own_effects.check(self.nuisances)
        every = range(len(campaign.trials))
        base = base_trials(campaign, study, self._row, every)
        self._trials = [base[i] for i in every]
        moved = any(one.displacement is not None for one in campaign.motions.values())
        if moved and campaign.noise.displacement and not isinstance(study.motion, OF_RECORDS):
            _logger.warning(
                "study %r: its motion section is of no recordings and the campaign states noise of "
                "the displacement: recorded displacements are band-passed (%s); a motion section "
                "of mode all_recordings says how they drive, with `filter: {}` or without",
                study.name,
                Filter(),
            )
        # What comes in over the campaign acts in later trials.
        kinds: dict[tuple[str, ...], Trial] = {}
        for trial in self._nominal():
            kinds.setdefault(tuple(own.effect.name for own in trial.effects), trial)
        self._first = next(iter(kinds.values()))
        self.excluded = tuple(sorted(hypotheses.exclude))
        self.unavailable: dict[str, Vsr2Error] = {}
        self.library: dict[str, Effect] = {}
        for closed in in_order(offered):
            effect = closed.opened(self._nominal())
            error = _refusal(effect, [*kinds.values()])
            if error is None:
                self.library[effect.name] = effect.with_null(effect.nominal(self._first))
            else:
                self.unavailable[effect.name] = error
        self.identity = self._digest(study)

    def _digest(self, study: Study) -> str:
        from vsr2 import _native

        scene = self._trials[0].scene
        content = repr(
            (
                str(_native.build_facts()["version"]),
                scene.sha256,
                scene.rock.start,
                [t.motion.sha256 for t in self._trials],
                self._order,
                self._sessions,
                [one.identity for one in self.nuisances],
                self._series and (*TILT_FEATURES, *REST_FEATURES, *self._measured),
                self._seed,
                study.settling.model_dump_json(),
                study.outcome.model_dump_json(),
                study.motion.drive,
                self._own_effects.content,
            )
        )
        return hashlib.sha256(content.encode()).hexdigest()

    def nuisance_draw(self, index: int) -> Array:
        """Standardised nuisances of a draw."""
        return self._draws.draw(index)

    def run(self, requests: Sequence[Request]) -> Responses:
        """Simulate in native threads; the campaign's own order and sessions are kept.

        A trial is made when its turn comes, and its motion goes with it.
        """
        from vsr2.simulation import run_trials

        overturned, peak = np.full(len(requests), np.nan), np.full(len(requests), np.nan)
        count = len(TILT_FEATURES) + len(REST_FEATURES)
        features = np.full((len(requests), count), np.nan) if self._series else None
        asked: list[int] = []
        without: list[int] = []

        def take(position: int, row: Mapping[str, Any], log: TrialLog | None) -> None:
            index = asked[position]
            if row["outcome"] != Outcome.failed:
                overturned[index] = row["outcome"] == Outcome.overturned
                peak[index] = row["peak_tilt"]
            if features is not None and log is not None and len(log.time):
                tilt = log.tilt
                kept = (log.time >= 0) & np.isfinite(tilt)
                if kept.any():
                    rng = np.random.default_rng([self._seed, *_numbers(requests[index])])
                    nominal = self._trials[requests[index].trial].motion
                    features[index] = _features(log, kept, tilt[kept], nominal, self._sampling, rng)

        trials = self._made(requests, asked, without)
        threads = None if self._client is not None else self._threads
        if run_trials(trials, threads=threads, client=self._client, take=take)["interrupted"]:
            raise KeyboardInterrupt
        for known in (overturned, peak) if features is None else (overturned, peak, features):
            known[without] = np.nan
        return Responses(overturned, peak, features)

    def _made(
        self, requests: Sequence[Request], asked: list[int], without: list[int]
    ) -> Iterator[Trial]:
        """The trials that are asked for, one after another.

        Args:
            requests: of any draws.
            asked: gets the request of each trial.
            without: gets the requests of draws that have no outcome.
        """
        from vsr2.simulation import check_trials

        for scene, members in self._alike(requests):
            try:
                for index, trial in self._built(scene, members):
                    check_trials([trial])
                    for i in members[index].requests:
                        asked.append(i)
                        yield trial
            except GeometryError as error:
                # Together, effects may leave nothing of a rock: this draw has no outcome.
                _logger.warning("%s of nuisances %d: %s", scene.effects, scene.nuisance, error)
                without += [i for same in members.values() for i in same.requests]

    def _alike(self, requests: Sequence[Request]) -> Iterator[tuple[_Scene, dict[int, _Member]]]:
        """Requests of one scene, by the trial; what they share is then made once.

        Trials may differ in the numbers of effects that act on their motion, as they do where
        margins are sought. A trial that is asked for with several of these comes again.
        """
        groups: dict[_Scene, list[dict[int, _Member]]] = {}
        for i, request in enumerate(requests):
            own = tuple(one for one in request.effects if sees_motion(self.library[one[0]]))
            common = tuple(one for one in request.effects if one not in own)
            names = tuple(name for name, _ in own)
            scene = _Scene(common, names, request.nuisance, request.replicate)
            passes = groups.setdefault(scene, [])
            for members in passes:
                member = members.setdefault(request.trial, _Member(own, []))
                if member.effects == own:
                    break
            else:
                member = _Member(own, [])
                passes.append({request.trial: member})
            member.requests.append(i)
        for scene, passes in groups.items():
            for members in passes:
                yield scene, members

    def _built(self, scene: _Scene, members: Mapping[int, _Member]) -> Iterator[tuple[int, Trial]]:
        """The wanted trials with nuisances and effects in them, one after another."""
        caused: list[Caused] = [self._given(*one) for one in scene.effects]
        for k, name in enumerate(scene.by_trial):
            own = {i: self._given(*one.effects[k])[1] for i, one in members.items()}
            caused.append((self.library[name], Sought(own)))
        # Variants and shifted starts have the draws of replicate 0: they differ by nothing else.
        own_effects = self._own_effects.drawn_by(
            [self._seed, scene.nuisance, max(scene.replicate, 0)]
        )
        return self._draws.applied(
            self._base(scene.replicate, members),
            self._first,
            scene.nuisance,
            scene.replicate,
            members,
            own_effects,
            caused,
            self._kept(scene),
        )

    def _kept(self, scene: _Scene) -> MadeEarlier | None:
        """What was made of a scene; that of those asked for last stays.

        None: of variants and shifted starts, whose trials are new objects each time.
        """
        if scene.replicate < 0:
            return None
        key = scene._replace(by_trial=())
        made = self._earlier[key] = self._earlier.pop(key, MadeEarlier(KEPT_MOTIONS))
        if len(self._earlier) > KEPT_SCENES:
            del self._earlier[next(iter(self._earlier))]
        return made

    def _given(self, name: str, numbers: tuple[float, ...]) -> tuple[Effect, dict[str, float]]:
        effect = self.library[name]
        pairs = zip(effect.parameters, numbers, strict=True)
        return effect, {p.name: value for p, value in pairs}

    def _nominal(self) -> Iterator[Trial]:
        """All trials with the scene's effects, the first one first, without nuisances."""
        every = range(len(self._trials))
        own = self._own_effects.drawn_by([self._seed, 0, 0])
        made = self._draws.applied(self._trials, self._trials[0], 0, 0, every, own)
        return (trial for _, trial in made)

    def _base(self, replicate: int, wanted: Collection[int]) -> list[Trial]:
        """Trials without effects: of the study, of a numerical variant of it, or shifted a little.

        Args:
            replicate: as of :class:`Request`.
            wanted: indices; other trials come back as they are.
        """
        out = list(self._trials)
        if replicate in self.variants:
            # Their motions are as large again, and few trials have a variant: none is kept.
            varied = base_trials(
                self._campaign, _variant(self._study, replicate), self._row, wanted
            )
            return [varied.get(i, trial) for i, trial in enumerate(out)]
        for i in wanted if replicate < 0 else ():
            trial = out[i]
            shift = SIMULATION.least_shift * 10.0 ** ((PERTURBED - replicate) % SIMULATION.shifts)
            start = trial.start or trial.scene.rock.start
            x, y, z = start.position
            turned = multiply(yaw_quaternion(shift), start.orientation)
            out[i] = replace(trial, start=Pose((x + shift, y + shift, z), turned))
        return out


class _Scene(NamedTuple):
    """What requests have in common.

    Attributes:
        effects: that act in all of them, with values.
        by_trial: names of further effects, whose values belong to each request.
        nuisance, replicate: as of :class:`Request`.
    """

    effects: Effects
    by_trial: tuple[str, ...]
    nuisance: int
    replicate: int


class _Member(NamedTuple):
    """Requests of one simulation of a trial.

    Attributes:
        effects: those of `_Scene.by_trial`, with the trial's own values.
        requests: their indices.
    """

    effects: Effects
    requests: list[int]


def _refusal(effect: Effect, trials: Sequence[Trial]) -> Vsr2Error | None:
    """Why an effect cannot act in some trial, late in the campaign; None: it can in all."""
    from vsr2.simulation import check_trials

    try:
        trials = with_effects(
            trials, [(effect, effect.extreme())],
            relative_order=[1.0] * len(trials), sessions=["1"] * len(trials),
        )  # fmt: skip
        check_trials(trials)
    except Vsr2Error as error:
        return error
    return None


def _numbers(request: Request) -> tuple[int, int, int, int]:
    return request.trial, request.nuisance, abs(request.replicate), int(request.replicate < 0)


def _features(
    log: TrialLog,
    rows: NDArray[np.bool_],
    tilt: Array,
    nominal: Motion,
    sampling: Sampling | None,
    rng: np.random.Generator,
) -> Array:
    """Of one trial, whose travel is counted from where the nominal motion has the table."""
    last = np.flatnonzero(rows)[-SERIES.last :]
    steps = np.rint(log.time[last] / nominal.time_step).astype(int)
    table = nominal.displacement[np.minimum(steps, nominal.displacement.size - 1)]
    rest = rest_features(tilt[-SERIES.last :], *log.from_rest(last), table)
    time = log.time[rows]
    if sampling is not None:
        time, tilt = sampling.measured(time, tilt, rng)
    return np.concatenate([tilt_features(time, tilt), rest])


def _variant(study: Study, replicate: int) -> Study:
    engine = study.engine
    changes = (
        {"time_step": 0.5 * engine.time_step}
        if replicate == HALF_STEP
        else {"solver_iterations": 2 * engine.solver_iterations}
    )
    return study.model_copy(update={"engine": engine.model_copy(update=changes)})


def base_trials(
    campaign: Campaign, study: Study, row: float | None, wanted: Collection[int]
) -> dict[int, Trial]:
    """The wanted trials without effects; `row`: between rows of the series [s], None: no series."""
    from vsr2.scene import build_scene
    from vsr2.trial import Trial, rows_only

    scene = build_scene(study)
    every = 0 if row is None else max(1, round(row / study.engine.time_step))
    output = rows_only(study.output, every)
    motions: dict[str, Motion] = {}
    trials = {}
    for i in sorted(wanted):
        trial = campaign.trials[i]
        record = campaign.record(trial)
        if record is None or trial.motion_file is None:
            raise DiagnosisError(
                f"campaign {campaign.name!r}: trial {trial.trial!r} has no motion; keep those that "
                "have one with `with_motion`"
            )
        if trial.motion_file not in motions:
            motion = _driven(
                record, study, trial.motion_file, noisy=bool(campaign.noise.displacement)
            )
            motions[trial.motion_file] = motion.without_acceleration()
        trials[i] = Trial.of_study(
            study, scene, motions[trial.motion_file], name=trial.trial, output=output
        )
    return trials


def _driven(record: Record, study: Study, name: str, *, noisy: bool) -> Motion:
    """As the study says of recordings; where it says nothing, band-passed if that needs it.

    Without a filter stated noise of the displacement, or an integrated acceleration, would drive
    the table.
    """
    step = study.engine.time_step
    if isinstance(study.motion, OF_RECORDS):
        return build_recorded_motion(
            record,
            step,
            channel=study.motion.channel,
            filter=study.motion.filter,
            scale=study.motion.scale,
            name=name,
        )
    filtered = noisy or record.displacement is None
    return build_recorded_motion(record, step, filter=Filter() if filtered else None, name=name)
