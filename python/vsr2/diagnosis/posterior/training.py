"""Training of the posterior on simulated campaigns, and its calibration on those held out."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.posterior.discrepancy import Disturbance
from vsr2.diagnosis.posterior.goodness_of_fit import (
    fit_probability,
    held_out_misfits,
    misfit,
)
from vsr2.diagnosis.posterior.naming import Naming, VerdictKind, candidates, decide, is_wrong
from vsr2.diagnosis.posterior.network import Network, train_network
from vsr2.diagnosis.posterior.parameters import Parameters, fit_parameters
from vsr2.diagnosis.posterior.sets import Sets, declared_alike
from vsr2.diagnosis.posterior.summaries import SUMMARY, Standard, Summaries, fit_summaries
from vsr2.diagnosis.simulated.campaigns import Campaigns
from vsr2.diagnosis.simulated.library import Library
from vsr2.diagnosis.simulated.linear_algebra import one_blas_thread

_logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class TrainingConstants:
    """What the posterior is trained for; chosen by hand.

    Attributes:
        none, one, two, outside: prior probability of the hypotheses; where more than two effects
            may act, what one and two have is spread evenly over the numbers of effects.
        copies: disturbed copies of each campaign.
        passed: copies of each campaign in one pass of training.
        seeds: networks that are trained for each fold.
        left_out: share of training campaigns whose own effect the library lacks.
        decoy: share of those that lack a class which does not act.
        together: chance that an effect declared alike to what is left out is left out with it.
        false_alarms: share of gap-free campaigns of which none is not said.
        wrong: share of names that may be wrong.
        coverage: of the sets of hypotheses.
        added_scale: to the standard deviation by which each summary is divided, which may be 0.
        temperatures: ends of the logarithm of the temperature that is sought.
        names: probabilities that a name may be asked to have, of which the least that keeps `wrong`
            is used.
    """

    none: float = 0.2
    one: float = 0.5
    two: float = 0.15
    outside: float = 0.15
    copies: int = 4
    passed: int = 2
    seeds: int = 2
    left_out: float = 0.15
    decoy: float = 0.4
    together: float = 0.5
    false_alarms: float = 0.05
    wrong: float = 0.10
    coverage: float = 0.90
    added_scale: float = 1e-6
    temperatures: tuple[float, float] = (-1.0, 1.5)
    names: tuple[float, ...] = tuple(k / 100 for k in range(50, 100))

    def sizes(self, most: int) -> tuple[float, ...]:
        """Prior probability of none, one, ... effects, where at most so many act."""
        if most == 2:
            return self.none, self.one, self.two
        return self.none, *[(self.one + self.two) / most] * most


TRAINING = TrainingConstants()


@dataclass(frozen=True, eq=False)
class Levels:
    """What calibration on held-out campaigns sets.

    Attributes:
        temperature: by which log probabilities are divided.
        none_limit: 5 % point of the probability of none over gap-free campaigns.
        least_name: probability, given a gap, that a name must have.
        set_level: probability before a label up to which the 90 % sets hold it.
        wrong, named: shares of held-out campaigns with a gap that are named wrongly, and named.
        detection_rate: share of causes outside the library that are said to be so.
    """

    temperature: float
    none_limit: float
    least_name: float
    set_level: float
    wrong: float
    named: float
    detection_rate: float


@dataclass(frozen=True, eq=False)
class Found:
    """Inference on one campaign.

    Attributes:
        probability: of every set, shape (sets,).
        residuals: standardised, shape (columns,).
        summaries: shape (summaries,).
        fit: tail probability of the campaign among simulated ones without effect.
        naming: what is said.
    """

    probability: Array
    residuals: Array
    summaries: Array
    fit: float
    naming: Naming


@dataclass(frozen=True, eq=False)
class Posterior:
    """The trained posterior of one protocol at one tier.

    Attributes:
        sets: hypotheses.
        standard, summaries: from campaigns to summaries.
        centre, scale: of summaries, shape (summaries,).
        networks: some a fold.
        levels: calibrated.
        parameters: of effects.
        alike: which effects are declared alike, shape (effects, effects).
        gap_free: residuals of campaigns without effect, disturbed, shape (n, columns).
        misfits: of campaigns without effect, disturbed and held out, rising, shape (n,).
        campaigns: number that it was trained on.
        excused: misfit up to which campaigns fit, as those of references do.
    """

    sets: Sets
    standard: Standard
    summaries: Summaries
    centre: Array
    scale: Array
    networks: tuple[Network, ...]
    levels: Levels
    parameters: Parameters
    alike: Bools
    gap_free: Array
    misfits: Array
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
        size = float(misfit(residuals[0]))
        fit = 1.0 if size <= self.excused else float(fit_probability(np.array(size), self.misfits))
        said = decide(
            candidates(probability, self.sets, self.alike),
            none_limit=self.levels.none_limit,
            least=self.levels.least_name,
            alike=self.alike,
            fit=fit,
        )
        return Found(probability, residuals[0], summaries[0], fit, said)

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


def pooled(log_probability: Array, temperature: float) -> Array:
    """Mean over networks of probabilities whose logarithms are divided by a temperature.

    Args:
        log_probability: shape (networks, ..., sets).
        temperature: above 0; below 1 it makes up for the flatness that a mean brings.

    Returns:
        Shape (..., sets).
    """
    scaled = log_probability / temperature
    out = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
    return np.asarray((out / out.sum(axis=-1, keepdims=True)).mean(axis=0))


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


@one_blas_thread()
def train(
    seen: Observations,
    campaigns: Campaigns,
    library: Library,
    trials: NDArray[np.int64],
    *,
    most: int = 2,
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
    overturned = campaigns.overturned
    features = seen.noted(overturned, campaigns.peak_tilt, campaigns.features, seed)
    plain = campaigns.gap_free
    disturbed = Disturbance.of(overturned[plain], features[plain], seen.motion[trials])
    rng = np.random.default_rng([seed, 32])
    copies = [(overturned, features)] + [
        disturbed(overturned, features, rng) for _ in range(TRAINING.copies)
    ]
    standard = Standard.of(
        np.concatenate([one for one, _ in copies]),
        np.concatenate([one for _, one in copies]),
        np.concatenate([plain] * len(copies)),
    )
    residuals = [standard.residuals(*one) for one in copies]
    fold = rng.permutation(len(campaigns)) % SUMMARY.folds
    summaries, found = fit_summaries(residuals, campaigns, sets.names, fold, len(trials))
    everything = np.concatenate(found)
    scale = everything.std(axis=0) + TRAINING.added_scale
    scaled = _Scaled(summaries, everything.mean(axis=0), scale)
    truth = _Truth.of(campaigns, sets, library)
    networks, logs = _networks(scaled, found, truth, fold, seed)
    misfits = held_out_misfits(copies, plain, fold)
    gap_free_misfits = np.sort(misfits[:, plain], axis=None)
    # Of the copy that the log probabilities are of.
    levels = _levels(logs, truth, fit_probability(misfits[-1], gap_free_misfits))
    _logger.info("trained on %d campaigns: %s", len(campaigns), levels)
    disturbed_plain = np.concatenate([one[plain] for one in residuals[1:]])
    return Posterior(
        sets, standard, summaries, scaled.centre, scaled.scale, networks, levels,
        fit_parameters(library, campaigns, residuals[1]),
        truth.alike, disturbed_plain, gap_free_misfits, len(campaigns),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Truth:
    """What acts in each training campaign.

    Attributes:
        sets: hypotheses.
        index: of the true set, shape (n,).
        acting: shape (n, effects).
        weight: of each campaign, so that kinds count as the prior has them, shape (n,).
        alike: effects declared alike, shape (effects, effects).
    """

    sets: Sets
    index: NDArray[np.int64]
    acting: Bools
    weight: Array
    alike: Bools

    @classmethod
    def of(cls, campaigns: Campaigns, sets: Sets, library: Library) -> _Truth:
        names = [[one.name for one in acting] for acting in campaigns.sets]
        acting = np.array([np.isin(sets.names, own) for own in names]).reshape(len(names), -1)
        index = np.array([sets.index(own) for own in names], dtype=np.int64)
        count = acting.sum(axis=1)
        wanted = np.array(TRAINING.sizes(sets.most))
        shares = np.array([max(float((count == k).mean()), 1e-9) for k in range(len(wanted))])
        return cls(sets, index, acting, (wanted / shares)[count], declared_alike(library))

    def without(self, rng: np.random.Generator, rows: NDArray[np.int64]) -> tuple[Bools, Bools]:
        """Effects that the library has for each campaign, and whether it lacks the cause.

        What is left out is an effect that acts, or one that does not, and each effect that is
        declared alike with the chance `TRAINING.together`.
        """
        acting = self.acting[rows]
        kind = rng.random(rows.size)
        outside = (kind < TRAINING.left_out) & acting.any(axis=1)
        decoy = (kind > 1 - TRAINING.decoy) & ~outside
        among = np.where(outside[:, None], acting, ~acting)
        left_out = (rng.random(acting.shape) * among).argmax(axis=1)
        lacking = left_out_together(self.alike, left_out, rng)
        lacking &= np.where(outside[:, None], True, ~acting) & (outside | decoy)[:, None]
        return ~lacking, outside


def left_out_together(alike: Bools, left_out: NDArray[np.int64], rng: np.random.Generator) -> Bools:
    """Effects that a library lacks together with one, itself among them, shape (n, effects).

    Each effect declared alike is lacking, too, with the chance `TRAINING.together`.

    Args:
        alike: effects declared alike, shape (effects, effects).
        left_out: index of the effect that is lacking, shape (n,).
        rng: of the chance.
    """
    drawn = rng.random((left_out.size, alike.shape[0])) < TRAINING.together
    together = alike[left_out] & drawn
    together[np.arange(left_out.size), left_out] = True
    return together


Logs = tuple[Array, Array]
"""Log probabilities of held-out campaigns, disturbed: by all effects, and without their own.

