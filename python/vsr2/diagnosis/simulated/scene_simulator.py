"""The campaign's trials simulated in full: the scene of a study, the native core, the library."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign
from vsr2.config.motion_source import AllRecordings, Filter, SingleRecording
from vsr2.config.study import Study
from vsr2.diagnosis.observed.features import (
    REST_FEATURES,
    TILT_FEATURES,
    Sampling,
    rest_features,
    tilt_features,
)
from vsr2.diagnosis.observed.observations import series_sampling
from vsr2.diagnosis.simulated.simulator import (
    FINE_SOLVER,
    HALF_STEP,
    PERTURBED,
    Effects,
    Request,
    Responses,
    nuisance_normal,
)
from vsr2.effects import Effect, in_order, with_effects
from vsr2.effects import library as known_effects
from vsr2.errors import DiagnosisError, Vsr2Error
from vsr2.motion import Motion, Record, build_recorded_motion
from vsr2.results import TrialLog
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion

if TYPE_CHECKING:
    import distributed

    from vsr2.trial import Trial

Array = NDArray[np.float64]

JUDGED = ("ok", "tail_timeout")
"""Statuses with which an outcome is known."""
ROW = 0.01
"""Between rows of the series that features are drawn from, or the campaign's own interval [s]."""


@dataclass(frozen=True)
class Nuisances:
    """Standard deviations of what is uncertain about a set-up, all normal about nominal.

    Drawn once a campaign:

    Attributes:
        slenderness: of tan(alpha), relative [1].
        inertia: relative [1].
        com_offset: of the mass centre along the shaking [m].
        friction: of the logarithm of the coefficient [1].
        contact_stiffness: [decades].
        restitution: of the energy that an impact leaves, relative [1]; about Housner's where the
            scene does not set it.
        table_gain: relative [1].
        yaw: of the placement, a fresh one for each trial [degree].
        offset: of the placement in plan, a fresh one for each trial [m].
        trial_gain: of the motion's noise, as a relative gain, a fresh one for each trial [1].
    """

    slenderness: float = 0.02
    inertia: float = 0.02
    com_offset: float = 0.001
    friction: float = 0.1
    contact_stiffness: float = 0.1
    restitution: float = 0.02
    table_gain: float = 0.005
    yaw: float = 1.0
    offset: float = 0.002
    trial_gain: float = 0.005


CAMPAIGN_WIDE = (
    "slenderness",
    "inertia",
    "com_offset",
    "friction",
    "contact_stiffness",
    "restitution",
    "table_gain",
)


