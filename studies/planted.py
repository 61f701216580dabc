"""Campaigns with a known cause, for development, tests and measuring the method."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planar.planar_block import GRAVITY
from planar.planar_simulator import PlanarSimulator
from vsr2.campaign import Campaign, CampaignTrial, MeasurementNoise, Specimen, Tier
from vsr2.ensemble.observed.features import TILT_FEATURES
from vsr2.ensemble.observed.observations import Observations, observe_campaign
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns, plain_campaigns, simulate_campaigns
from vsr2.ensemble.simulated.look import look
from vsr2.ensemble.simulated.simulator import Effects, Request, Responses, Simulator
from vsr2.motion import Record
from vsr2.posterior.training import Found, Posterior, train

Array = NDArray[np.float64]

INTERVAL = 0.005
"""Sampling interval of the motions [s]."""


def shaken_campaign(
    motions: int = 15,
    scalings: int = 10,
    *,
    duration: float = 5.0,
    pga_g: tuple[float, float] = (0.3, 1.4),
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
        low, high = (value * frequency**0.35 for value in pga_g)
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


class Rehearsal:
    """One schedule of trials, looked at, simulated and trained once, on which many are inferred.

    Args:
        simulator: of the diagnosis; gives series if tier T is wanted.
        campaign: the schedule; outcomes are not read.
        campaigns: simulated ones that the posterior is trained on, beside those of the look.
        trials: of each, evenly spread; None: all that respond.
        noise: standard error of the largest tilt [rad].
        cache: file of simulations; None: in memory.
        seed: of look, campaigns and training.

    Attributes:
        cache: of simulations.
        look: detection limits.
        trials: indices of those that are simulated.
    """

    def __init__(
        self,
        simulator: Simulator,
        campaign: Campaign,
        *,
        campaigns: int = 1000,
        trials: int | None = None,
        noise: float = 0.003,
        cache: Path | None = None,
        seed: int = 0,
    ) -> None:
        blank = replace(
            campaign,
            noise=MeasurementNoise(peak_tilt=noise),
            trials=tuple(
                replace(t, overturned=False, peak_tilt=0.0, series=None) for t in campaign.trials
            ),
        )
        # Any outcomes will do: training reads none, and the tier decides what else counts.
        self._seen = observe_campaign(blank, "M")
        self._seed = seed
        self._trained: dict[tuple[Tier, int, frozenset[str]], Posterior] = {}
        self.cache = SimulationCache(simulator, cache, chunk=8192)
        self.look = look(self.cache, len(campaign), seed=seed)
        self.trials = self.look.spread(trials or len(campaign))
        self._plain = plain_campaigns(self.cache, self.trials)
        self._campaigns = simulate_campaigns(
            self.cache, self.look, self.trials, range(campaigns), seed=seed
        )

    @property
    def campaigns(self) -> Campaigns:
        """Simulated ones, those of the look first."""
        return self._plain.joined(self._campaigns)

    def at(self, tier: Tier) -> Observations:
        """The blank campaign as a tier sees it."""
        measured = {"B": (), "M": self._seen.measured}.get(
            tier, (*self._seen.measured, *TILT_FEATURES)
        )
        return replace(self._seen, tier=tier, measured=measured)

    def posterior(
        self, tier: Tier, campaigns: int | None = None, *, excluded: Collection[str] = ()
    ) -> Posterior:
        """Trained for a tier, on the first so many campaigns, None: all, without some effects."""
        count = len(self._campaigns) if campaigns is None else campaigns
        key = tier, count, frozenset(excluded)
        if key not in self._trained:
            own = self._plain.joined(self._campaigns.chosen(np.arange(count)))
            known = self.cache.simulator.library
            library = {name: one for name, one in known.items() if name not in excluded}
            self._trained[key] = train(self.at(tier), own, library, self.trials, seed=self._seed)
        return self._trained[key]

    def observed(
        self,
        truth: Simulator,
        effects: Effects = (),
        *,
        tier: Tier,
        nuisance: int,
        replicate: int = 1,
    ) -> Observations:
        """What a campaign gives under a simulator whose draws the diagnosis does not know."""
        requests = [Request(i, effects, nuisance, replicate) for i in range(len(self._seen))]
        found: Responses = truth.run(requests)
        blank = self.at(tier)
        rng = np.random.default_rng(1000 + nuisance)
        features = blank.noted(found.overturned, found.peak_tilt, found.features, rng)
        return replace(blank, overturned=found.overturned, features=features.astype(np.float64))

    def infer(
        self, seen: Observations, *, campaigns: int | None = None, excluded: Collection[str] = ()
    ) -> Found:
        """The posterior of one campaign."""
        posterior = self.posterior(seen.tier, campaigns, excluded=excluded)
        kept = self.trials
        return posterior.infer(seen.overturned[kept], seen.features[kept])