Shape (seeds, n, sets)."""


def _networks(
    scaled: _Scaled, found: Sequence[Array], truth: _Truth, fold: NDArray[np.int64], seed: int
) -> tuple[tuple[Network, ...], Logs]:
    """Networks of each fold, and what they make of the campaigns that they did not see."""
    count, effects = truth.acting.shape
    everything = np.ones((count, effects), dtype=bool)
    rng = np.random.default_rng([seed, 33])
    lacking = _own_left_out(truth, rng)
    out = tuple(np.zeros((TRAINING.seeds, count, len(truth.sets))) for _ in range(2))
    networks: list[Network] = []
    for k in range(SUMMARY.folds):
        train_rows, held = np.flatnonzero(fold != k), np.flatnonzero(fold == k)

        def batches(
            draw: np.random.Generator, rows: NDArray[np.int64] = train_rows
        ) -> tuple[Array, Bools, NDArray[np.int64], Array]:
            chosen = draw.permutation(np.concatenate([rows] * TRAINING.passed))
            copy = draw.integers(0, len(found), chosen.size)
            summaries = np.stack(found)[copy, chosen]
            allowed, outside = truth.without(draw, chosen)
            index = np.where(outside, truth.sets.outside, truth.index[chosen])
            share = outside.mean() / max(1 - outside.mean(), 1e-9)
            odds = TRAINING.outside / (1 - TRAINING.outside) / max(share, 1e-9)
            weight = np.where(outside, odds, 1.0) * truth.weight[chosen]
            return network_inputs(scaled, summaries, allowed), allowed, index, weight

        inputs = network_inputs(scaled, found[1][held], everything[held])
        judged = (inputs, everything[held], truth.index[held], truth.weight[held])
        for i in range(TRAINING.seeds):
            number = len(networks)
            network = train_network(truth.sets, batches, judged, seed * 101 + number)
            networks.append(network)
            for target, allowed in zip(out, (everything[held], lacking[held]), strict=True):
                own = network_inputs(scaled, found[-1][held], allowed)
                target[i, held] = network.log_probability(own, allowed)
    return tuple(networks), (out[0], out[1])


def _own_left_out(truth: _Truth, rng: np.random.Generator) -> Bools:
    """Effects of a library that lacks one that acts, shape (n, effects)."""
    pick = (rng.random(truth.acting.shape) * truth.acting).argmax(axis=1)
    plain: Bools = np.asarray(~truth.acting.any(axis=1))
    return ~left_out_together(truth.alike, pick, rng) | plain[:, None]


def _levels(logs: Logs, truth: _Truth, fit: Array) -> Levels:
    """Temperature, and the limits of the rule, from campaigns that no network saw.

    Args:
        logs: log probabilities.
        truth: of the same campaigns.
        fit: tail probability of each among campaigns without effect, shape (n,).
    """
    from scipy.optimize import minimize_scalar

    acting = truth.acting.any(axis=1)
    outside = np.full(int(acting.sum()), truth.sets.outside)
    out_of_library = truth.weight[acting] * TRAINING.outside / (1 - TRAINING.outside)
    out_of_library *= truth.weight.sum() / max(truth.weight[acting].sum(), 1e-9)
    log = np.concatenate([logs[0], logs[1][:, acting]], axis=1)
    index = np.concatenate([truth.index, outside])
    weight = np.concatenate([truth.weight, out_of_library])
    rows = np.arange(index.size)

    def score(log_temperature: float) -> float:
        p = pooled(log, float(np.exp(log_temperature)))[rows, index]
        return float(-(weight * np.log(np.maximum(p, 1e-12))).sum() / weight.sum())

    sought = minimize_scalar(score, bounds=TRAINING.temperatures, method="bounded")
    temperature = float(np.exp(sought.x))
    probability = pooled(log, temperature)
    plain = probability[: len(truth.index)][~acting, 0]
    none_limit = float(np.quantile(plain, TRAINING.false_alarms)) if plain.size else 0.5
    found = [candidates(p, truth.sets, truth.alike) for p in probability]
    fits = np.concatenate([fit, fit[acting]])
    owners = [tuple(np.flatnonzero(row).tolist()) for row in truth.acting] + [()] * int(
        acting.sum()
    )
    for least in TRAINING.names:
        said = [
            decide(f, none_limit=none_limit, least=least, alike=truth.alike, fit=float(own))
            for f, own in zip(found, fits, strict=True)
        ]
        named = np.array([bool(s.effects) and s.kind is not VerdictKind.UNRESOLVED for s in said])
        wrong = np.array([is_wrong(s, own) for s, own in zip(said, owners, strict=True)])
        share = float((weight * wrong).sum() / max((weight * named).sum(), 1e-9))
        if share <= TRAINING.wrong:
            break
    unknown = [s.kind is VerdictKind.UNKNOWN for s in said[len(truth.index) :]]
    return Levels(
        temperature=temperature,
        none_limit=none_limit,
        least_name=least,
        set_level=_set_level(probability, index, weight, truth.sets),
        wrong=share,
        named=float((weight * named).sum() / weight.sum()),
        detection_rate=float(np.mean(unknown) if unknown else 0),
    )


def label_probability(probability: Array, sets: Sets) -> Array:
    """Of none, every effect that leads and outside, shape (n, effects + 2)."""
    return np.concatenate(
        [probability[:, :1], sets.leading(probability), probability[:, -1:]], axis=1
    )


def _set_level(probability: Array, index: NDArray[np.int64], weight: Array, sets: Sets) -> float:
    """Probability down to which sets of labels must reach to hold nine of ten truths.

    Conformal: of each held-out campaign, the probability held by the labels before a true one (Y.
    Romano, M. Sesia, E. Candes, "Classification with valid and adaptive coverage", 2020; there the
    true one counts in part, by chance). Of two effects, either is true.
    """
    labels = label_probability(probability, sets)
    order = np.argsort(-labels, axis=1, kind="stable")
    ordered = np.take_along_axis(labels, order, axis=1)
    before = np.cumsum(ordered, axis=1) - ordered
    true = np.zeros(labels.shape, dtype=bool)
    true[:, 1:-1] = sets.members[index]
    true[index == 0, 0] = True
    true[index == sets.outside, -1] = True
    first = np.take_along_axis(true, order, axis=1).argmax(axis=1)
    score = before[np.arange(len(index)), first]
    sequence = np.argsort(score)
    total = np.cumsum(weight[sequence]) / weight.sum()
    return float(score[sequence][np.searchsorted(total, TRAINING.coverage)])


def label_set(probability: Array, sets: Sets, level: float) -> tuple[int, ...]:
    """Labels of the 90 % set, most probable first: 0 none, 1 to n effects, n + 1 outside."""
    labels = label_probability(probability[None], sets)[0]
    order = np.argsort(-labels, kind="stable")
    before = np.cumsum(labels[order]) - labels[order]
    return tuple(int(i) for i in order[before <= level + 1e-12])