class SceneSimulator:
    """Simulates a campaign's trials with the native core.

    Args:
        campaign: every trial needs a motion; in order of execution.
        study: of the nominal scene; its own motions are not used, but how recordings are turned
            into the driven motion is (channel, filter, scale, drive).
        nuisances: their priors.
        library: effects; default: all that are registered.
        exclude: names left out.
        series: also draw features from the tilt's series.
        sampling: of series, where the campaign has none.
        threads: of the native core; None: all.
        client: of a Dask cluster that runs the trials.
        seed: of nuisances and of what belongs to single trials.

    Attributes:
        unavailable: effects that this scene cannot have, with the reason.
        uncertainties: of the nuisances.

    Raises:
        DiagnosisError: a trial without motion, or an unknown name in `exclude`.
        GeometryError, MotionError, SimulationError: the scene or a motion cannot be used.
    """

    def __init__(
        self,
        campaign: Campaign,
        study: Study,
        *,
        nuisances: Nuisances | None = None,
        library: Mapping[str, Effect] | None = None,
        exclude: Collection[str] = (),
        series: bool = False,
        sampling: Sampling | None = None,
        threads: int | None = None,
        client: distributed.Client | None = None,
        seed: int = 0,
    ) -> None:
        offered = dict(known_effects() if library is None else library)
        strange = sorted(set(exclude) - set(offered))
        if strange:
            raise DiagnosisError(
                f"exclude: there is no effect {strange[0]!r}; there are {', '.join(offered)}"
            )
        self.uncertainties = Nuisances() if nuisances is None else nuisances
        self._series = series
        self._threads = threads
        self._client = client
        self._seed = seed
        self._campaign, self._study = campaign, study
        self._sampling = series_sampling(campaign) or sampling if series else None
        self._measured = () if self._sampling is None else (self._sampling,)
        interval = ROW if self._sampling is None else self._sampling.interval
        self._row = min(ROW, interval) if series else None
        self._trials = _base_trials(campaign, study, self._row)
        self._varied: dict[int, list[Trial]] = {}
        orders = np.array([trial.order for trial in campaign.trials], dtype=np.float64)
        self._orders = list((orders - orders.min()) / max(float(np.ptp(orders)), 1.0))
        self._sessions = [trial.session for trial in campaign.trials]
        self.unavailable: dict[str, str] = {}
        self._library: dict[str, Effect] = {}
        for name, effect in offered.items():
            if name in exclude:
                continue
            reason = self._refusal(effect)
            if reason is None:
                self._library[name] = effect
            else:
                self.unavailable[name] = reason
        self._identity = self._digest(study)

    def _digest(self, study: Study) -> str:
        from vsr2 import _native

        scene = self._trials[0].scene
        content = repr(
            (
                str(_native.build_facts()["version"]),
                scene.sha256,
                scene.rock.start,
                [t.motion.sha256 for t in self._trials],
                self._orders,
                self._sessions,
                [getattr(self.uncertainties, f.name) for f in fields(self.uncertainties)],
                self._series and (*TILT_FEATURES, *REST_FEATURES, *self._measured),
                self._seed,
                study.settling.model_dump_json(),
                study.outcome.model_dump_json(),
                study.motion.drive,
            )
        )
        return hashlib.sha256(content.encode()).hexdigest()

    def _refusal(self, effect: Effect) -> str | None:
        from vsr2.simulation import check_trials

        try:
            trials = with_effects(
                self._trials[:1], [(effect, effect.extreme())], orders=[1.0], sessions=["1"]
            )
            check_trials(trials)
        except Vsr2Error as error:
            return str(error)
        return None

    @property
    def library(self) -> Mapping[str, Effect]:
        """Effects that this scene can have."""
        return self._library

    @property
    def identity(self) -> str:
        """Hash of scene, motions, schedule, priors and seed."""
        return self._identity

    def trial_key(self, trial: int) -> str:
        """Place of the trial; its motion is part of the identity."""
        return str(trial)

    @property
    def variants(self) -> tuple[int, ...]:
        """Half the time step, twice the solver's iterations."""
        return HALF_STEP, FINE_SOLVER

    @property
    def nuisance_names(self) -> tuple[str, ...]:
        """Drawn once a campaign."""
        return CAMPAIGN_WIDE

    def nuisance_draw(self, index: int) -> Array:
        """Standardised nuisances of a draw."""
        return nuisance_normal(self._seed, len(CAMPAIGN_WIDE), index)

    def run(self, requests: Sequence[Request]) -> Responses:
        """Simulate in native threads; the campaign's own order and sessions are kept."""
        from vsr2.simulation import run_batch

        groups: dict[tuple[Effects, int, int], list[int]] = {}
        for i, request in enumerate(requests):
            key = (request.effects, request.nuisance, request.replicate)
            groups.setdefault(key, []).append(i)
        made: list[Trial | None] = [None] * len(requests)
        for (effects, nuisance, replicate), members in groups.items():
            wanted = {requests[i].trial for i in members}
            built = self._built(effects, nuisance, replicate, wanted)
            for i in members:
                made[i] = built[requests[i].trial]
        trials = [trial for trial in made if trial is not None]
        count = len(TILT_FEATURES) + len(REST_FEATURES)
        features = np.full((len(trials), count), np.nan) if self._series else None

        def take(index: int, log: TrialLog | None) -> None:
            if features is not None and log is not None and len(log.time):
                tilt = log.tilt
                kept = (log.time >= 0) & np.isfinite(tilt)
                if kept.any():
                    rng = np.random.default_rng([self._seed, *_numbers(requests[index])])
                    features[index] = _features(log, kept, tilt[kept], self._sampling, rng)

        result = run_batch(
            trials,
            threads=None if self._client is not None else self._threads,
            client=self._client,
            keep_logs=False,
            on_trial=take,
        )
        if result.provenance.get("interrupted"):
            raise KeyboardInterrupt
        judged = np.isin(result["status"], JUDGED) & (result["outcome"] != "failed")
        overturned = np.where(judged, result["outcome"] == "overturned", np.nan)
        peak = np.where(judged, result["peak_tilt"], np.nan).astype(np.float64)
        return Responses(overturned.astype(np.float64), peak, features)

    def _built(
        self, effects: Effects, nuisance: int, replicate: int, wanted: set[int]
    ) -> dict[int, Trial]:
        """The wanted trials with nuisances and effects in them.

        What an effect draws belongs to the trial's place in the whole campaign; trials that are not
        wanted keep a place without work.
        """
        seed = int(
            np.random.SeedSequence(
                [self._seed, nuisance, abs(replicate), replicate < 0]
            ).generate_state(1, np.uint64)[0]
        )
        out = {}
        kept = self._energy_ratio(nuisance)
        given = self._nuisance_effects(nuisance, replicate)
        for name, numbers in effects:
            effect = self._library[name]
            values = {p.name: v for p, v in zip(effect.parameters, numbers, strict=True)}
            if name == "restitution":
                values["energy_ratio"] *= kept
            given.append((effect, values))
        if nuisance and "restitution" not in dict(effects):
            own = self._trials[0].scene.mechanisms.impact_energy_ratio
            ratio = kept * (1.0 if np.isnan(own) else own)
            effect = known_effects()["restitution"]
            given.append((effect, effect.complete({"energy_ratio": ratio})))
        base = self._perturbed(nuisance, replicate, wanted)
        ranks = {e.name: i for i, e in enumerate(in_order({e.name: e for e, _ in given}))}
        given.sort(key=lambda pair: ranks[pair[0].name])
        made = with_effects(
            base, given, orders=self._orders, sessions=self._sessions, seed=seed, only=wanted
        )
        for i in wanted:
            out[i] = made[i]
        return out

    def _energy_ratio(self, nuisance: int) -> float:
        """Energy that an impact leaves in a draw, over the scene's own."""
        z = self.nuisance_draw(nuisance)[CAMPAIGN_WIDE.index("restitution")]
        return float(np.exp(self.uncertainties.restitution * z))

    def _nuisance_effects(
        self, nuisance: int, replicate: int
    ) -> list[tuple[Effect, Mapping[str, float]]]:
        known = known_effects()
        z = dict(zip(CAMPAIGN_WIDE, self.nuisance_draw(nuisance), strict=True))
        sd = self.uncertainties
        out: list[tuple[Effect, Mapping[str, float]]] = []

        def add(name: str, **values: float) -> None:
            out.append((known[name], known[name].complete(values)))

        if nuisance:
            add("slenderness", change=sd.slenderness * z["slenderness"])
            add("inertia", change=max(sd.inertia * z["inertia"], -0.5))
            along = sd.com_offset * z["com_offset"]
            add("com_offset", distance=abs(along), azimuth=0.0 if along > 0 else 180.0)
            add("friction", factor=float(np.exp(sd.friction * z["friction"])))
            add("contact_stiffness", decades=sd.contact_stiffness * z["contact_stiffness"])
            add("table_gain", change=sd.table_gain * z["table_gain"])
        if replicate > 0:
            # A uniform draw between -w and w has the deviation w / sqrt(3), one over a disc w / 2.
            add("placement", yaw=sd.yaw * 3**0.5, offset=2 * sd.offset)
        return out

    def _perturbed(self, nuisance: int, replicate: int, wanted: set[int]) -> list[Trial]:
        """Base trials with the motion's noise (replicates above 0), a variant or a tiny shift."""
        if replicate == 0:
            return self._trials
        if replicate in self.variants:
            if replicate not in self._varied:
                study = _variant(self._study, replicate)
                self._varied[replicate] = _base_trials(self._campaign, study, self._row)
            return self._varied[replicate]
        out = list(self._trials)
        for i in wanted:
            trial = out[i]
            if replicate < 0:
                shift = 1e-6 * 10.0 ** ((PERTURBED - replicate) % 3)
                start = trial.start or trial.scene.rock.start
                x, y, z = start.position
                turned = multiply(yaw_quaternion(shift), start.orientation)
                out[i] = replace(trial, start=Pose((x + shift, y + shift, z), turned))
            else:
                rng = np.random.Generator(
                    np.random.Philox(key=self._seed, counter=[1, i, nuisance, replicate])
                )
                gain = 1.0 + self.uncertainties.trial_gain * float(rng.standard_normal())
                out[i] = replace(trial, motion=trial.motion.scaled(gain, name=trial.motion.name))
        return out


