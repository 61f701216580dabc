"""Campaigns with a known cause, for development, tests and measuring the method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planar.block import GRAVITY
from planar.simulator import PlanarSimulator
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Specimen, Tier
from vsr2.diagnosis.conclusion import conclude
from vsr2.diagnosis.likelihood.evidence import Data
from vsr2.diagnosis.observed.features import TILT_FEATURES
from vsr2.diagnosis.observed.observations import Observations, observe_campaign
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.design import Design, Screening, screen, simulate_design
from vsr2.diagnosis.simulated.reach import reaching
from vsr2.diagnosis.simulated.simulator import Effects, Request, Responses, Simulator
from vsr2.diagnosis.verdict.compose import Evidence, compose
from vsr2.diagnosis.verdict.document import Diagnosis
from vsr2.diagnosis.which.amortised import TrialConditions
from vsr2.diagnosis.which.routes import Inference, Prepared, infer, prepare
from vsr2.motion import Record

Array = NDArray[np.float64]

INTERVAL = 0.005
"""Sampling interval of the motions [s]."""


def shaken_campaign(
    motions: int = 15,
    scalings: int = 10,
    *,
    duration: float = 5.0,
    pga: tuple[float, float] = (0.3, 1.4),
    session_size: int = 20,
    seed: int = 0,
) -> Campaign:
    """Trials without outcomes: pulses in band-limited noise, each scaled several times.

    Every motion has a pulse frequency of its own between 0.8 and 4 Hz; its scalings spread over
    the range of PGA [g] widened by the frequency, as a slow motion overturns sooner. Trials are
    run motion by motion, the motions in random order, scalings rising.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, INTERVAL)
    records: dict[str, Record] = {}
    trials: list[CampaignTrial] = []
    for m in rng.permutation(motions):
        frequency = float(np.exp(rng.uniform(np.log(0.8), np.log(4.0))))
        shape = _shape(time, frequency, rng)
        low, high = (value * frequency**0.35 for value in pga)
        for k in range(scalings):
            peak = GRAVITY * low * (high / low) ** ((k + rng.random()) / scalings)
            name = f"M{m:02d}-{k:02d}"
            records[name] = Record(name=name, sample_interval=INTERVAL, acceleration=shape * peak)
            trials.append(
                CampaignTrial(
                    trial=f"T{len(trials):03d}",
                    motion=f"M{m:02d}",
                    session=f"S{len(trials) // session_size:02d}",
                    order=len(trials),
                    specimen="block",
                    motion_file=name,
                )
            )
    return Campaign(
        name="planar", trials=tuple(trials), motions=records, specimens={"block": Specimen()}
    )


def _shape(time: Array, frequency: float, rng: np.random.Generator) -> Array:
    """A motion of unit peak acceleration that begins and ends at rest."""
    from scipy.signal import butter, sosfiltfilt

    centre = 0.4 * time[-1]
    pulse = np.cos(2 * np.pi * frequency * (time - centre) + rng.uniform(0, 2 * np.pi))
    pulse *= np.exp(-((frequency * (time - centre) / 1.2) ** 2))
    band = butter(2, [0.5, 8.0], "bandpass", fs=1 / INTERVAL, output="sos")
    noise = sosfiltfilt(band, rng.standard_normal(time.size))
    noise *= np.exp(-(((time - centre) / (0.25 * time[-1])) ** 2)) / np.abs(noise).max()
    shape = (pulse + 0.5 * noise) * np.sin(np.pi * time / time[-1]) ** 0.5
    shape -= shape.mean()
    return np.asarray(shape / np.abs(shape).max(), dtype=np.float64)


def observe(
    campaign: Campaign,
    simulator: PlanarSimulator,
    effects: Effects = (),
    *,
    nuisance: int,
    tier: str = "B",
    peak_noise: float = 0.003,
    seed: int = 0,
) -> Campaign:
    """The campaign with outcomes (and largest tilts, from tier M on) that a simulator gives.

    Args:
        campaign: made by :func:`shaken_campaign`.
        simulator: with a seed other than the diagnosis uses, so that its draws stay unknown.
        effects: what is planted.
        nuisance: draw of the simulator's nuisances.
        tier: B or M.
        peak_noise: standard error of the largest tilt [rad].
        seed: of that noise.
    """
    found = simulator.run([Request(i, effects, nuisance, 1) for i in range(len(campaign))])
    rng = np.random.default_rng(seed)
    noisy = np.clip(found.peak_tilt + peak_noise * rng.standard_normal(len(campaign)), 0, np.pi)
    trials: Sequence[CampaignTrial] = [
        replace(
            trial,
            overturned=bool(found.overturned[i]),
            peak_tilt=None if tier == "B" else float(noisy[i]),
        )
        for i, trial in enumerate(campaign.trials)
    ]
    return replace(campaign, trials=tuple(trials), noise=MeasurementNoise(peak_tilt=peak_noise))


