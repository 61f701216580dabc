"""What acts beside the effect that leads: the leading one is fitted, and what is left is judged.

A strong effect drowns a weak one in the discriminants, and a network that saw each pair of effects
in a campaign or two cannot learn which combination is which. So the posterior is refined where it
says that an effect leads. By the effects' curves the leading one is fitted alone and together with
each other one. A conditional logit (D. McFadden, "Conditional logit analysis of qualitative choice
behavior", 1974) makes of that the probability of each other effect, and of nothing more. Its
weights are common to all effects, so that few campaigns suffice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.linear_algebra import blocks
from vsr2.posterior.effect_curves import EFFECT_CURVE, Curves
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY
from vsr2.posterior.truth import Truth

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int64]
Judged = tuple[NDArray[np.float32], tuple[int, int, int], float]
"""Features, in single precision; campaign, effect that leads, what stands beside it; weight."""


@dataclass(frozen=True)
class SecondCauseConstants:
    """How the leading effect is fitted, and who stands beside it; chosen by hand.

    Attributes:
        least: probability of leading from which an effect is fitted.
        penalty: of the squares of the logit's weights, by campaign.
        copies: of each campaign on which the logit is trained, the last ones.
        most_evidence, most_deviation: at which features are cut off.
        tiny: below which no logarithm is taken, and by nothing less is divided.
    """

    least: float = 0.02
    penalty: float = 1e-4
    copies: int = 2
    most_evidence: float = 60.0
    most_deviation: float = 6.0
    tiny: float = 1e-7


SECOND_CAUSE = SecondCauseConstants()


@dataclass(frozen=True, eq=False)
class SecondCause:
    """The logit that judges what stands beside the effect that leads.

    Attributes:
        curves: by which the leading effect is fitted.
        scale: of the features, first those of each other effect, then of nothing more.
        weights: of these, and of the constant of nothing more.
    """

    curves: Curves
    scale: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class Seen:
    """What the networks make of one campaign, of which the refinement needs a part.

    Attributes:
        none: probability.
        alone: of each effect alone, shape (effects,).
        beside: of each pair, shape (effects, effects).
        acts: of each effect in any set, shape (effects,).
    """

    none: float
    alone: Array
    beside: Array
    acts: Array

    @classmethod
    def of(cls, probability: Array, sets: Sets) -> Seen:
        """From the probability of every set, shape (sets,)."""
        count = len(sets.names)
        pairs = sets.by_size[1]
        beside = np.zeros((count, count))
        beside[pairs[:, 0], pairs[:, 1]] = probability[1 + count : 1 + count + len(pairs)]
        return cls(
            float(probability[0]), probability[1 : 1 + count], beside + beside.T,
            sets.marginal(probability),
        )  # fmt: skip

    @property
    def rank(self) -> Rows:
        """Of each effect by its probability of acting, 0 for the greatest, shape (effects,)."""
        return np.argsort(np.argsort(-self.acts, kind="stable"))

    @property
    def leading(self) -> Array:
        """Probability that each effect acts alone, or leads another, shape (effects,)."""
        leads = self.rank[:, None] < self.rank[None]
        return np.asarray(self.alone + (self.beside * leads).sum(axis=1))


def features(curves: Curves, own: Array, lead: int, seen: Seen, alike: Bools) -> Array:
    """What is judged of each other effect, and of nothing more, beside the one that leads.

    Args:
        curves: of the effects.
        own: whitened discriminants of the campaign, shape (whitened,).
        lead: index of the effect that leads.
        seen: what the networks make of the campaign.
        alike: effects declared alike, shape (effects, effects).

    Returns:
        Shape (effects + 1, features), nothing more last; columns are of one or of the other.
    """
    gain = curves.means @ own - curves.half_squares
    alone = gain[lead]
    left = float(own @ own - 2 * alone.max())
    # A campaign that no curve meets counts for less.
    heat = max(1.0, left / own.size)
    # Of each effect, its points and those of the one that leads; in one array, which takes time.
    points = curves.singles.reshape(-1, own.size)
    both = (points @ curves.singles[lead].T).reshape(*gain.shape, -1)
    np.subtract(gain.astype(np.float32)[:, :, None], both, out=both)
    both += alone.astype(np.float32)
    best = both.max(axis=2)
    most = best.max(axis=1)
    rise = (most - alone.max()) / heat
    both -= most[:, None, None]
    both /= np.float32(heat)
    summed = np.log(np.exp(both, out=both).mean(axis=(1, 2), dtype=np.float64))
    evidence = rise + summed - np.log(np.exp((alone - alone.max()) / heat).mean())
    evidence = np.clip(evidence, -SECOND_CAUSE.most_evidence, SECOND_CAUSE.most_evidence)
    root = np.sqrt(np.maximum(rise, 0.0))
    other = np.arange(len(root)) != lead
    root[~other] = 0.0
    second, first = np.sort(root)[-2:]
    lone = root - np.where(root >= first, second, first)
    own_size = np.log(curves.sizes[lead, int(alone.argmax())] + EFFECT_CURVE.added_size)
    size = np.take_along_axis(curves.sizes, best.argmax(axis=1)[:, None], 1)[:, 0]
    size = np.log(size + EFFECT_CURVE.added_size)
    total = max(float(seen.alone[lead] + seen.beside[lead].sum()), SECOND_CAUSE.tiny)
    share, logs = (
        np.log(np.maximum(one, SECOND_CAUSE.tiny)) for one in (seen.beside[lead] / total, seen.acts)
    )
    same = np.asarray(alike[lead], dtype=float)
    shape = np.full(share.shape, own_size)
    others = np.stack(
        [root, root**2, evidence, size, lone, share, logs, same, same * root, root * own_size,
         share * root, shape, np.full(share.shape, np.log(heat))], axis=1,
    )  # fmt: skip
    others[~other] = 0.0
    alone_share, none = np.log(np.maximum([seen.alone[lead] / total, seen.none], SECOND_CAUSE.tiny))
    rest = evidence[other].max(initial=-SECOND_CAUSE.most_evidence)
    nothing = [
        alone_share, first, first**2, rest, alone_share * first, own_size, np.log(heat), none,
    ]  # fmt: skip
    out = np.zeros((len(share) + 1, others.shape[1] + len(nothing)))
    out[:-1, : others.shape[1]] = others
    out[-1, others.shape[1] :] = nothing
    return out


def odds(judge: SecondCause, found: Array, lead: int) -> Array:
    """Probability of each other effect and of nothing more, shape (..., effects + 1).

    Args:
        judge: of them.
        found: features, shape (..., effects + 1, features).
        lead: index of the effect that leads.
    """
    logits = _scaled(judge.scale, found) @ judge.weights
    logits[..., lead] = -np.inf
    out = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(out / out.sum(axis=-1, keepdims=True))


def refined(
    probability: Array,
    sets: Sets,
    alike: Bools,
    discriminants: Array,
    judges: Sequence[SecondCause],
) -> Array:
    """Probability of every set: what an effect has that leads is shared out again.

    Shared out is what it has alone and with another; none and larger sets keep theirs.

    Args:
        probability: by the networks, shape (sets,).
        sets: the hypotheses.
        alike: effects declared alike, shape (effects, effects).
        discriminants: of the campaign, shape (targets,).
        judges: of the folds that count, whose probabilities are averaged; none: nothing is shared
            out.
    """
    if not judges:
        return probability
    seen = Seen.of(probability, sets)
    leading = seen.leading
    alone, beside = np.array(seen.alone), np.array(seen.beside)
    rank = seen.rank
    led = np.flatnonzero(leading > SECOND_CAUSE.least)
    for lead in led:
        below = rank > rank[lead]
        beside[lead, below] = beside[below, lead] = 0.0
        alone[lead] = 0.0
    for lead in led:
        share = np.zeros(leading.size + 1)
        for one in judges:
            own = (discriminants - one.curves.origin) @ one.curves.white
            beside_it = features(one.curves, own, int(lead), seen, alike)
            share += odds(one, beside_it, int(lead)) / len(judges)
        alone[lead] += leading[lead] * share[-1]
        beside[lead] += leading[lead] * share[:-1]
        beside[:, lead] += leading[lead] * share[:-1]
    out = np.array(probability)
    count, pairs = len(sets.names), sets.by_size[1]
    out[1 : 1 + count] = alone
    out[1 + count : 1 + count + len(pairs)] = beside[pairs[:, 0], pairs[:, 1]]
    return out


def fit_second_cause(
    found: Array,
    curves: Sequence[Curves],
    truth: Truth,
    fold: Rows,
    probability: Callable[[int, Rows], Array],
) -> tuple[SecondCause, ...]:
    """One of each fold, made of the other folds; none where no two effects act together.

    Args:
        found: discriminants of each copy of campaigns, shape (copies, n, targets).
        curves: of the effects, one a fold.
        truth: of the campaigns.
        fold: group of each campaign.
        probability: of every set in some campaigns of a copy, by networks that did not see them.
    """
    if not curves or not (truth.acting.sum(axis=1) == 2).any():
        return ()
    seen, rows, weight = _judged(found, curves, truth, fold, probability)
    scale = seen.std(axis=(0, 1)) + SECOND_CAUSE.tiny
    judged = [fold[rows[:, 0]] != k for k in range(SUMMARY.folds)]
    return tuple(
        SecondCause(
            one, scale, _conditional_logit(_scaled(scale, seen[own]), rows[own], weight[own])
        )
        for one, own in zip(curves, judged, strict=True)
    )


def _judged(
    found: Array,
    curves: Sequence[Curves],
    truth: Truth,
    fold: Rows,
    probability: Callable[[int, Rows], Array],
) -> tuple[Array, Rows, Array]:
    """Features of campaigns beside each effect that acts, by curves that did not see them.

    Returns:
        Features; campaign, effect that leads and what stands beside it; weight.
    """
    acts = truth.acting.sum(axis=1)
    judged: list[Judged] = []
    for copy in range(len(found) - SECOND_CAUSE.copies, len(found)):
        for k, one in enumerate(curves):
            held = np.flatnonzero((fold == k) & ((acts == 1) | (acts == 2)))
            if not held.size:
                continue
            # All sets of a few campaigns at a time.
            for part in blocks(held.size, len(truth.sets)):
                rows = held[part]
                own = (found[copy, rows] - one.origin) @ one.white
                for i, place, p in zip(rows, own, probability(copy, rows), strict=True):
                    judged += _beside_each(one, place, truth, int(i), Seen.of(p, truth.sets))
    seen, row, weight = zip(*judged, strict=True)
    return np.array(seen), np.array(row), np.array(weight)


def _beside_each(
    curves: Curves, own: Array, truth: Truth, campaign: int, seen: Seen
) -> Iterator[Judged]:
    """What is judged beside each effect that acts in a campaign."""
    count = len(truth.sets.names)
    acting = [int(e) for e in np.flatnonzero(truth.acting[campaign])]
    for lead in acting:
        found = features(curves, own, lead, seen, truth.alike)
        beside = next((e for e in acting if e != lead), count)
        weight = float(truth.weight[campaign] * seen.leading[lead])
        yield found.astype(np.float32), (campaign, lead, beside), weight


def _scaled(scale: Array, found: Array) -> Array:
    """Features in their deviations, and the constant of nothing more."""
    most = SECOND_CAUSE.most_deviation
    out = np.zeros((*found.shape[:-1], found.shape[-1] + 1))
    scaled = out[..., :-1]
    np.divide(found, scale, out=scaled)
    np.clip(scaled, -most, most, out=scaled)
    out[..., -1, -1] = 1.0
    return out


def _conditional_logit(x: Array, rows: Rows, weight: Array) -> Array:
    """Weights of the features that make what stands beside the leading effect most probable.

    Args:
        x: scaled features, shape (n, effects + 1, features).
        rows: campaign, effect that leads, and what stands beside it, shape (n, 3).
        weight: of each, shape (n,).
    """
    from scipy.optimize import minimize

    count = np.arange(len(x))
    share = weight / weight.sum()
    true = x[count, rows[:, 2]]

    def score(w: Array) -> tuple[float, Array]:
        logits = x @ w
        logits[count, rows[:, 1]] = -np.inf
        most = logits.max(axis=1, keepdims=True)
        p = np.exp(logits - most)
        total = p.sum(axis=1, keepdims=True)
        logs = logits[count, rows[:, 2]] - most[:, 0] - np.log(total[:, 0])
        p *= share[:, None] / total
        slope = np.tensordot(p, x, 2) - share @ true + 2 * SECOND_CAUSE.penalty * w
        return float(-(share @ logs) + SECOND_CAUSE.penalty * (w @ w)), slope

    return np.asarray(minimize(score, np.zeros(x.shape[-1]), jac=True, method="L-BFGS-B").x)
