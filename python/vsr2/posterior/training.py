"""Training of the posterior on simulated campaigns, and its calibration on those held out."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.observed.random_streams import Stream, generator
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.hypotheses import HYPOTHESIS
from vsr2.ensemble.simulated.library import Library
from vsr2.ensemble.simulated.linear_algebra import blocks, one_blas_thread
from vsr2.errors import DiagnosisError
from vsr2.one_line import counted
from vsr2.posterior.calibration import (
    JudgedCampaigns,
    Levels,
    calibrate,
    label_probability,
    label_set,
    pooled,
)
from vsr2.posterior.discrepancy import Disturbance
from vsr2.posterior.discrepancy_size import DiscrepancyInterval, DiscrepancySize
from vsr2.posterior.goodness_of_fit import misfit, misfits_by, tail_probability
from vsr2.posterior.naming import Naming, candidates, decide
from vsr2.posterior.outside import Outside
from vsr2.posterior.parameters import Parameters, fit_parameters
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY, Standard, Standards
from vsr2.posterior.truth import Truth
from vsr2.posterior.withheld_parts import WithheldPart, withheld
from vsr2.posterior.within_library import TRAINING, OutOfFold, WithinLibrary, learned

_logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Found:
    """Inference on one campaign.

    Attributes:
        probability: of every set, shape (sets,).
        residuals: standardised, shape (columns,).
        summaries: shape (summaries,).
        fit: tail probability of the campaign among simulated ones without effect.
        discrepancy: by how much it differs beyond contact models.
        naming: what is said.
        held: labels of the 90 % set, see :func:`label_set`.
    """

    probability: Array
    residuals: Array
    summaries: Array
    fit: float
    discrepancy: DiscrepancyInterval
    naming: Naming
    held: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Posterior:
    """The trained posterior of one protocol at one tier.

    Attributes:
        standard: by which campaigns are standardised.
        within: what is learned of the library.
        outside: whether the cause lies outside of it.
        levels: calibrated.
        parameters: of effects.
        discrepancy: by how much a campaign differs beyond contact models.
        gap_free: residuals of campaigns without effect, disturbed, in single precision, shape (n,
            columns).
        misfits: of campaigns without effect, disturbed and held out, rising, shape (n,).
        campaigns: number that were simulated for it.
        trained_on: number of these in which nothing acts that is excluded.
        excused: misfit up to which campaigns fit, as those of references do.
    """

    standard: Standard
    within: WithinLibrary
    outside: Outside
    levels: Levels
    parameters: Parameters
    discrepancy: DiscrepancySize
    gap_free: Singles
    misfits: Array
    campaigns: int
    trained_on: int
    excused: float = 0.0

    @property
    def sets(self) -> Sets:
        """Hypotheses."""
        return self.within.sets

    @one_blas_thread()
    def infer(self, overturned: Array, features: Array) -> Found:
        """Probability of every set, and what is said.

        Args:
            overturned: outcomes of the trials that were simulated, shape (trials,).
            features: shape (trials, k).
        """
        residuals = self.standard.residuals(overturned[None], features[None])
        summaries = self.within.summaries(residuals)
        probability = self.within.refined(self.within.pooled(summaries), summaries)
        probability = self.outside.beside(probability, self.within.left_over(residuals))[0]
        size = misfit(residuals)
        fit = 1.0 if size[0] <= self.excused else float(tail_probability(size, self.misfits)[0])
        said = decide(
            candidates(probability, self.sets, self.within.alike),
            self.levels.naming,
            self.within.alike,
            fit=fit,
        )
        differs = self.discrepancy.interval(self.within.inputs(summaries)[0])
        labels = label_probability(probability[None], self.sets)[0]
        held = label_set(labels, self.levels.set_level(said.kind))
        return Found(probability, residuals[0], summaries[0], fit, differs, said, held)

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
        campaigns: simulated, of the same trials; those in which an effect acts that the library
            lacks have no part in it.
        library: effects, in the order of the hypotheses.
        trials: indices of those simulated.
        most: effects that may act together.
        seed: of everything random.

    Raises:
        DiagnosisError: the library has no effect.
    """
    if not library:
        raise DiagnosisError("no effect is left to look for: exclude fewer")
    given, campaigns = len(campaigns), campaigns.within(library)
    plain, rng = campaigns.gap_free, generator(seed, Stream.COPIES)
    copies, factor = _disturbed_copies(seen, campaigns, trials, seed, rng)
    fold = rng.permutation(len(campaigns)) % SUMMARY.folds
    standards = Standards.of(copies, plain, fold)
    misfits = misfits_by(standards, copies[1:], fold)
    # Features go as residuals come.
    residuals = [standards.by_all.residuals(*copies.pop(0)) for _ in range(len(copies))]
    # Of the campaigns themselves what acts in them is all that is asked from here on.
    campaigns = campaigns.of_trials(np.zeros(campaigns.overturned.shape[1], dtype=bool))
    parameters = fit_parameters(library, campaigns, residuals[1])
    truth = Truth.of(campaigns, Sets(tuple(library), most), library)
    within, held_out = learned(residuals, campaigns, library, truth, fold, len(trials), seed)
    size = DiscrepancySize.of(within.inputs(held_out.summaries), factor, fold)
    parts = withheld(residuals, campaigns, library, truth, fold, within, seed)
    gap_free = np.concatenate([one[plain] for one in residuals[1:]])
    del residuals
    outside = Outside.of([sample for one in parts for sample in one.samples], most)
    gap_free_misfits = np.sort(misfits[:, plain], axis=None)
    judged = JudgedCampaigns.of(truth, _judged(within, held_out, truth, fold, parts, outside))
    fit = tail_probability(misfits[-1], gap_free_misfits)[judged.row]
    levels = calibrate(judged, truth, fit)
    _logger.info("trained on %s: %s", counted(len(campaigns), "campaign"), levels)
    return Posterior(
        standards.by_all, within, outside, levels, parameters, size, gap_free, gap_free_misfits,
        given, len(campaigns),
    )  # fmt: skip