def _numbers(request: Request) -> tuple[int, int, int, int]:
    return request.trial, request.nuisance, abs(request.replicate), int(request.replicate < 0)


def _features(
    log: TrialLog,
    rows: NDArray[np.bool_],
    tilt: Array,
    sampling: Sampling | None,
    rng: np.random.Generator,
) -> Array:
    position, orientation = log.from_rest(rows)
    rest = rest_features(tilt, position, orientation, log.column("pedestal_position")[rows])
    time = log.time[rows]
    if sampling is not None:
        time, tilt = sampling.measured(time, tilt, rng)
    return np.concatenate([tilt_features(time, tilt[:, None])[0], rest])


def _variant(study: Study, replicate: int) -> Study:
    engine = study.engine
    changes = (
        {"time_step": 0.5 * engine.time_step}
        if replicate == HALF_STEP
        else {"solver_iterations": 2 * engine.solver_iterations}
    )
    return study.model_copy(update={"engine": engine.model_copy(update=changes)})


def _base_trials(campaign: Campaign, study: Study, row: float | None) -> list[Trial]:
    """Trials without effects; `row`: between rows of the series [s], None: no series."""
    from vsr2.scene import build_scene
    from vsr2.trial import Trial, rows_only

    scene = build_scene(study)
    every = 0 if row is None else max(1, round(row / study.engine.time_step))
    output = rows_only(study.output, every)
    motions: dict[str, Motion] = {}
    trials = []
    for trial in campaign.trials:
        record = campaign.record(trial)
        if record is None or trial.motion_file is None:
            raise DiagnosisError(
                f"campaign {campaign.name!r}: trial {trial.trial!r} has no motion; keep those that "
                "have one with `with_motion`"
            )
        if trial.motion_file not in motions:
            motions[trial.motion_file] = _driven(
                record, study, trial.motion_file, noisy=bool(campaign.noise.displacement)
            )
        trials.append(
            Trial(
                scene=scene,
                motion=motions[trial.motion_file],
                drive=study.motion.drive,
                name=trial.trial,
                settling=study.settling,
                outcome=study.outcome,
                output=output,
            )
        )
    return trials


def _driven(record: Record, study: Study, name: str, *, noisy: bool) -> Motion:
    """As the study says of recordings; where it says nothing, as recorded, without its noise."""
    step = study.engine.time_step
    if isinstance(study.motion, SingleRecording | AllRecordings):
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
