"""The posterior over the sets of one library's effects, given that the cause is in the library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.library import Library
from vsr2.posterior.calibration import best_temperature, pooled
from vsr2.posterior.effect_curves import Curves, fit_curves
from vsr2.posterior.network import Network, SetOutputs, train_network
from vsr2.posterior.outside import left_over
from vsr2.posterior.second_cause import SecondCause, fit_second_cause, refined
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY, Floats, Summaries, fit_summaries
from vsr2.posterior.truth import Truth

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class TrainingConstants:
    """How much is trained; chosen by hand.

    Attributes:
        copies: disturbed copies of each campaign.
        passed: copies of each campaign in one pass of training.
        seeds: networks that are trained for each fold.
        added_scale: to the standard deviation by which each summary is divided, which may be 0.
    """

    copies: int = 4
    passed: int = 2
    seeds: int = 2
    added_scale: float = 1e-6


TRAINING = TrainingConstants()


@dataclass(frozen=True, eq=False)
class WithinLibrary:
    """What is learned of a library.

    Attributes:
        sets: hypotheses; the probability of a cause outside is 0 here.
        alike: which effects are declared alike, shape (effects, effects).
        summaries: of residuals.
        centre, scale: of summaries, shape (summaries,).
        networks: as many for each fold.
        curves: of the effects, one a fold; none where all campaigns are without effect, or none is.
        judges: of a second cause, one a fold; none where no two effects may act together.
        temperature: by which log probabilities are divided.
    """

    sets: Sets
    alike: Bools
    summaries: Summaries
    centre: Array
    scale: Array
    networks: tuple[Network, ...]
    curves: tuple[Curves, ...]
    judges: tuple[SecondCause, ...]
    temperature: float

    def inputs(self, summaries: Array) -> Array:
        """Of the networks: standardised summaries, shape (n, summaries)."""
        return np.asarray((summaries - self.centre) / self.scale)

    def of_fold(self, fold: int, networks: tuple[Network, ...] = ()) -> WithinLibrary:
        """By the networks, curves and judges that did not see the campaigns of a fold.

        Args:
            fold: that they did not see.
            networks: in place of its networks, where there is not one a fold.
        """
        seeds = len(self.networks) // SUMMARY.folds
        own = self.networks[seeds * fold : seeds * (fold + 1)]
        return replace(
            self,
            networks=networks or own,
            curves=self.curves[fold : fold + 1],
            judges=self.judges[fold : fold + 1],
        )

    def pooled(self, summaries: Array) -> Array:
        """Probability of every set by the networks, shape (n, sets)."""
        inputs = self.inputs(summaries)
        logs = np.stack([one.log_probability(inputs) for one in self.networks])
        return pooled(logs, self.temperature)

    def refined(self, probability: Array, summaries: Array) -> Array:
        """The same, and what acts beside the effect that leads, shape (n, sets).

        Args:
            probability: by the networks, shape (n, sets).
            summaries: shape (n, summaries).
        """
        targets = self.summaries.effect.size
        return np.array(
            [
                refined(p, self.sets, self.alike, own[:targets], self.judges)
                for p, own in zip(probability, summaries, strict=True)
            ]
        ).reshape(probability.shape)

    def left_over(self, residuals: Array) -> Array:
        """What the curves leave over of new campaigns, shape (n, most + 1).

        It is the mean over folds, each with its own regression: those of all folds together scatter
        less, so that less would be left over than of the campaigns that it is learned on.

        Args:
            residuals: shape (n, columns).
        """
        found = [
            left_over(one, self.summaries.discriminants(residuals, k), self.sets.most)
            for k, one in enumerate(self.curves)
        ]
        return np.mean(found, axis=0) if found else np.zeros((len(residuals), self.sets.most + 1))


@dataclass(frozen=True, eq=False)
class OutOfFold:
    """Campaigns on which a library was learned, each by what did not see it.

    Attributes:
        summaries: of the last copy, shape (n, summaries).
        outputs: of the networks, of that copy.
        left: what the curves leave over of that copy, shape (n, most + 1).
    """

    summaries: Array
    outputs: SetOutputs
    left: Array


def learned(
    residuals: Sequence[Floats],
    campaigns: Campaigns,
    library: Library,
    truth: Truth,
    fold: Rows,
    trials: int,
    seed: int,
) -> tuple[WithinLibrary, OutOfFold]:
    """Learn a library from simulated campaigns.

    Args:
        residuals: of each copy of the campaigns, undisturbed and disturbed, shape (n, columns).
        campaigns: simulated.
        library: effects.
        truth: of the campaigns.
        fold: group of each campaign.
        trials: of a campaign.
        seed: of the training.
    """
    summaries, copies = fit_summaries(residuals, campaigns, truth.sets.names, fold, trials)
    found = np.stack(copies)
    own = _scaled(summaries, found, truth)
    networks, outputs = _networks(own, found, truth, fold, seed)
    own = replace(own, networks=networks, temperature=best_temperature(outputs, truth))
    discriminants = found[:, :, : summaries.effect.size]
    own = replace(own, curves=fit_curves(discriminants, campaigns, library, fold))

    def probability(copy: int, rows: Rows) -> Array:
        return own.of_fold(int(fold[rows[0]])).pooled(found[copy, rows])

    judges = fit_second_cause(discriminants, own.curves, truth, fold, probability)
    own = replace(own, judges=judges)
    return own, OutOfFold(found[-1], outputs, held_out_left(own, found[-1], fold))


def learned_of_part(
    residuals: Sequence[Floats],
    campaigns: Campaigns,
    library: Library,
    truth: Truth,
    fold: Rows,
    known: WithinLibrary,
    among: Rows,
    rng: np.random.Generator,
) -> tuple[WithinLibrary, Array]:
    """Learn a part of a library, by one network, from campaigns in which nothing else acts.

    Temperature and judges of a second cause, which do not depend on the effects, are those of the
    whole library.

    Args:
        residuals: of each copy of all campaigns, shape (n, columns).
        campaigns: those in which nothing else acts.
        library: the part.
        truth: of these campaigns.
        fold: group of each of these.
        known: the whole library.
        among: indices of the campaigns among all of them.
        rng: of the network.

    Returns:
        What is learned; summaries of the last copy of these campaigns, each by what did not see it.
    """
    summaries, copies = fit_summaries(
        residuals, campaigns, truth.sets.names, fold, known.summaries.trials, among
    )
    found = np.stack(copies)
    own = _scaled(summaries, found, truth)
    network = _network(own, found, truth, fold, 0, rng)
    discriminants = found[:, :, : summaries.effect.size]
    curves = fit_curves(discriminants, campaigns, library, fold)
    pairs = len(truth.sets.by_size) > 1
    judged = zip(known.judges, curves, strict=False) if pairs else ()
    judges = tuple(replace(judge, curves=one) for judge, one in judged)
    own = replace(
        own, networks=(network,), curves=curves, judges=judges, temperature=known.temperature
    )
    return own, found[-1]


def held_out_left(own: WithinLibrary, summaries: Array, fold: Rows) -> Array:
    """What the curves of each campaign's fold leave over, shape (n, most + 1)."""
    out, targets = np.zeros((len(fold), own.sets.most + 1)), own.summaries.effect.size
    for k, curves in enumerate(own.curves):
        rows = np.flatnonzero(fold == k)
        out[rows] = left_over(curves, summaries[rows, :targets], own.sets.most)
    return out


