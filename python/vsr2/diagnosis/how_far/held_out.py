"""HOW FAR the gap shrinks, judged on motions that neither the fit nor the choice saw.

Motions are dealt into groups; each group is judged once by models that were fitted to, and chosen
on, the others alone. Parameters and nuisances are averaged over their posterior; an effect is
chosen by its evidence. Differences are bootstrapped over motions, all models on the same resamples,
the same simulations behind all of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.emulator import Emulator
from vsr2.diagnosis.likelihood.equivalence import takes_for_alike
from vsr2.diagnosis.likelihood.evidence import (
    Data,
    Posterior,
    Prediction,
    Table,
    drawn_nodes,
    posterior,
    predict,
)
from vsr2.diagnosis.likelihood.pairs import best_pair
from vsr2.diagnosis.likelihood.score import crossfitted, losses
from vsr2.diagnosis.simulated.library import NONE, Library, free_parameters, values_at
from vsr2.diagnosis.simulated.simulator import Effects, nuisance_normal

Array = NDArray[np.float64]
Draw = tuple[Effects, int]
"""How effects act, and the number of a draw of the nuisances."""

PAIR = "pair"
_SPREAD_SEED = 4


@dataclass(frozen=True)
class Pair:
    """Two effects that do better than one on motions that the choice did not see.

    Attributes:
        names: of both.
        probability: of a gain over one effect.
        left: share of the gap of the uncertain trials that both leave.
        closed: share that the second one closes of what the best one alone leaves.
        beyond: share of the gap that both close beyond what a rescaling of the probabilities does.
    """

    names: tuple[str, str]
    probability: float
    left: float
    closed: float
    beyond: float


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float

    def to_json(self) -> dict[str, Any]:
        """As it stands in `diagnosis.json`."""
        return {"value": self.value, "ci95": [self.low, self.high]}


@dataclass(frozen=True, eq=False)
class HeldOutLosses:
    """Held-out losses of each trial.

    Attributes:
        before: without effect.
        after: with the effect chosen on the other motions.
        negative_control: with the best effect of another class, so chosen.
        recalibrated: without effect, the probabilities' logits rescaled and shifted.
        each: with each effect.
        pair: with the best pair; None: none was tried.
        chosen: hypotheses by group, of `before`, `after`, `negative_control` and `pair`.
        draws: of every hypothesis, by group: see :func:`posterior_draws`.
        scaling: shift and slope of the logits behind `recalibrated`, by group, shape (groups, 2).
        predicted_before, predicted_after: probabilities of overturning.
        predicted_pair: the same with the best pair; None: none was tried.
        group: of each trial.
        ranked: effects by their evidence on the other motions, by group.
    """

    before: Array
    after: Array
    negative_control: Array
    recalibrated: Array
    each: dict[str, Array]
    pair: Array | None
    chosen: dict[str, list[str]]
    draws: dict[str, list[list[Draw]]]
    scaling: Array
    predicted_before: Array
    predicted_after: Array
    predicted_pair: Array | None
    group: NDArray[np.int64]
    ranked: list[list[str]]

    def of_pair(self, outside: Collection[str]) -> HeldOutLosses:
        """The same with the pair as what was chosen; as it is if none was tried.

        Args:
            outside: effects that the negative control may not be.
        """
        if self.pair is None or self.predicted_pair is None:
            return self
        negative_control, names = np.zeros_like(self.before), []
        for k, ranked in zip(np.unique(self.group), self.ranked, strict=True):
            name = next((name for name in ranked if name not in outside), NONE)
            losses_of = self.before if name == NONE else self.each[name]
            negative_control[self.group == k] = losses_of[self.group == k]
            names.append(name)
        return replace(
            self,
            after=self.pair,
            predicted_after=self.predicted_pair,
            negative_control=negative_control,
            chosen=self.chosen | {"after": [PAIR] * len(names), "negative_control": names},
        )


def judge(
    library: Library,
    emulator: Emulator,
    tables: Mapping[str, Table],
    observed: Data,
    group: NDArray[np.int64],
    chosen_class: Sequence[str],
    nuisances: Array,
    *,
    pairs: bool,
) -> HeldOutLosses:
    """Hold every group of motions out once.

    Args:
        library: effects that may be chosen.
        emulator: fitted, for pairs.
        tables: of "none" and every effect.
        observed: one campaign.
        group: of each trial; no motion stands in two.
        chosen_class: effects that the verdict does not tell apart; none is the negative control.
        nuisances: standardised draws 1, 2, ..., shape (draws, nuisances).
        pairs: also try pairs.
    """
    blank = np.zeros(observed.overturned.shape[1])
    roles = {role: blank.copy() for role in ("before", "after", "negative_control")}
    p_before, p_after = blank.copy(), blank.copy()
    each = {name: blank.copy() for name in library}
    pair, p_pair = (blank.copy(), blank.copy()) if pairs else (None, None)
    chosen: dict[str, list[str]] = {role: [] for role in (*roles, "pair")}
    draws: dict[str, list[list[Draw]]] = {name: [] for name in (NONE, PAIR, *library)}
    order = []
    for k in np.unique(group):
        judged = group == k
        seen = observed.only(~judged)
        found = {name: posterior(table, seen) for name, table in tables.items()}
        predicted = {name: predict(tables[name], found[name]) for name in tables}
        loss = {name: losses(predicted[name], observed)[0] for name in tables}
        ranked = sorted(library, key=lambda name: -found[name].evidence[0])
        order.append(ranked)
        best = ranked[0]
        wrong = next((name for name in ranked if name not in chosen_class), NONE)
        for role, name in zip(roles, (NONE, best, wrong), strict=True):
            chosen[role].append(name)
            roles[role][judged] = loss[name][judged]
        p_before[judged] = predicted[NONE].probability[0, judged]
        p_after[judged] = predicted[best].probability[0, judged]
        for name in library:
            each[name][judged] = loss[name][judged]
        for name in (NONE, *library):
            given = () if name == NONE else (name,)
            draws[name].append(
                posterior_draws(library, given, tables[name], found[name], nuisances)
            )
        if pair is not None and p_pair is not None:
            second, table, own = best_pair(library, emulator, best, seen)
            both = predict(table, own)
            pair[judged] = losses(both, observed)[0][judged]
            p_pair[judged] = both.probability[0, judged]
            chosen["pair"].append(second)
            draws[PAIR].append(posterior_draws(library, (best, second), table, own, nuisances))
    recalibrated, scaling = _recalibrated(tables[NONE], observed, group)
    return HeldOutLosses(
        **roles,
        recalibrated=recalibrated,
        each=each,
        pair=pair,
        chosen=chosen,
        draws=draws,
        scaling=scaling,
        predicted_before=p_before,
        predicted_after=p_after,
        predicted_pair=p_pair,
        group=group,
        ranked=order,
    )


def _recalibrated(none: Table, observed: Data, group: NDArray[np.int64]) -> tuple[Array, Array]:
    """Losses with rescaled probabilities, shape (trials,), and the scaling of each group."""
    plain = crossfitted(none, observed, group)
    out = np.zeros(group.size)
    scaling = []
    for k in np.unique(group):
        judged = group == k
        scaling.append(_scaling(plain, observed, judged))
        scaled = replace(plain, probability=rescaled(plain.probability, scaling[-1]))
        out[judged] = losses(scaled, observed)[0][judged]
    return out, np.array(scaling)


def posterior_draws(
    library: Library, names: Sequence[str], table: Table, found: Posterior, nuisances: Array
) -> list[Draw]:
    """Effects and nuisances in `PREDICTED` draws from their posterior.

    Of the nuisances the nearest of given draws is taken, by the metric of the posterior.

    Args:
        library: effects.
        names: those of the hypothesis, in the order of the table's columns; empty: none.
        table: of the hypothesis.
        found: its posterior under one campaign.
        nuisances: draws 1, 2, ... of the standardised nuisances, shape (draws, nuisances).

    Returns:
        How the effects act, and the number of the nuisances' draw.
    """
    nodes = drawn_nodes(found)[0]
    count = nuisances.shape[1]
    covariance = found.covariance[0, :count, :count]
    normal = np.stack([nuisance_normal(_SPREAD_SEED, count, i + 1) for i in range(len(nodes))])
    spread = normal @ np.linalg.cholesky(covariance).T
    wanted = (table.weights[nodes] @ found.nuisance[0])[:, :count] + spread
    metric = np.linalg.inv(covariance)
    out = []
    for quantiles, z in zip(table.fine.quantiles[nodes], wanted, strict=True):
        effects: list[tuple[str, tuple[float, ...]]] = []
        start = 0
        for name in names:
            end = start + len(free_parameters(library[name]))
            effects.append((name, values_at(library[name], quantiles[start:end])))
            start = end
        gap = nuisances - z
        nearest = int(np.argmin(np.einsum("ij,jk,ik->i", gap, metric, gap)))
        out.append((tuple(effects), 1 + nearest))
    return out


def rescaled(probability: Array, scaling: Array) -> Array:
    """Probabilities whose logits are shifted and stretched.

    Args:
        probability: any shape.
        scaling: shift and slope.
    """
    from scipy.special import expit, logit

    line = scaling[0] + scaling[1] * logit(probability)
    return np.asarray(np.clip(expit(line), 1e-3, 1 - 1e-3), dtype=np.float64)


def _scaling(prediction: Prediction, observed: Data, judged: NDArray[np.bool_]) -> Array:
    """Platt's scaling, fitted to the trials that are not judged, with a weak pull to no change.

    Each of these is predicted by a model that did not see it, as the judged ones are: predictions
    of trials that a model was fitted to are too good to learn a scaling from.
    """
    from scipy.optimize import minimize
    from scipy.special import expit, logit

    y = observed.overturned[0]
    used = ~judged & np.isfinite(y)
    x, target = logit(prediction.probability[0])[used], y[used]

    def cost(theta: Array) -> tuple[float, Array]:
        line = theta[0] + theta[1] * x
        pull = (theta - [0.0, 1.0]) / 4.0
        wrong = expit(line) - target
        value = np.logaddexp(0.0, line).sum() - (target * line).sum() + 2.0 * (pull**2).sum()
        return float(value), np.array([wrong.sum(), (wrong * x).sum()]) + pull

    return np.asarray(minimize(cost, np.array([0.0, 1.0]), jac=True, method="BFGS").x)


def resampled_means(
    values: Array, motion: NDArray[np.int64], *, replicates: int = 2000, seed: int = 0
) -> Array:
    """Means over trials under a bootstrap of motions, values (k, trials), shape (replicates, k)."""
    from vsr2.campaign import motion_resamples

    counts = motion_resamples(motion, replicates, seed)
    return np.asarray((counts @ values.T) / counts.sum(axis=1)[:, None], dtype=np.float64)


def interval(value: float, draws: Array) -> Interval:
    """The 2.5 and 97.5 % quantiles around an estimate."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return Interval(value, float(low), float(high))


