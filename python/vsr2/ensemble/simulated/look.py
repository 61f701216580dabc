"""A look at each effect: from which size on a campaign shows it.

A prior's end is a matter of what is conceivable, not of what a campaign shows: a table that pitches
by a fiftieth of its prior's end is plain to see. Campaigns are therefore simulated at sizes that
are drawn in detection limits, and each effect's limit is found first, on a few trials.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect
from vsr2.ensemble.observed.observations import OBSERVED
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.cache import Progress, SimulationCache
from vsr2.ensemble.simulated.library import (
    Library,
    Side,
    free_parameters,
    is_angle,
    parameter_sides,
    primary_parameters,
    sides,
    two_sided,
    values_at,
)
from vsr2.ensemble.simulated.linear_algebra import ridge
from vsr2.ensemble.simulated.simulator import Request, Responses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LookConstants:
    """How effects are tried; chosen by hand.

    Attributes:
        shares: of the range on one side of the null at which an effect is tried.
        turned: share of a half turn up to which a turn is tried: what it does grows so far at
            least, while a rock that is turned by a half or a quarter may look the same again.
        trials: on which effects are tried at most, where the campaign has few.
        part: of a campaign's trials on which effects are tried at most, where it has many: what few
            trials show of many is chance.
        fewest: such trials, however small the budget.
        plain: draws of nuisances without effect, from which the scatter of each trial is taken, at
            most.
        fewest_plain: such draws, however small the budget.
        draws: of nuisances that the trials take in turn, twice as many in all.
        signal: of a campaign at the detection limit: standard deviations of what nuisances and
            chance leave, over all trials.
        most: standard deviations that one trial counts for at most.
        least_scatter: of a trial, over the median of all.
        least_log_tilt: scatter of a trial at least, of the logarithm of its largest tilt.
        moved: largest tilt above which a trial is one that responds [rad].
        least_error: standard error of a squared signal at least, as where nothing moves.
        jump: signal over that at the limit, at the smallest share, from which an effect jumps.
        least_signal: share of the squared signal at the limit that a squared signal counts for at
            least where a limit is interpolated.
        penalty: of the regression of responses on nuisances.
    """

    shares: tuple[float, ...] = (1.0, 0.25, 0.0625, 0.015625, 0.00390625, 0.0009765625)
    turned: float = 0.25
    trials: int = 40
    part: float = 0.25
    fewest: int = 12
    plain: int = 48
    fewest_plain: int = 24
    draws: int = 8
    signal: float = 3.0
    most: float = 3.0
    least_scatter: float = 0.3
    least_log_tilt: float = 1e-3
    moved: float = 0.01
    least_error: float = 1.0
    jump: float = 1.0
    least_signal: float = 1e-2
    penalty: float = 1.0


LOOK = LookConstants()


@dataclass(frozen=True)
class Limit:
    """Of one side of a parameter's null, where it acts alone.

    Attributes:
        share: of the range at which the campaign shows the effect; above 1: not within the range.
        jumps: whether responses jump beside the null.
    """

    share: float
    jumps: bool


Limits = Mapping[tuple[str, str, Side], Limit]
"""By effect, primary parameter and side of its null: see :func:`parameter_sides`."""


def tried_parameters(library: Library) -> tuple[tuple[str, str, Side], ...]:
    """Of all limits: effect, primary parameter and side of its null."""
    return tuple(
        (name, parameter.name, side)
        for name, effect in library.items()
        for parameter in primary_parameters(effect)
        for side in parameter_sides(parameter)
    )


def limits_at(limits: Limits, effect: Effect, side: Side) -> tuple[Limit, ...]:
    """Those of an effect's primary parameters on one side; of one with one side alone, that one."""
    return tuple(
        limits[effect.name, p.name, side if two_sided(p) else 1] for p in primary_parameters(effect)
    )


