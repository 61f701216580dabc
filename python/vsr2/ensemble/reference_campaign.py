"""A reference campaign against the nominal scene, where the answer is known.

A reference campaign has no effect, or a known one that the scene's study names. What its trials do
is compared with the nominal simulation of each. Beside that stands what simulations of the same
scene differ by among themselves: when starts are moved by a hair, and when nuisances, contact model
and starts are drawn again. A campaign that differs by more than these is not the scene's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Campaign
from vsr2.config import Study
from vsr2.config.seeds import checked_seed
from vsr2.ensemble.ensemble_constants import ensemble_constants
from vsr2.ensemble.observed.features import SERIES, TILT_FEATURES, rest_features
from vsr2.ensemble.observed.observations import Observations, observe_campaign
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.observed.stated_noise import turn_noise
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.look import LOOK
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES, SceneSimulator
from vsr2.ensemble.simulated.simulator import PERTURBED, Request
from vsr2.errors import DiagnosisError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceConstants:
    """How a reference is compared; chosen by hand.

    Attributes:
        draws: of nuisances, contact models and starts.
        starts: simulations with starts moved by 1e-6 to 1e-4 m and rad.
        significant: p value up to which a measure counts as differing.
        quantiles: of the fresh draws that are shown beside a difference.
    """

    draws: int = 99
    starts: int = 6
    significant: float = 0.05
    quantiles: tuple[float, float] = (0.05, 0.95)


REFERENCE = ReferenceConstants()


def reference_constants() -> dict[str, dict[str, Any]]:
    """Tuned numbers that a comparison rests on, by what they are of."""
    return {"reference": asdict(REFERENCE), **ensemble_constants()}


@dataclass(frozen=True)
class Agreement:
    """By how much a campaign differs from the nominal scene in one measure.

    Attributes:
        measure: `outcomes` (share that differs), `tilt_mean` and `tilt_size` (mean and mean
            absolute difference of the logarithm of the largest tilt, of trials that lifted off and
            stood in both), `turn_mean` and `turn_size` (the same of the final turn [rad]).
        trials: that it rests on.
        campaign: the difference.
        starts: the same of simulations with moved starts, root mean square.
        low, high: quantiles of the same under fresh draws.
        p_value: share of fresh draws that differ by as much, itself counted, made larger for the
            number of measures (S. Holm, "A simple sequentially rejective multiple test procedure",
            Scand. J. Statist. 6, 1979): of campaigns of the scene itself a share of at most
            `REFERENCE.significant` differs in any.
    """

    measure: str
    trials: int
    campaign: float
    starts: float
    low: float
    high: float
    p_value: float

    @property
    def differs(self) -> bool:
        """Whether the campaign differs by more than the scene's own simulations."""
        return self.p_value <= REFERENCE.significant


def compare_reference(
    campaign: Campaign,
    study: Study,
    *,
    hypotheses: Hypotheses = HYPOTHESES,
    threads: int | None = None,
    seed: int = 0,
) -> tuple[Agreement, ...]:
    """Agreement of a reference campaign with the scene of a study, its effects included.

    Args:
        campaign: without effect, or with those that the study names.
        study: of the nominal scene.
        hypotheses: what is uncertain about the set-up.
        threads: of the native core; None: all.
        seed: of the draws.

    Raises:
        DiagnosisError: the campaign holds too little, or what is no seed.
        ConfigError, GeometryError, MotionError, SimulationError: study or campaign cannot be used.
    """
    seed = checked_seed(seed, DiagnosisError)
    seen = observe_campaign(campaign)
    simulator = SceneSimulator(
        seen.campaign, study, hypotheses=hypotheses, series=True, threads=threads, seed=seed
    )
    with SimulationCache(simulator) as cache:
        return agreement(cache, seen, seed=seed)


