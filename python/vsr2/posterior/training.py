"""Training of the posterior on simulated campaigns, and its calibration on those held out."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.linear_algebra import one_blas_thread
from vsr2.one_line import counted
from vsr2.posterior.calibration import (
    Levels,
    Refine,
    acting_probability,
    best_temperature,
    calibrate,
    held_out_findings,
    pooled,
)
from vsr2.posterior.discrepancy import Disturbance
from vsr2.posterior.effect_curves import Curves
from vsr2.posterior.goodness_of_fit import LibraryFit, misfit, misfits_by, tail_probability
from vsr2.posterior.naming import Naming, candidates, decide
from vsr2.posterior.network import Network, SetOutputs, train_network
from vsr2.posterior.parameters import Parameters, fit_parameters
from vsr2.posterior.second_cause import fit_curves, refined
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY, Standard, Standards, Summaries, fit_summaries
from vsr2.posterior.truth import PRIOR, Truth, left_out_together

_logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Singles = NDArray[np.float32]


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
class Found:
    """Inference on one campaign.

    Attributes:
        probability: of every set, shape (sets,).
        residuals: standardised, shape (columns,).
        summaries: shape (summaries,).
        fit: tail probability of the campaign among simulated ones without effect.
        library_fit: tail probability of what the library leaves unexplained, among simulated ones.
        naming: what is said.
    """

    probability: Array
    residuals: Array
    summaries: Array
    fit: float
    library_fit: float
    naming: Naming


@dataclass(frozen=True, eq=False)
class Posterior:
    """The trained posterior of one protocol at one tier.

    Attributes:
        sets: hypotheses.
        standard, summaries: from campaigns to summaries.
        centre, scale: of summaries, shape (summaries,).
        networks: some a fold.
        curves: of the effects, one a fold, by which the one that leads is fitted; none where no two
            effects may act together.
        levels: calibrated.
        parameters: of effects.
        alike: which effects are declared alike, shape (effects, effects).
        gap_free: residuals of campaigns without effect, disturbed, in single precision, shape (n,
            columns).
        misfits: of campaigns without effect, disturbed and held out, rising, shape (n,).
        library_fit: what it leaves unexplained of simulated campaigns.
        campaigns: number that it was trained on.
        excused: misfit up to which campaigns fit, as those of references do.
    """

    sets: Sets
    standard: Standard
    summaries: Summaries
    centre: Array
    scale: Array
    networks: tuple[Network, ...]
    curves: tuple[Curves, ...]
    levels: Levels
    parameters: Parameters
    alike: Bools
    gap_free: Singles
    misfits: Array
    library_fit: LibraryFit
    campaigns: int
    excused: float = 0.0

    @one_blas_thread()
    def infer(self, overturned: Array, features: Array, excluded: Collection[str] = ()) -> Found:
        """Probability of every set, and what is said.

        Args:
            overturned: outcomes of the trials that were simulated, shape (trials,).
            features: shape (trials, k).
            excluded: effects that the library lacks for this campaign.
        """
        residuals = self.standard.residuals(overturned[None], features[None])
        summaries = self.summaries(residuals)
        allowed = ~np.isin(self.sets.names, list(excluded))[None]
        inputs = network_inputs(self, summaries, allowed)
        logs = np.stack([one.log_probability(inputs, allowed)[0] for one in self.networks])
        probability = pooled(logs, self.levels.temperature)
        if self.curves:
            effect = self.summaries.effect
            curves = [one.without(effect, allowed[0]) for one in self.curves]
            own = summaries[0, : effect.size]
            probability = refined(probability, self.sets, self.alike, allowed[0], own, curves)
        size = misfit(residuals)
        fit = 1.0 if size[0] <= self.excused else float(tail_probability(size, self.misfits)[0])
        acts = acting_probability(probability[None], self.sets)
        library_fit = float(
            self.library_fit.probability(*self.summaries.unexplained(summaries), acts)[0]
        )
        said = decide(
            candidates(probability, self.sets, self.alike),
            self.levels.naming,
            self.alike,
            fit=fit,
            library_fit=library_fit,
        )
        return Found(probability, residuals[0], summaries[0], fit, library_fit, said)

    def with_references(self, references: Sequence[Found]) -> Posterior:
        """The same, where campaigns that have no effect are known.

        Whatever has at least the probability of none that one of them has is no gap by the
        posterior, and whatever fits at least as well as one of them fits: so little comes without
        an effect.

        Args:
            references: inference on each of them.
        """
        none = min([self.levels.none_limit, *(float(one.probability[0]) for one in references)])
        excused = max([self.excused, *(float(misfit(one.residuals)) for one in references)])
        return replace(self, levels=replace(self.levels, none_limit=none), excused=excused)


def network_inputs(posterior: Posterior | _Scaled, summaries: Array, allowed: Bools) -> Array:
    """Standardised summaries, those of excluded effects 0, and which effects are excluded."""
    scaled = (summaries - posterior.centre) / posterior.scale
    effect = posterior.summaries.effect
    own = np.flatnonzero(effect >= 0)
    scaled[:, own] *= allowed[:, effect[own]]
    return np.concatenate([scaled, ~allowed], axis=1)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """What network inputs need of a posterior."""

    summaries: Summaries
    centre: Array
    scale: Array


def training_features(seen: Observations, campaigns: Campaigns, seed: int) -> Singles:
    """Features on which is trained, with the noise of measurements, in single precision.

    Args:
        seen: the observed campaign.
        campaigns: simulated, of the same trials.
        seed: of the training.
    """
    rng = generator(seed, Stream.TRAINING_NOISE)
    noted = seen.noted(campaigns.overturned, campaigns.peak_tilt, campaigns.features, rng)
    return noted.astype(np.float32, copy=False)


@one_blas_thread()
def train(
    seen: Observations,
    campaigns: Campaigns,
    library: Library,
    trials: NDArray[np.int64],
    *,
    most: int = HYPOTHESIS.usual_effects,
    seed: int = 0,
) -> Posterior:
    """Train on simulated campaigns.

    Args:
        seen: the observed campaign, for what its tier measures and with which noise.
        campaigns: simulated, of the same trials.
        library: effects, in the order of the hypotheses.
        trials: indices of those simulated.
        most: effects that may act together.
        seed: of everything random.
    """
    sets = Sets(tuple(library), most)
    plain, rng = campaigns.gap_free, generator(seed, Stream.COPIES)
    copies = _disturbed_copies(seen, campaigns, trials, seed, rng)
    fold = rng.permutation(len(campaigns)) % SUMMARY.folds
    standards = Standards.of(copies, plain, fold)
    misfits = misfits_by(standards, copies[1:], fold)
    # Features go as residuals come.
    residuals = [standards.by_all.residuals(*copies.pop(0)) for _ in range(len(copies))]
    summaries, found = fit_summaries(residuals, campaigns, sets.names, fold, len(trials))
    parameters = fit_parameters(library, campaigns, residuals[1])
    disturbed_plain = np.concatenate([one[plain] for one in residuals[1:]])
    del residuals
    everything = np.concatenate(found)
    scale = everything.std(axis=0) + TRAINING.added_scale
    scaled = _Scaled(summaries, everything.mean(axis=0), scale)
    truth = Truth.of(campaigns, sets, library)
    networks, outputs = _networks(scaled, np.stack(found), truth, fold, seed)
    gap_free_misfits = np.sort(misfits[:, plain], axis=None)
    temperature = best_temperature(outputs, truth)
    held_out = _HeldOut(networks, outputs, truth, fold)
    curves = _curves(scaled, np.stack(found), campaigns, library, held_out, temperature)
    refine = held_out.refinement(curves, found[-1], summaries.effect)
    judged = held_out_findings(outputs, truth, temperature, refine)
    # Of the copy that is judged.
    size, left = summaries.unexplained(found[-1])
    library_fit = LibraryFit.of(size, left, judged.acts[: len(campaigns)])
    fits = (
        tail_probability(misfits[-1], gap_free_misfits)[judged.row],
        library_fit.probability(size[judged.row], left[judged.row], judged.acts),
    )
    levels = calibrate(judged, truth, fits)
    _logger.info("trained on %s: %s", counted(len(campaigns), "campaign"), levels)
    return Posterior(
        sets, standards.by_all, summaries, scaled.centre, scaled.scale, networks, curves,
        levels, parameters, truth.alike, disturbed_plain, gap_free_misfits, library_fit,
        len(campaigns),
    )  # fmt: skip


def _disturbed_copies(
    seen: Observations,
    campaigns: Campaigns,
    trials: NDArray[np.int64],
    seed: int,
    rng: np.random.Generator,
) -> list[tuple[Singles, Singles]]:
    """Outcomes and features of campaigns as simulated, then disturbed, in single precision.

    Args:
        seen: the observed campaign.
        campaigns: simulated, of the same trials.
        trials: indices of those simulated.
        seed: of the training.
        rng: of the disturbances.
    """
    overturned, features = campaigns.overturned, training_features(seen, campaigns, seed)
    plain = campaigns.gap_free
    disturbed = Disturbance.of(overturned[plain], features[plain], seen.motion[trials])
    copies = [(overturned.astype(np.float32), features)]
    for _ in range(TRAINING.copies):
        outcome, noted = disturbed(overturned, features, rng)
        copies.append((outcome.astype(np.float32), noted.astype(np.float32, copy=False)))
    return copies


def _networks(
    scaled: _Scaled, found: Array, truth: Truth, fold: NDArray[np.int64], seed: int
) -> tuple[tuple[Network, ...], SetOutputs]:
    """Networks of each fold, and what they make of the campaigns that they did not see.

    Args:
        scaled: how summaries are.
        found: summaries of each copy, shape (copies, n, summaries).
        truth: of the campaigns.
        fold: group of each campaign.
        seed: of the training.

    Returns:
        The networks; of the last copy what they make of all campaigns by all effects, then of those
        in which some act, without their own.
    """
    count, effects = truth.acting.shape
    everything = np.ones((count, effects), dtype=bool)
    rng = generator(seed, Stream.LACKING)
    lacking = _own_left_out(truth, rng)
    outputs: list[list[Array]] = [[], []]
    networks: list[Network] = []
    for k in range(SUMMARY.folds):
        train_rows, held = np.flatnonzero(fold != k), np.flatnonzero(fold == k)

        def batches(
            draw: np.random.Generator, rows: NDArray[np.int64] = train_rows
        ) -> tuple[Array, Bools, NDArray[np.int64], Array]:
            chosen = draw.permutation(np.concatenate([rows] * TRAINING.passed))
            copy = draw.integers(0, len(found), chosen.size)
            allowed, outside = truth.without(draw, chosen)
            index = np.where(outside, truth.sets.outside, truth.index[chosen])
            share = outside.mean() / max(1 - outside.mean(), 1e-9)
            odds = PRIOR.outside / (1 - PRIOR.outside) / max(share, 1e-9)
            weight = np.where(outside, odds, 1.0) * truth.weight[chosen]
            return network_inputs(scaled, found[copy, chosen], allowed), allowed, index, weight

        inputs = network_inputs(scaled, found[1][held], everything[held])
        judged = (inputs, everything[held], truth.index[held], truth.weight[held])
        for _ in range(TRAINING.seeds):
            rng = generator(seed, Stream.WEIGHTS, len(networks))
            network = train_network(truth.sets, batches, judged, rng)
            networks.append(network)
            for target, allowed in zip(outputs, (everything[held], lacking[held]), strict=True):
                own = network_inputs(scaled, found[-1][held], allowed)
                target.append(network.outputs(own))
    # From fold by fold to the order of the campaigns.
    place = np.argsort(np.concatenate([np.flatnonzero(fold == k) for k in range(SUMMARY.folds)]))
    by_all, without_own = (
        np.stack([np.concatenate(one[i :: TRAINING.seeds])[place] for i in range(TRAINING.seeds)])
        for one in outputs
    )
    acts = truth.acting.any(axis=1)
    return tuple(networks), SetOutputs(
        truth.sets,
        np.concatenate([by_all, without_own[:, acts]], axis=1),
        np.concatenate([everything, lacking[acts]]),
    )


def _curves(
    scaled: _Scaled,
    found: Array,
    campaigns: Campaigns,
    library: Library,
    held_out: _HeldOut,
    temperature: float,
) -> tuple[Curves, ...]:
    """Curves of the effects, one a fold, and what is judged by them; none where none can be.

    Args:
        scaled: how summaries are.
        found: summaries of each copy, shape (copies, n, summaries).
        campaigns: simulated.
        library: effects.
        held_out: networks, and which campaigns each did not see.
        temperature: by which log probabilities are divided.
    """
    truth = held_out.truth
    if not ((truth.acting.sum(axis=1) == 2).any() and campaigns.gap_free.any()):
        return ()

    def probability(copy: int, rows: NDArray[np.int64]) -> Array:
        own = held_out.networks_of(int(held_out.fold[rows[0]]))
        allowed = np.ones((rows.size, truth.acting.shape[1]), dtype=bool)
        inputs = network_inputs(scaled, found[copy, rows], allowed)
        return pooled(np.stack([one.log_probability(inputs, allowed) for one in own]), temperature)

    own = found[:, :, : scaled.summaries.effect.size]
    return fit_curves(own, campaigns, library, truth, held_out.fold, probability)


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """Networks of each fold, and what they make of the campaigns that they did not see.

    Attributes:
        networks: some a fold.
        judged: of the last copy what they make of all campaigns by all effects, then of those in
            which some act, without their own.
        truth: of the campaigns.
        fold: group of each campaign.
    """

    networks: tuple[Network, ...]
    judged: SetOutputs
    truth: Truth
    fold: NDArray[np.int64]

    def networks_of(self, fold: int) -> tuple[Network, ...]:
        """Those that did not see a fold."""
        return self.networks[TRAINING.seeds * fold : TRAINING.seeds * (fold + 1)]

    def refinement(
        self, curves: tuple[Curves, ...], summaries: Array, effect: NDArray[np.int64]
    ) -> Refine:
        """What is made of the probabilities of judged campaigns, by curves that did not see them.

        Args:
            curves: one a fold, or none.
            summaries: of all campaigns, of the copy that is judged, shape (n, summaries).
            effect: index of the effect of each discriminant, -1 of a nuisance, shape (targets,).
        """
        truth = self.truth
        row = truth.judged

        def refine(rows: slice, probability: Array) -> Array:
            if not curves:
                return probability
            return np.array(
                [
                    refined(
                        p, truth.sets, truth.alike, allowed, summaries[i, : effect.size],
                        [curves[self.fold[i]].without(effect, allowed)],
                    )
                    for p, allowed, i in zip(
                        probability, self.judged.allowed[rows], row[rows], strict=True
                    )
                ]
            )  # fmt: skip

        return refine


def _own_left_out(truth: Truth, rng: np.random.Generator) -> Bools:
    """Effects of a library that lacks one that acts, shape (n, effects)."""
    pick = (rng.random(truth.acting.shape) * truth.acting).argmax(axis=1)
    plain: Bools = np.asarray(~truth.acting.any(axis=1))
    return ~left_out_together(truth.alike, pick, rng) | plain[:, None]