def _scaled(summaries: Summaries, found: Array, truth: Truth) -> WithinLibrary:
    """With what networks see, before there are any.

    Args:
        summaries: of residuals.
        found: of each copy, shape (copies, n, summaries).
        truth: of the campaigns.
    """
    everything = found.reshape(-1, found.shape[-1])
    scale = everything.std(axis=0) + TRAINING.added_scale
    return WithinLibrary(
        truth.sets, truth.alike, summaries, everything.mean(axis=0), scale, (), (), (), 1.0
    )


def _networks(
    own: WithinLibrary, found: Array, truth: Truth, fold: Rows, seed: int
) -> tuple[tuple[Network, ...], SetOutputs]:
    """Networks of each fold, and what they make of the last copy of campaigns they did not see.

    Args:
        own: how summaries are.
        found: summaries of each copy, shape (copies, n, summaries).
        truth: of the campaigns.
        fold: group of each campaign.
        seed: of the training.
    """
    networks: list[Network] = []
    outputs = np.zeros((TRAINING.seeds, len(fold), truth.sets.parts.shape[1]))
    for k in range(SUMMARY.folds):
        held = np.flatnonzero(fold == k)
        inputs = own.inputs(found[-1][held])
        for i in range(TRAINING.seeds):
            rng = generator(seed, Stream.WEIGHTS, len(networks))
            networks.append(_network(own, found, truth, fold, k, rng))
            outputs[i, held] = networks[-1].outputs(inputs)
    return tuple(networks), SetOutputs(truth.sets, outputs)


def _network(
    own: WithinLibrary,
    found: Array,
    truth: Truth,
    fold: Rows,
    held_out: int,
    rng: np.random.Generator,
) -> Network:
    """One, trained on the campaigns of all folds but one, by which training is stopped."""
    rows, held = np.flatnonzero(fold != held_out), np.flatnonzero(fold == held_out)

    def batches(draw: np.random.Generator) -> tuple[Array, Rows, Array]:
        chosen = draw.permutation(np.concatenate([rows] * TRAINING.passed))
        copy = draw.integers(0, len(found), chosen.size)
        return own.inputs(found[copy, chosen]), truth.index[chosen], truth.weight[chosen]

    judged = (own.inputs(found[1][held]), truth.index[held], truth.weight[held])
    return train_network(truth.sets, batches, judged, rng)
