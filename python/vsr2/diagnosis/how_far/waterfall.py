"""The waterfall: by how much each cause shrinks the loss on motions that were not seen.

Motions are dealt into groups. For each group the posterior is trained and applied without it, so
that neither what acts nor its parameters know these trials. Then they are simulated with sets of
effects, and parameters, drawn from that posterior. Of a draw the effects that are to be judged are
kept or left out: the losses of all choices of effects tell what each adds, in every order. The mean
over orders is its share (L. S. Shapley, "A value for n-person games", 1953).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.shapley import mean_gain, shapley_share
from vsr2.diagnosis.how_far.ensemble_losses import (
    LossInterval,
    interval,
    resampled_means,
    share_of_gap,
    simulated_loss,
)
from vsr2.diagnosis.how_far.held_out import (
    HELD_OUT,
    ensemble,
    motion_groups,
    parameter_values,
)
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.cache import Progress, SimulationCache
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.simulator import Effects
from vsr2.posterior.training import Found, Posterior, train

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WaterfallConstants:
    """How causes are judged; chosen by hand.

    Attributes:
        effects: that are judged one by one, the most probable ones.
        choices: of effects of a draw that differ, about: a draw seldom holds all that are judged.
        nuisances: draw of the nuisances of the first simulation.
        replicate: of starts and noise there.
    """

    effects: int = 4
    choices: int = 5
    nuisances: int = 700
    replicate: int = 3


WATERFALL = WaterfallConstants()


def simulations(trials: int) -> int:
    """That the waterfall asks for, about."""
    return WATERFALL.choices * HELD_OUT.members * trials


@dataclass(frozen=True, eq=False)
class FullInference:
    """What all trials together tell, by which the effects to judge are chosen.

    Attributes:
        posterior: trained for all of them.
        found: inference on the campaign.
    """

    posterior: Posterior
    found: Found


@dataclass(frozen=True, eq=False)
class Waterfall:
    """Losses of every trial that was simulated, on motions not seen.

    Attributes:
        names: effects that are judged.
        losses: with each choice of them, shape (2^names, trials); bit i of the row is effect i.
        everything: with all effects of the posterior, shape (trials,).
        probability: of overturning then, shape (trials,).
        floor: shape (trials,).
        motion: of each trial, shape (trials,).
    """

    names: tuple[str, ...]
    losses: Array
    everything: Array
    probability: Array
    floor: Array
    motion: NDArray[np.int64]

    @cached_property
    def _means(self) -> Array:
        """Mean losses, then those of each replicate, shape (1 + replicates, choices + 2)."""
        values = np.vstack([self.losses, self.everything, self.floor])
        drawn = resampled_means(values, self.motion, replicates=HELD_OUT.resamples)
        return np.vstack([values.mean(axis=1), drawn])

    def loss(self, names: Sequence[str]) -> LossInterval:
        """Mean loss with some of the effects."""
        return interval(self._means[:, sum(1 << self.names.index(name) for name in names)])

    def loss_of_everything(self) -> LossInterval:
        """Mean loss with all effects of the posterior."""
        return interval(self._means[:, -2])

    def loss_of_floor(self) -> LossInterval:
        """Mean loss of campaigns without a gap."""
        return interval(self._means[:, -1])

    def closure(self) -> LossInterval:
        """Share of the gap that is closed with all effects of the posterior."""
        means = self._means
        return share_of_gap(means[:, 0] - means[:, -2], means[:, 0] - means[:, -1])

    def share(self, name: str) -> LossInterval:
        """What an effect takes off the mean loss, on average over all orders [nat a trial]."""
        return interval(shapley_share(self._by_names, name))

    def ends(self, name: str) -> tuple[LossInterval, LossInterval]:
        """The same where it comes first of all, and last of all."""
        first, last = (mean_gain(self._by_names, name, n) for n in (0, len(self.names) - 1))
        return interval(first), interval(last)

    @cached_property
    def _by_names(self) -> dict[frozenset[str], Array]:
        """Mean losses by which effects act, each of shape (1 + replicates,)."""
        return {
            frozenset(name for i, name in enumerate(self.names) if choice >> i & 1): row
            for choice, row in enumerate(self._means.T[:-2])
        }

    def order(self) -> tuple[str, ...]:
        """Effects by their shares, the greatest first."""
        return tuple(sorted(self.names, key=lambda name: -self.share(name).value))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        order = self.order()
        return {
            "effects": [
                {
                    "name": name,
                    "share": self.share(name).to_json(),
                    "first": self.ends(name)[0].to_json(),
                    "last": self.ends(name)[1].to_json(),
                }
                for name in order
            ],
            "steps": [
                {"effects": list(order[:k]), "loss": self.loss(order[:k]).to_json()}
                for k in range(len(order) + 1)
            ],
            "everything": self.loss_of_everything().to_json(),
            "floor": self.loss_of_floor().to_json(),
            "closure": self.closure().to_json(),
        }


def waterfall(
    cache: SimulationCache,
    seen: Observations,
    trials: NDArray[np.int64],
    campaigns: Campaigns,
    full: FullInference,
    floor: Array,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Waterfall:
    """Judge the most probable effects one by one, on motions that were not seen.

    An effect that acts in no simulated campaign is neither drawn nor judged: its parameters are not
    known.

    Args:
        cache: of simulations.
        seen: the observed campaign.
        trials: indices of those simulated.
        campaigns: simulated, of these trials.
        full: inference on all trials.
        floor: loss of each trial without a gap, shape (trials,).
        seed: of draws.
        progress: called with choices of effects done and all.
    """
    posterior = full.posterior
    motion, outcome = seen.motion[trials], seen.overturned[trials]
    acts = posterior.sets.marginal(full.found.probability)
    known = posterior.parameters.known
    likely = [posterior.sets.names[k] for k in np.argsort(-acts, kind="stable") if acts[k] > 0]
    names = tuple(name for name in likely if name in known)[: WATERFALL.effects]
    group = motion_groups(motion, outcome)
    members: list[list[Effects]] = [[] for _ in trials]
    for k in np.unique(group):
        own = np.flatnonzero(group == k)
        drawn = _drawn_sets(seen, trials, campaigns, full, group != k, seed)
        for i in own:
            members[i] = drawn
    draws = range(WATERFALL.nuisances, WATERFALL.nuisances + HELD_OUT.members)
    features = seen.features[trials]

    def simulated(kept: set[str] | None) -> tuple[Array, Array]:
        """Loss and probability with some effects of each draw; None: all."""
        chosen = [
            [tuple(one for one in own if kept is None or one[0] in kept) for own in drawn]
            for drawn in members
        ]
        noise = generator(seed, Stream.WATERFALL_NOISE)
        result = ensemble(cache, seen, trials, chosen, draws, WATERFALL.replicate, noise)
        return simulated_loss(result, result.probability, outcome, features), result.probability

    losses = []
    choices = 1 << len(names)
    for choice in range(choices):
        losses.append(simulated({n for i, n in enumerate(names) if choice >> i & 1})[0])
        if progress is not None:
            progress(choice + 1, choices + 1)
    everything, probability = simulated(None)
    return Waterfall(names, np.stack(losses), everything, probability, floor, motion)


def _drawn_sets(
    seen: Observations,
    trials: NDArray[np.int64],
    campaigns: Campaigns,
    full: FullInference,
    known: NDArray[np.bool_],
    seed: int,
) -> list[Effects]:
    """Effects with parameters, drawn from the posterior that some trials give."""
    own = trials[known]
    # What acts in no simulated campaign cannot be drawn: nothing is known of its parameters.
    parameters = full.posterior.parameters
    library = {n: one for n, one in parameters.library.items() if n in parameters.known}
    part = train(
        seen, campaigns.of_trials(known), library, own,
        most=full.posterior.sets.most, seed=seed,
    )  # fmt: skip
    found = part.infer(seen.overturned[own], seen.features[own])
    rng = generator(seed, Stream.WATERFALL)
    chosen = rng.choice(found.probability.size, HELD_OUT.members, p=found.probability)
    held = part.sets.members[chosen]
    acting = [n for k, n in enumerate(part.sets.names) if held[:, k].any()]
    samples = {n: part.parameters.sample(n, found.residuals, rng) for n in acting}
    out: list[Effects] = []
    for m, row in enumerate(held):
        effects = []
        for k in np.flatnonzero(row):
            name = part.sets.names[k]
            effects.append((name, parameter_values(library[name], samples[name][m])))
        out.append(tuple(effects))
    return out