@dataclass(frozen=True, eq=False)
class Judged:
    """What was concluded of one campaign."""

    evidence: Evidence
    inference: Inference
    diagnosis: Diagnosis


class Rehearsal:
    """One schedule of trials, simulated and prepared once, on which many campaigns are judged.

    Args:
        simulator: of the diagnosis; gives series if tier T is wanted.
        campaign: the schedule; outcomes are not read.
        draws: of every effect.
        screening_runs: simulations a trial that tell certain trials from uncertain ones.
        most: trials kept.
        noise: standard error of the largest tilt [rad].
        series: whether the simulator gives series.
        cache: file of simulations; None: in memory.
    """

    def __init__(
        self,
        simulator: Simulator,
        campaign: Campaign,
        *,
        draws: int = 24,
        screening_runs: int = 20,
        most: int = 400,
        noise: float = 0.003,
        series: bool = False,
        cache: Path | None = None,
    ) -> None:
        self.simulator = simulator
        self._noise = noise
        blank = replace(
            campaign,
            noise=MeasurementNoise(peak_tilt=noise),
            trials=tuple(
                replace(t, overturned=False, peak_tilt=0.0, series=None) for t in campaign.trials
            ),
        )
        # Any outcomes will do: screening reads none, and the tier decides what else counts.
        seen = observe_campaign(blank, "M")
        measured = (*seen.measured, *TILT_FEATURES) if series else seen.measured
        self._seen = replace(seen, tier="T" if series else "M", measured=measured)
        self.cache = SimulationCache(simulator, cache)
        self.screening: Screening = screen(
            self.cache, self._seen, runs=screening_runs, most=most, seed=0
        )
        self.library = reaching(self.cache, self.screening)
        self._design, self.draws = simulate_design(
            self.cache, self._seen, self.screening, self.library, dict.fromkeys(self.library, draws)
        )

    def observed(
        self, truth: Simulator, effects: Effects = (), *, nuisance: int, replicate: int = 1
    ) -> Observations:
        """What a campaign gives under a simulator whose draws the diagnosis does not know."""
        requests = [Request(i, effects, nuisance, replicate) for i in range(len(self._seen))]
        return self.noted(truth.run(requests), seed=nuisance)

    def noted(self, found: Responses, *, seed: int) -> Observations:
        """Responses of all trials as a campaign notes them."""
        features = self._seen.noted(found.overturned, found.peak_tilt, found.features, 1000 + seed)
        return replace(self._seen, overturned=found.overturned, features=features)

    def design(self, tier: Tier) -> Design:
        """The simulated campaigns with what a tier knows."""
        count = {"B": 0, "M": 1}.get(tier, self._design.features.shape[2])
        return replace(self._design, features=self._design.features[:, :, :count])

    def prepared(
        self, tier: Tier, *, without: Sequence[str] = (), design: Design | None = None
    ) -> Prepared:
        """Both routes for a tier, some effects left out of the library."""
        library = {n: e for n, e in self.library.items() if n not in without}
        simulated = self.design(tier) if design is None else design
        rows = np.flatnonzero(~np.isin(simulated.effect, list(without)))
        seen, kept = self._seen, self.screening.kept
        conditions = TrialConditions(seen.order[kept], seen.log_pga[kept], seen.log_ratio[kept])
        return prepare(
            library, simulated.take(rows), self.draws[rows], conditions, seen.motion[kept]
        )

    def judge(self, prepared: Prepared, seen: Observations, tier: Tier) -> Judged:
        """From observations to diagnosis."""
        kept = self.screening.kept
        count = {"B": 0, "M": 1}.get(tier, seen.features.shape[1])
        part = replace(
            seen, tier=tier, measured=seen.measured[:count], features=seen.features[:, :count]
        )
        observed = Data(part.overturned[None, kept], part.features[None, kept])
        found = infer(prepared, observed)
        evidence = conclude(self.cache, part, self.screening, prepared, found)
        spent = {"budget": {"state": "sufficient"}}
        diagnosis = compose(part, self.screening, prepared, found, evidence, {}, spent)
        return Judged(evidence, found, diagnosis)