def _disturbed_copies(
    seen: Observations,
    campaigns: Campaigns,
    trials: NDArray[np.int64],
    seed: int,
    rng: np.random.Generator,
) -> tuple[list[tuple[Singles, Singles]], Array]:
    """Outcomes and features of campaigns as simulated, then disturbed, in single precision.

    Args:
        seen: the observed campaign.
        campaigns: simulated, of the same trials.
        trials: indices of those simulated.
        seed: of the training.
        rng: of the disturbances.

    Returns:
        The copies; by which factors the last one is disturbed, shape (n,).
    """
    overturned, features = campaigns.overturned, training_features(seen, campaigns, seed)
    plain = campaigns.gap_free
    disturbed = Disturbance.of(overturned[plain], features[plain], seen.motion[trials])
    copies = [(overturned.astype(np.float32), features)]
    for _ in range(TRAINING.copies):
        outcome, noted, factor = disturbed(overturned, features, rng)
        copies.append((outcome.astype(np.float32), noted.astype(np.float32, copy=False)))
    return copies, factor


def _judged(
    within: WithinLibrary,
    held_out: OutOfFold,
    truth: Truth,
    fold: Rows,
    parts: Sequence[WithheldPart],
    outside: Outside,
) -> Iterator[tuple[Rows, bool, Array]]:
    """What is made of the last copy of all campaigns, then of those whose cause is withheld.

    Args:
        within: what is learned of the library.
        held_out: campaigns by what did not see them.
        truth: of the campaigns.
        fold: group of each campaign.
        parts: of the library that were withheld.
        outside: whether the cause lies outside.

    Returns:
        See :meth:`JudgedCampaigns.of`.
    """
    for k in range(SUMMARY.folds):
        own, held = within.of_fold(k), np.flatnonzero(fold == k)
        for part in blocks(held.size, len(truth.sets)):
            rows = held[part]
            probability = pooled(held_out.outputs.log_probability(rows), within.temperature)
            probability = own.refined(probability, held_out.summaries[rows])
            yield rows, False, outside.beside(probability, held_out.left[rows])
    for number, one in enumerate(parts):
        # Whoever judges an unknown cause has not learned that it is one.
        others = [sample for k, p in enumerate(parts) if k != number for sample in p.samples]
        unaware = Outside.of(others, truth.sets.most)
        for rows, probability in one.judged(truth.sets, unaware):
            yield rows, True, probability