def agreement(
    cache: SimulationCache, seen: Observations, *, seed: int = 0
) -> tuple[Agreement, ...]:
    """Agreement of a campaign with a simulator, measures of nothing left out.

    Args:
        cache: of simulations.
        seen: the campaign.
        seed: of the measurements' noise.
    """
    spots = [(0, 0)]
    spots += [(0, PERTURBED - k) for k in range(REFERENCE.starts)]
    spots += [(draw, 1) for draw in range(1, REFERENCE.draws + 1)]
    found = cache.run([Request(i, (), *spot) for spot in spots for i in range(len(seen))])
    shape = (len(spots), len(seen))
    overturned, peak = found.overturned.reshape(shape), found.peak_tilt.reshape(shape).copy()
    turn = np.full(shape, np.nan)
    if found.features is not None and found.features.shape[1] > len(TILT_FEATURES):
        turn = found.features[:, len(TILT_FEATURES)].reshape(shape)
    rng = generator(seed, Stream.REFERENCE)
    peak[1:] = seen.noted_tilt(peak[1:], rng)
    turn[1:] += _turn_noise(seen.campaign) * rng.standard_normal(turn[1:].shape)
    own = seen.campaign.trials
    tilts = [np.nan if t.peak_tilt is None else t.peak_tilt for t in own]
    measured = np.array([seen.overturned, tilts, [_turn(seen, i) for i in range(len(own))]])
    nominal = np.stack([overturned[0], peak[0], turn[0]])
    values, trials = _differences(measured, nominal, seen.tilt_offset)
    others = [
        _differences(np.stack(rows), nominal, seen.tilt_offset)[0]
        for rows in zip(overturned[1:], peak[1:], turn[1:], strict=True)
    ]
    out = []
    for name, value in values.items():
        differences = np.array([one[name] for one in others])
        if not np.isfinite(value) or not np.isfinite(differences).all():
            continue
        starts, draws = differences[: REFERENCE.starts], differences[REFERENCE.starts :]
        as_large = np.count_nonzero(np.abs(draws) >= abs(value))
        low, high = np.quantile(draws, REFERENCE.quantiles)
        out.append(
            Agreement(
                name, trials[name], value, float(np.sqrt((starts**2).mean())), float(low),
                float(high), (1 + as_large) / (1 + draws.size),
            )
        )  # fmt: skip
    return tuple(
        replace(one, p_value=p)
        for one, p in zip(out, _holm([one.p_value for one in out]), strict=True)
    )


def _holm(p_values: Sequence[float]) -> list[float]:
    """P values that hold for all of them together."""
    out, least = [0.0] * len(p_values), 0.0
    for rank, k in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        least = max(least, min((len(p_values) - rank) * p_values[k], 1.0))
        out[k] = least
    return out


def _differences(
    one: Array, nominal: Array, offset: float
) -> tuple[dict[str, float], dict[str, int]]:
    """Measures and the trials that they rest on: of outcome, largest tilt and turn, (3, trials)."""
    judged = np.isfinite(one[0]) & np.isfinite(nominal[0])
    stood = judged & (one[0] < 0.5) & (nominal[0] < 0.5)
    lifted = stood & (np.fmax(one[1], nominal[1]) > LOOK.moved)
    tilt = (np.log(one[1] + offset) - np.log(nominal[1] + offset))[lifted]
    turn = (np.abs(one[2]) - np.abs(nominal[2]))[stood]
    tilt, turn = tilt[np.isfinite(tilt)], turn[np.isfinite(turn)]
    values = {"outcomes": float((one[0] != nominal[0])[judged].mean())}
    trials = {"outcomes": int(judged.sum())}
    for name, part in (("tilt", tilt), ("turn", turn)):
        values[f"{name}_mean"] = float(part.mean()) if part.size else np.nan
        values[f"{name}_size"] = float(np.abs(part).mean()) if part.size else np.nan
        trials |= {f"{name}_mean": part.size, f"{name}_size": part.size}
    return values, trials


def _turn(seen: Observations, i: int) -> float:
    """Final turn of a trial [rad]; NaN where neither it nor the orientation was recorded."""
    trial = seen.campaign.trials[i]
    if trial.final_yaw is not None:
        return trial.final_yaw
    series = trial.series
    if series is None:
        return np.nan
    return float(rest_features(series.tilt_angle, None, series.orientation, None, series.yaw)[0])


def _turn_noise(campaign: Campaign) -> Array:
    """Standard error of each trial's final turn, shape (trials,) [rad].

    Of a series it is that of the median of n normal values, sd sqrt(pi / (2 n)).
    """
    out = np.zeros(len(campaign))
    for i, trial in enumerate(campaign.trials):
        if trial.final_yaw is not None:
            out[i] = campaign.noise.yaw or 0.0
        elif trial.series is not None:
            rows = min(SERIES.last, len(trial.series.time))
            stated = turn_noise(trial.series, campaign.noise)
            out[i] = stated * np.sqrt(0.5 * np.pi / rows)
    return out
