"""Simulated campaigns: what acts in each is drawn from a prior over sets of effects."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import (
    Library,
    Side,
    free_parameters,
    primary_parameters,
    sides,
    values_at,
)
from vsr2.ensemble.simulated.look import LOOK, Limits, Look, limits_at
from vsr2.ensemble.simulated.simulator import Effects, Request

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SetPrior:
    """What acts in a simulated campaign; chosen by hand.

    Attributes:
        none: share of campaigns without effect.
        two: share of campaigns with two effects, where two may act at most.
        one_of_several: share of campaigns with one effect, where more may act; more effects are as
            frequent as two.
        least, most: ends of the size of an effect, log-uniform, in detection limits.
        beyond: share of draws whose size lies beyond these, log-uniform to the prior's end, so that
            the largest are known, too.
        least_share: of an effect's range, where it jumps beside its null.
        alone: share of an effect's draws in which one of its primary parameters acts alone.
        prior_share: of an effect's draws in which parameters whose full range counts come from
            their prior as it stands, instead of a size in detection limits.
    """

    none: float = 0.1
    two: float = 0.3
    one_of_several: float = 0.2
    least: float = 0.4
    most: float = 16.0
    beyond: float = 0.2
    least_share: float = 1 / 256
    alone: float = 0.5
    prior_share: float = 0.5

    def sizes(self, most: int) -> tuple[float, ...]:
        """Shares of campaigns with none, one, ... effects, where at most so many act."""
        if most == 1:
            return self.none, 1 - self.none
        if most == 2:
            return self.none, 1 - self.none - self.two, self.two
        larger = (1 - self.none - self.one_of_several) / (most - 1)
        return self.none, self.one_of_several, *[larger] * (most - 1)


SET_PRIOR = SetPrior()
FIRST_NUISANCE = 1000
"""Draw of the nuisances of the first campaign."""


@dataclass(frozen=True)
class Acting:
    """One effect of a simulated campaign.

    Attributes:
        name: of the effect.
        side: of its null.
        size: in detection limits.
        values: of its parameters.
    """

    name: str
    side: Side
    size: float
    values: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Campaigns:
    """Simulated campaigns, one row each, all trials simulated.

    Attributes:
        sets: what acts in each, in the library's order.
        nuisances: standardised, shape (rows, q).
        overturned: shape (rows, trials), NaN where unknown.
        peak_tilt: [rad], shape (rows, trials).
        features: of the series, in single precision, shape (rows, trials, k); None: not simulated.
    """

    sets: tuple[tuple[Acting, ...], ...]
    nuisances: Array
    overturned: Array
    peak_tilt: Array
    features: NDArray[np.float32] | None

    def __len__(self) -> int:
        return len(self.sets)

    def joined(self, other: Campaigns) -> Campaigns:
        """These and others of the same trials."""
        series = None
        if self.features is not None and other.features is not None:
            series = np.concatenate([self.features, other.features])
        return Campaigns(
            self.sets + other.sets,
            np.concatenate([self.nuisances, other.nuisances]),
            np.concatenate([self.overturned, other.overturned]),
            np.concatenate([self.peak_tilt, other.peak_tilt]),
            series,
        )

    def of_trials(self, kept: NDArray[np.bool_]) -> Campaigns:
        """Some trials of each campaign, shape (trials,)."""
        series = None if self.features is None else self.features[:, kept]
        return Campaigns(
            self.sets, self.nuisances, self.overturned[:, kept], self.peak_tilt[:, kept], series
        )

    def within(self, names: Collection[str]) -> Campaigns:
        """Those in which no other effects act than some."""
        known = [all(one.name in names for one in acting) for acting in self.sets]
        return self if all(known) else self.chosen(np.flatnonzero(known))

    def chosen(self, rows: NDArray[np.int64]) -> Campaigns:
        """Some campaigns, by their indices."""
        series = None if self.features is None else self.features[rows]
        return Campaigns(
            tuple(self.sets[k] for k in rows),
            self.nuisances[rows],
            self.overturned[rows],
            self.peak_tilt[rows],
            series,
        )

    @cached_property
    def gap_free(self) -> NDArray[np.bool_]:
        """Which have no effect, shape (rows,)."""
        return np.array([not acting for acting in self.sets])


def insensitive(library: Library, limits: Limits) -> tuple[str, ...]:
    """Effects that reach less than the least size anywhere: campaigns do not show them."""
    return tuple(
        name
        for name, effect in library.items()
        if not any(_reached(limits, effect, side).any() for side in sides(effect))
    )


def _reached(limits: Limits, effect: Effect, side: Side) -> NDArray[np.bool_]:
    """Which primary parameters reach the least size on a side, shape (parameters,)."""
    return np.array([x.share * SET_PRIOR.least <= 1 for x in limits_at(limits, effect, side)])


def draw_acting(
    library: Library,
    name: str,
    limits: Limits,
    rng: np.random.Generator,
) -> Acting:
    """An effect on either side of its null, at a size that is log-uniform in detection limits.

    One of its primary parameters carries the size, of those that reach the least one. It acts alone
    in a part of the draws, see `SET_PRIOR.alone`; in others each further one has a part of the
    size, in its own detection limits, or of its range, where that ends before. Some draws are
    larger, up to the prior's end: see
    `SET_PRIOR.beyond`. Parameters whose full range counts (`Parameter.full_range`) come from their
    prior as it stands in half of the draws in which they act. The size is that of the parameter
    farthest beyond its limit.
    """
    effect = library[name]
    reached = [s for s in sides(effect) if _reached(limits, effect, s).any()]
    side = int(rng.choice(reached or sides(effect)))
    own, primary = limits_at(limits, effect, side), primary_parameters(effect)
    limit = np.array([one.share for one in own])
    quantile, parts = rng.random(), rng.random(len(primary))
    shown = np.flatnonzero(_reached(limits, effect, side))
    carries = int(rng.choice(shown if shown.size else np.arange(len(primary))))
    if len(primary) > 1 and rng.random() < SET_PRIOR.alone:
        parts[:] = 0.0
    parts[carries] = 1.0
    first = own[carries]
    low = SET_PRIOR.least_share if first.jumps else SET_PRIOR.least * first.share
    high = min(1.0 if first.jumps else SET_PRIOR.most * first.share, 1.0)
    share = _log_uniform(min(low, high), high, quantile)
    secondary = rng.random(len(free_parameters(effect)) - len(primary)).tolist()
    full = np.array([parameter.full_range for parameter in primary]) & (parts > 0)
    from_prior = bool(full.any()) and rng.random() < SET_PRIOR.prior_share
    if not full.any() and high < 1 and rng.random() < SET_PRIOR.beyond:
        share = _log_uniform(high, 1.0, rng.random())
    # What jumps beside its null has no size in limits; what acts beside it has one all the same.
    relative = limit * SET_PRIOR.most / share if first.jumps else limit / first.share
    relative[carries] = 1.0
    shares = parts * np.minimum(share * relative, 1.0)
    if from_prior:
        shares[full] = rng.random(int(full.sum()))
    values = values_at(effect, side, shares.tolist(), secondary)
    return Acting(name, side, float((shares / limit).max()), values)


def _log_uniform(low: float, high: float, quantile: float) -> float:
    """Value at a quantile of the log-uniform distribution between two ends above 0."""
    return float(np.exp(np.log(low) + quantile * (np.log(high) - np.log(low))))


def draw_set(
    library: Library,
    limits: Limits,
    index: int,
    seed: int,
    most: int = HYPOTHESIS.usual_effects,
) -> tuple[Acting, ...]:
    """What acts in a campaign, each effect about as often.

    Args:
        library: of effects.
        limits: by effect, parameter and side.
        index: of the campaign; any can be drawn alone.
        seed: of all draws.
        most: effects that may act together.
    """
    names = [name for name in library if name not in insensitive(library, limits)]
    rng = generator(seed, Stream.CAUSES, index)
    kind = rng.random()
    if not names or kind < SET_PRIOR.none:
        return ()
    deck = generator(seed, Stream.DECK, index // len(names)).permutation(len(names))
    chosen = [int(deck[index % len(names)])]
    ends = np.cumsum(SET_PRIOR.sizes(most))
    for _ in range(min(int((kind > ends[1:-1]).sum()), len(names) - 1)):
        chosen.append(int(rng.choice(np.delete(np.arange(len(names)), chosen))))
    return tuple(draw_acting(library, names[i], limits, rng) for i in sorted(chosen))


def effects_of(acting: Sequence[Acting]) -> Effects:
    """As a simulator takes them."""
    return tuple((one.name, one.values) for one in acting)


def simulate_campaigns(
    cache: SimulationCache,
    found: Look,
    trials: NDArray[np.int64],
    rows: Sequence[int],
    *,
    most: int = HYPOTHESIS.usual_effects,
    seed: int = 0,
) -> Campaigns:
    """Simulate complete campaigns, each with nuisances and a contact model of its own.

    Args:
        cache: of simulations.
        found: detection limits.
        trials: indices of those simulated.
        rows: numbers of the campaigns.
        most: effects that may act together.
        seed: of the draws.
    """
    library = cache.simulator.library
    sets = tuple(draw_set(library, found.limits, c, seed, most) for c in rows)
    return _simulated(cache, trials, sets, [FIRST_NUISANCE + c for c in rows])


def plain_campaigns(
    cache: SimulationCache, trials: NDArray[np.int64], count: int = LOOK.plain
) -> Campaigns:
    """The gap-free campaigns that the look simulated."""
    return _simulated(cache, trials, ((),) * count, range(1, count + 1))


def _simulated(
    cache: SimulationCache,
    trials: NDArray[np.int64],
    sets: tuple[tuple[Acting, ...], ...],
    draws: Sequence[int],
) -> Campaigns:
    responses = cache.run(
        [
            Request(int(trial), effects_of(acting), draw, 1)
            for draw, acting in zip(draws, sets, strict=True)
            for trial in trials
        ]
    )
    shape = (len(sets), trials.size)
    series = responses.features
    return Campaigns(
        sets,
        np.stack([cache.simulator.nuisance_draw(draw) for draw in draws]),
        responses.overturned.reshape(shape),
        responses.peak_tilt.reshape(shape),
        None if series is None else series.astype(np.float32).reshape(*shape, -1),
    )