def found_pair(
    held_out: HeldOutLosses, floor: Array, motion: NDArray[np.int64], seed: int
) -> Pair | None:
    """The pair that most groups chose, if its gain over one effect has a lower bound above zero.

    Groups that chose what theory takes for about the same count.

    Args:
        held_out: of the kept trials.
        floor: mean loss of each in campaigns without effect.
        motion: of each.
        seed: of resamples.
    """
    if held_out.pair is None:
        return None
    gain = held_out.after - held_out.pair
    gains = resampled_means(gain[None], motion, seed=seed)[:, 0]
    names = [
        (first, second) if first < second else (second, first)
        for first, second in zip(held_out.chosen["after"], held_out.chosen["pair"], strict=True)
    ]
    common = max(sorted(set(names)), key=names.count)
    if np.quantile(gains, 0.025) <= 0 or 2 * sum(_alike(common, n) for n in names) <= len(names):
        return None
    before, after, left = (
        float((losses - floor).mean())
        for losses in (held_out.before, held_out.after, held_out.pair)
    )
    return Pair(
        common,
        probability=float((gains > 0).mean()),
        left=left / max(before, 1e-9),
        closed=float(gain.mean()) / max(after, 1e-9),
        beyond=float((held_out.recalibrated - held_out.pair).mean()) / max(before, 1e-9),
    )


def _alike(one: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two pairs are the same but for what theory takes for about the same."""
    alike = takes_for_alike()

    def same(a: str, b: str) -> bool:
        return a == b or alike(a, b)

    straight = same(one[0], other[0]) and same(one[1], other[1])
    return straight or (same(one[0], other[1]) and same(one[1], other[0]))