@dataclass(frozen=True, eq=False)
class Look:
    """What the look found.

    Attributes:
        limits: by effect, primary parameter and side of its null.
        responding: indices of the trials that lift off in some draw, rising.
    """

    limits: Limits
    responding: NDArray[np.int64]

    def spread(self, count: int) -> NDArray[np.int64]:
        """So many of the responding trials; all, where there are no more."""
        return spread(self.responding, count)


def spread(trials: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """So many of some trials, spread over them; all, where there are no more.

    Those whose multiples of the golden ratio have the least fractions: so they keep no step with a
    schedule that repeats itself (H. Weyl, 1916), and fewer are a part of more.
    """
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    fractions = ratio * np.arange(trials.size) % 1.0
    return np.asarray(trials[np.argsort(np.argsort(fractions)) < count])


def tries(library: Library) -> int:
    """Simulations under effects of each trial on which they are tried."""
    return 2 * len(LOOK.shares) * len(tried_parameters(library))


def most_tried(trials: int) -> int:
    """Trials of a campaign on which effects are tried at most."""
    return max(LOOK.trials, math.ceil(LOOK.part * trials))


def look(
    cache: SimulationCache,
    trials: int,
    *,
    among: int | None = None,
    most: int | None = None,
    plain: int = LOOK.plain,
    seed: int = 0,
    progress: Progress | None = None,
) -> Look:
    """Try every primary parameter of every effect at a few sizes, each alone.

    The response is the logarithm of the largest tilt, 1 rad for a rock that overturns, whatever the
    tier, so that all tiers share their simulations. Each trial is tried under two draws of
    nuisances, and the signal is that of the product of the two changes: chance has no part in it.
    Its metric is the covariance that nuisances leave, by linear regression on them.

    Args:
        cache: of simulations.
        trials: of the campaign.
        among: so many of them alone, spread over those that lift off in the first draw; None: all.
            The others are as if they had not been run.
        most: trials on which effects are tried; None: :func:`most_tried`.
        plain: draws of nuisances without effect.
        seed: of the secondary parameters.
        progress: called with simulations done and all.
    """
    library, simulator = cache.simulator.library, cache.simulator
    run = np.arange(trials)
    if among is not None and among < trials:
        lifts = _severity(cache.run([Request(i, (), 1, 1) for i in range(trials)]))
        lifting = np.flatnonzero(lifts > np.log(LOOK.moved))
        run = spread(lifting if lifting.size else run, among)
    requests = [Request(int(i), (), m, 1) for m in range(1, plain + 1) for i in run]
    bare = _severity(cache.run(requests)).reshape(plain, run.size)
    responding = np.flatnonzero(np.nanmax(bare, axis=0) > np.log(LOOK.moved))
    chosen = responding if responding.size else np.arange(run.size)
    tried = min(most_tried(run.size) if most is None else most, chosen.size)
    chosen = chosen[np.linspace(0, chosen.size - 1, tried).astype(int)]
    ladders = _ladders(library, len(chosen), seed)
    requests = [
        Request(int(run[trial]), ((name, values),), m, 1)
        for (name, _, _), ladder in ladders.items()
        for step in ladder.steps
        for i, (trial, values) in enumerate(zip(chosen, step, strict=True))
        for m in _draws(i)
    ]
    found = _severity(cache.run(requests, progress=progress))
    scatter = np.nanstd(bare[:, chosen], axis=0)
    least = max(LOOK.least_scatter * float(np.median(scatter)), LOOK.least_log_tilt)
    scatter = np.maximum(scatter, least)
    own = np.array([[bare[m - 1, t] for m in _draws(i)] for i, t in enumerate(chosen)])
    moved = found.reshape(len(ladders), len(LOOK.shares), chosen.size, 2)
    change = np.nan_to_num((moved - own) / scatter[:, None])
    change = np.clip(change, -LOOK.most, LOOK.most)
    nuisances = np.stack([simulator.nuisance_draw(m) for m in range(1, plain + 1)])
    known = np.nan_to_num((bare[:, chosen] - np.nanmean(bare[:, chosen], axis=0)) / scatter)
    response = ridge(nuisances, known, LOOK.penalty)
    metric = np.linalg.inv(np.eye(chosen.size) + response.T @ response)
    parts = change[..., 0] * (change[..., 1] @ metric)
    scale = max(responding.size, 1) / chosen.size
    signal, error = scale * parts.sum(axis=2), scale * parts.std(axis=2) * np.sqrt(chosen.size)
    measured = zip(ladders.items(), signal, error, strict=True)
    limits = {key: _limit(squared, own, ladder.shares) for (key, ladder), squared, own in measured}
    return Look(limits, run[responding])


class _Ladder(NamedTuple):
    """Sizes at which a parameter is tried.

    Attributes:
        shares: of its range, falling.
        steps: values of the effect's parameters, of each share and trial.
    """

    shares: Array
    steps: list[list[tuple[float, ...]]]


def _ladders(library: Library, trials: int, seed: int) -> dict[tuple[str, str, Side], _Ladder]:
    """Of each primary parameter alone, on each side of its null.

    Secondary parameters are drawn, and are the same for all parameters of an effect.
    """
    rng = generator(seed, Stream.LOOK)
    out = {}
    for name, effect in library.items():
        primary = primary_parameters(effect)
        alone = np.eye(len(primary))
        shape = (len(LOOK.shares), trials, len(free_parameters(effect)) - len(primary))
        for side in sides(effect):
            secondary = rng.random(shape).tolist()
            for k, parameter in enumerate(primary):
                if side not in parameter_sides(parameter):
                    continue
                shares = np.array(LOOK.shares) * (LOOK.turned if is_angle(parameter) else 1.0)
                steps = [
                    [values_at(effect, side, (share * alone[k]).tolist(), one) for one in drawn]
                    for share, drawn in zip(shares, secondary, strict=True)
                ]
                out[name, parameter.name, side] = _Ladder(shares, steps)
    return out


def _draws(i: int) -> tuple[int, int]:
    """The two draws of nuisances of the i-th trial."""
    return 1 + i % LOOK.draws, 1 + LOOK.draws + i % LOOK.draws


def _severity(found: Responses) -> Array:
    """Logarithm of the largest tilt [rad], 1 rad for a rock that overturned."""
    tilt = np.where(found.overturned > 0.5, 1.0, np.clip(found.peak_tilt, OBSERVED.least_tilt, 1.0))
    return np.where(np.isfinite(found.overturned), np.log(tilt), np.nan)


def _limit(squared: Array, error: Array, tried: Array) -> Limit:
    """Share at which the signal reaches the limit, by interpolation of logarithms.

    A signal does not fall with the share, so all shares have one isotonic fit, weighted by their
    errors: a trial that happens to flip under both draws is no signal.

    Args:
        squared: signals at these shares, squared.
        error: standard errors of these.
        tried: shares of the range, falling.
    """
    from scipy.optimize import isotonic_regression

    weights = 1 / (error**2 + LOOK.least_error**2)
    fitted = isotonic_regression(squared[::-1], weights=weights[::-1]).x
    rising = np.maximum(fitted, 1e-6)
    shares, wanted = np.log(tried[::-1]), LOOK.signal**2
    jumps = bool(rising[0] > LOOK.jump**2 * wanted)
    if rising[-1] < wanted:
        return Limit(float(tried[0] * np.sqrt(wanted / rising[-1])), jumps)
    k = int(np.argmax(rising >= wanted))
    if k == 0:
        return Limit(float(np.exp(shares[0])), jumps)
    low, high = np.log(max(rising[k - 1], LOOK.least_signal * wanted)), np.log(rising[k])
    part = (np.log(wanted) - low) / max(high - low, 1e-9)
    return Limit(float(np.exp(shares[k - 1] + part * (shares[k] - shares[k - 1]))), jumps)
