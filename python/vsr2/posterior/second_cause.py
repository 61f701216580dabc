"""What acts beside the effect that leads: the leading one is fitted, and what is left is judged.

A strong effect drowns a weak one in the discriminants, and a network that saw each pair of effects
in a campaign or two cannot learn which combination is which. So the posterior is refined where it
says that an effect leads. A smooth curve for each effect says which discriminants it gives by its
size: kernel regression, additive in the effects (J. Quinonero-Candela and C. E. Rasmussen, J. Mach.
Learn. Res. 6, 2005, subset of regressors). By these curves the leading effect is fitted alone and
together with each other one. A conditional logit (D. McFadden, "Conditional logit analysis of
qualitative choice behavior", 1974) makes of that the probability of each other effect, and of
nothing more. Its weights are common to all effects, so that few campaigns suffice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.ensemble.simulated.campaigns import Acting, Campaigns
from vsr2.ensemble.simulated.library import Library, free_parameters, is_angle, turn_of
from vsr2.ensemble.simulated.linear_algebra import ridge
from vsr2.posterior.sets import Sets
from vsr2.posterior.summaries import SUMMARY
from vsr2.posterior.truth import Truth

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class SecondCauseConstants:
    """How the leading effect is fitted, and who stands beside it; chosen by hand.

    Attributes:
        points: of each effect's curve.
        width: of the kernel, in the logarithm of the size; half that in other coordinates.
        added_size: to sizes [detection limits] before the logarithm.
        variance: of what an effect of size 1 gives, over that of chance.
        nuisance: variance of what a nuisance gives, over the same.
        jitter: added to the kernel's diagonal, so that it has an inverse.
        shrunk: share of independent chance in its covariance.
        least: probability of leading from which an effect is fitted.
        penalty: of the squares of the logit's weights, by campaign.
        copies: of each campaign on which the logit is trained, the last ones.
        most_evidence, most_deviation: at which features are cut off.
        tiny: below which no logarithm is taken, and by nothing less is divided.
    """

    points: int = 48
    width: float = 1.0
    added_size: float = 0.2
    variance: float = 0.3
    nuisance: float = 0.1
    jitter: float = 1e-6
    shrunk: float = 0.05
    least: float = 0.02
    penalty: float = 1e-4
    copies: int = 2
    most_evidence: float = 60.0
    most_deviation: float = 6.0
    tiny: float = 1e-7


SECOND_CAUSE = SecondCauseConstants()


@dataclass(frozen=True, eq=False)
class Curves:
    """What effects give in whitened discriminants, and the logit that judges what is left.

    Attributes:
        white: from discriminants to those of unit chance, shape (targets, whitened).
        origin: of the former without effect, shape (targets,).
        means: of each point of each effect's curve, shape (effects, points, whitened).
        sizes: of the points [detection limits], shape (effects, points).
        scale: of the features, first those of each other effect, then of nothing more.
        weights: of these, and of the constant of nothing more.
    """

    white: Array
    origin: Array
    means: Array
    sizes: Array
    scale: Array
    weights: Array

    def without(self, effect: Rows, allowed: Bools) -> Curves:
        """The same by fewer discriminants, of which those of excluded effects are no part.

        In whitened discriminants these move along their rows of `white`. What is across is whitened
        by the covariance of the others.

        Args:
            effect: index of the effect of each discriminant, -1 of a nuisance, shape (targets,).
            allowed: effects that the library has, shape (effects,).
        """
        excluded = (effect >= 0) & ~allowed[effect]
        if not excluded.any():
            return self
        turned = np.linalg.qr(self.white[excluded].T, mode="complete")[0]
        across = turned[:, int(excluded.sum()) :]
        return replace(self, white=self.white @ across, means=self.means @ across)


def kernel_coordinates(library: Library, name: str, acting: Sequence[Acting]) -> Array:
    """Where effects lie for the kernel: amplitude, side, logarithms of sizes, other coordinates."""
    free = free_parameters(library[name])
    index = [list(library[name].parameters).index(p) for p in free]
    values = np.array([[one.values[k] for k in index] for one in acting])
    size = np.array([one.size for one in acting])
    gaps, others = [], []
    for p, value in zip(free, values.T, strict=True):
        if is_angle(p):
            turn = 2 * np.pi * (value - p.lower) / turn_of(p)
            others += [np.cos(turn), np.sin(turn)]
        elif p.secondary:
            others.append(2 * (value - p.lower) / (p.upper - p.lower))
        else:
            gap = np.abs(1 / value if np.isinf(p.null) else value - p.null)
            gaps.append(gap / max(float(gap.max()), SECOND_CAUSE.tiny))
    share = np.array(gaps).reshape(len(gaps), len(size))
    share /= np.maximum(share.max(axis=0, initial=0.0), SECOND_CAUSE.tiny)
    amplitude = np.minimum(size, SUMMARY.largest) ** SUMMARY.power
    side = np.array([float(one.side) for one in acting])
    logs = np.log(share * size + SECOND_CAUSE.added_size) / SECOND_CAUSE.width
    return np.stack(
        [amplitude, side, *logs, *(2 * one / SECOND_CAUSE.width for one in others)], axis=1
    )


def kernel(one: Array, other: Array) -> Array:
    """Covariance of what effects give at two sets of coordinates."""
    apart = ((one[:, None, 2:] - other[None, :, 2:]) ** 2).sum(axis=-1)
    same = one[:, None, 1] == other[None, :, 1]
    amplitude = one[:, None, 0] * other[None, :, 0]
    return np.asarray(SECOND_CAUSE.variance * amplitude * same * np.exp(-0.5 * apart))


@dataclass(frozen=True, eq=False)
class Design:
    """What acts in campaigns, as regressors of which discriminants are a sum.

    Attributes:
        regressors: of effects, then nuisances, shape (n, regressors).
        curves: of points to those of effects, one a curve that has any: effect, the first of its
            regressors, matrix of shape (points, points).
        sizes: of the points, shape (effects, points).
    """

    regressors: Array
    curves: tuple[tuple[int, int, Array], ...]
    sizes: Array

    @classmethod
    def of(cls, campaigns: Campaigns, library: Library) -> Design:
        """Points of a curve are spread over the campaigns in which the effect acts."""
        parts: list[Array] = []
        curves: list[tuple[int, int, Array]] = []
        sizes = np.zeros((len(library), SECOND_CAUSE.points))
        for e, name in enumerate(library):
            own = [(r, a) for r, s in enumerate(campaigns.sets) for a in s if a.name == name]
            if not own:
                continue
            where = kernel_coordinates(library, name, [a for _, a in own])
            order = sorted(range(len(own)), key=lambda k: (own[k][1].side, own[k][1].size))
            chosen = [
                order[k] for k in np.linspace(0, len(own) - 1, SECOND_CAUSE.points).astype(int)
            ]
            sizes[e] = [own[k][1].size for k in chosen]
            points = where[chosen]
            covariance = kernel(points, points)
            covariance[np.diag_indices(SECOND_CAUSE.points)] += SECOND_CAUSE.jitter * max(
                covariance.max(), SECOND_CAUSE.tiny
            )
            # Regressors of unit prior variance.
            root: Array = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
            part = np.zeros((len(campaigns), SECOND_CAUSE.points))
            part[[r for r, _ in own]] = np.linalg.solve(root, kernel(points, where)).T
            curves.append((e, sum(one.shape[1] for one in parts), root))
            parts.append(part)
        parts.append(np.sqrt(SECOND_CAUSE.nuisance) * campaigns.nuisances)
        return cls(np.concatenate(parts, axis=1), tuple(curves), sizes)

    def fitted(self, mean: Array, origin: Array, rows: Rows) -> tuple[Array, Array]:
        """Curves from some campaigns, and what effects give in all by them.

        Args:
            mean: discriminants, over copies, shape (n, targets).
            origin: of those without effect, shape (targets,).
            rows: campaigns that are fitted.

        Returns:
            Shape (effects, points, targets), and (n, targets).
        """
        weights = ridge(self.regressors[rows], mean[rows] - origin, 1.0)
        means = np.zeros((*self.sizes.shape, mean.shape[1]))
        for effect, first, root in self.curves:
            means[effect] = root @ weights[first : first + SECOND_CAUSE.points]
        count = len(self.curves) * SECOND_CAUSE.points
        return means, self.regressors[:, :count] @ weights[:count]


@dataclass(frozen=True, eq=False)
class Seen:
    """What the networks make of one campaign, of which the refinement needs a part.

    Attributes:
        none, outside: probabilities.
        alone: of each effect alone, shape (effects,).
        beside: of each pair, shape (effects, effects).
        acts: of each effect in any set, shape (effects,).
    """

    none: float
    outside: float
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
            float(probability[0]), float(probability[-1]), probability[1 : 1 + count],
            beside + beside.T, sets.marginal(probability),
        )  # fmt: skip

    @property
    def leading(self) -> Array:
        """Probability that each effect acts alone, or leads another, shape (effects,)."""
        place = np.argsort(np.argsort(-self.acts, kind="stable"))
        leads = place[:, None] < place[None]
        return np.asarray(self.alone + (self.beside * leads).sum(axis=1))


def features(
    curves: Curves, own: Array, lead: int, seen: Seen, alike: Bools, allowed: Bools
) -> Array:
    """What is judged of each other effect, and of nothing more, beside the one that leads.

    Args:
        curves: of the effects.
        own: whitened discriminants of the campaign, shape (whitened,).
        lead: index of the effect that leads.
        seen: what the networks make of the campaign.
        alike: effects declared alike, shape (effects, effects).
        allowed: effects that the library has, shape (effects,).

    Returns:
        Shape (effects + 1, features), nothing more last; columns are of one or of the other.
    """
    means = curves.means
    gain = means @ own - 0.5 * (means**2).sum(axis=-1)
    alone = gain[lead]
    left = float(own @ own - 2 * alone.max())
    # A campaign that no curve meets counts for less.
    heat = max(1.0, left / own.size)
    both = alone[:, None, None] + gain[None] - np.tensordot(means[lead], means, (1, 2))
    most = both.max(axis=(0, 2))
    rise = (most - alone.max()) / heat
    summed = np.log(np.exp((both - most[None, :, None]) / heat).mean(axis=(0, 2)))
    evidence = rise + summed - np.log(np.exp((alone - alone.max()) / heat).mean())
    evidence = np.clip(evidence, -SECOND_CAUSE.most_evidence, SECOND_CAUSE.most_evidence)
    root = np.sqrt(np.maximum(rise, 0.0))
    other = allowed & (np.arange(len(root)) != lead)
    root[~other] = 0.0
    second, first = np.sort(root)[-2:]
    lone = root - np.where(root >= first, second, first)
    own_size = np.log(curves.sizes[lead, int(alone.argmax())] + SECOND_CAUSE.added_size)
    place = both.max(axis=0).argmax(axis=1)
    size = np.log(
        np.take_along_axis(curves.sizes, place[:, None], 1)[:, 0] + SECOND_CAUSE.added_size
    )
    total = max(float(seen.alone[lead] + seen.beside[lead].sum()), SECOND_CAUSE.tiny)
    share = np.log(np.maximum(seen.beside[lead] / total, SECOND_CAUSE.tiny))
    same = alike[lead].astype(np.float64)
    logs = np.log(np.maximum(seen.acts, SECOND_CAUSE.tiny))
    shape = np.full(share.shape, own_size)
    others = np.stack(
        [root, root**2, evidence, size, lone, share, logs, same, same * root, root * own_size,
         share * root, shape, np.full(share.shape, np.log(heat))], axis=1,
    )  # fmt: skip
    others[~other] = 0.0
    alone_share = np.log(max(float(seen.alone[lead]) / total, SECOND_CAUSE.tiny))
    rest = evidence[other].max(initial=-SECOND_CAUSE.most_evidence)
    nothing = [
        alone_share, first, first**2, rest, alone_share * first, own_size, np.log(heat),
        np.log(max(seen.none, SECOND_CAUSE.tiny)), np.log(max(seen.outside, SECOND_CAUSE.tiny)),
    ]  # fmt: skip
    out = np.zeros((len(share) + 1, others.shape[1] + len(nothing)))
    out[:-1, : others.shape[1]] = others
    out[-1, others.shape[1] :] = nothing
    return out


def odds(curves: Curves, found: Array, allowed: Bools) -> Array:
    """Probability of each other effect and of nothing more, shape (..., effects + 1).

    Args:
        curves: with the logit's weights.
        found: features, shape (..., effects + 1, features).
        allowed: what may stand there, shape (..., effects + 1).
    """
    logits = np.where(allowed, _scaled(curves, found) @ curves.weights, -np.inf)
    out = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(out / out.sum(axis=-1, keepdims=True))


def refined(
    probability: Array,
    sets: Sets,
    alike: Bools,
    allowed: Bools,
    discriminants: Array,
    curves: Sequence[Curves],
) -> Array:
    """Probability of every set: what an effect has that leads is shared out again.

    Shared out is what it has alone and with another; none, outside and larger sets keep theirs.

    Args:
        probability: by the networks, shape (sets,).
        sets: the hypotheses.
        alike: effects declared alike, shape (effects, effects).
        allowed: effects that the library has, shape (effects,).
        discriminants: of the campaign, shape (targets,).
        curves: of the folds that count, whose probabilities are averaged, without the
            discriminants of excluded effects.
    """
    seen = Seen.of(probability, sets)
    leading = seen.leading
    alone, beside = np.array(seen.alone), np.array(seen.beside)
    place = np.argsort(np.argsort(-seen.acts, kind="stable"))
    led = np.flatnonzero(leading > SECOND_CAUSE.least)
    for lead in led:
        below = place > place[lead]
        beside[lead, below] = beside[below, lead] = 0.0
        alone[lead] = 0.0
    for lead in led:
        may = np.append(allowed, True)
        may[lead] = False
        share = np.zeros(may.size)
        for one in curves:
            own = (discriminants - one.origin) @ one.white
            share += odds(one, features(one, own, int(lead), seen, alike, allowed), may) / len(
                curves
            )
        alone[lead] += leading[lead] * share[-1]
        beside[lead] += leading[lead] * share[:-1]
        beside[:, lead] += leading[lead] * share[:-1]
    out = np.array(probability)
    count, pairs = len(sets.names), sets.by_size[1]
    out[1 : 1 + count] = alone
    out[1 + count : 1 + count + len(pairs)] = beside[pairs[:, 0], pairs[:, 1]]
    return out


def fit_curves(
    found: Array,
    campaigns: Campaigns,
    library: Library,
    truth: Truth,
    fold: Rows,
    probability: Callable[[int, Rows], Array],
) -> tuple[Curves, ...]:
    """One of each fold, made of the other folds.

    Args:
        found: discriminants of each copy of campaigns, shape (copies, n, targets).
        campaigns: simulated.
        library: effects.
        truth: of the campaigns.
        fold: group of each campaign.
        probability: of every set in some campaigns of a copy, by networks that did not see them.
    """
    mean = found.mean(axis=0)
    design = Design.of(campaigns, library)
    origin = mean[campaigns.gap_free].mean(axis=0)
    means, given = [], np.zeros(mean.shape)
    for k in range(SUMMARY.folds):
        points, by_others = design.fitted(mean, origin, np.flatnonzero(fold != k))
        means.append(points)
        given[fold == k] = by_others[fold == k]
    white = _whitening(found[1:] - origin - given)
    empty = np.zeros(0)
    plain = [Curves(white, origin, points @ white, design.sizes, empty, empty) for points in means]
    seen, rows, chosen = _judged(found, plain, truth, fold, probability)
    scale = seen.std(axis=(0, 1)) + SECOND_CAUSE.tiny
    out = []
    for k, one in enumerate(plain):
        own = fold[rows[:, 0]] != k
        one = replace(one, scale=scale)
        weights = _conditional_logit(_scaled(one, seen[own]), rows[own], chosen[own])
        out.append(replace(one, weights=weights))
    return tuple(out)


def _whitening(left: Array) -> Array:
    """From discriminants to those whose chance has unit covariance; large ones count for less."""
    flat = left.reshape(-1, left.shape[-1])
    scale = flat.std(axis=0) + SECOND_CAUSE.tiny
    flat = flat / scale
    size = np.sqrt((flat**2).mean(axis=1, keepdims=True))
    flat = flat / np.maximum(size / np.median(size), 1.0)
    covariance = (1 - SECOND_CAUSE.shrunk) * flat.T @ flat / len(flat)
    covariance[np.diag_indices(len(covariance))] += SECOND_CAUSE.shrunk
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)).T / scale[:, None])


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
    out: list[Array] = []
    rows: list[tuple[int, int, int]] = []
    weight: list[float] = []
    nothing = len(truth.sets.names)
    everything = np.ones(nothing, dtype=bool)
    few = np.isin(truth.acting.sum(axis=1), (1, 2))
    for copy in range(len(found) - SECOND_CAUSE.copies, len(found)):
        for k, one in enumerate(curves):
            held = np.flatnonzero((fold == k) & few)
            own = (found[copy, held] - one.origin) @ one.white
            for i, place, p in zip(held, own, probability(copy, held), strict=True):
                seen = Seen.of(p, truth.sets)
                acting = np.flatnonzero(truth.acting[i])
                for lead in acting:
                    others = acting[acting != lead]
                    out.append(
                        features(one, place, int(lead), seen, truth.alike, everything).astype(
                            np.float32
                        )
                    )
                    rows.append((int(i), int(lead), int(others[0]) if others.size else nothing))
                    weight.append(float(truth.weight[i] * seen.leading[lead]))
    return np.array(out), np.array(rows), np.array(weight)


def _scaled(curves: Curves, found: Array) -> Array:
    """Features in their deviations, and the constant of nothing more."""
    most = SECOND_CAUSE.most_deviation
    out = np.clip(found / curves.scale, -most, most)
    constant = np.zeros((*out.shape[:-1], 1))
    constant[..., -1, :] = 1.0
    return np.concatenate([out, constant], axis=-1)


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
