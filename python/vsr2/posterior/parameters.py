"""Parameters of what acts: samples of their posterior.

Each free parameter is regressed on the residuals of the simulated campaigns in which its effect
acts. A sample is the regressed value of the observed campaign, plus what the regression missed in
one of the simulated campaigns whose regressed values lie nearest: regression adjustment (M. A.
Beaumont, W. Zhang, D. J. Balding, "Approximate Bayesian computation in population genetics",
Genetics 162, 2002). What it missed is of a regression without that campaign, so that intervals hold
what they state. Where these campaigns are few, their scatter is uncertain, too: samples are spread
about their mean as those of Student's t are, whose variance is that of n values and unknown (A.
Gelman et al., "Bayesian Data Analysis", 3rd edition, 2013, section 3.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Parameter
from vsr2.ensemble.simulated.campaigns import Campaigns
from vsr2.ensemble.simulated.library import Library, free_parameters, is_angle, turn_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ParameterConstants:
    """How parameters are regressed; chosen by hand, judged by coverage on campaigns held out.

    Attributes:
        penalty: of the ridge regression, over the mean square of a campaign's residuals.
        intercept: mean square of the column of the intercept over that of a campaign's residuals.
        nearest: campaigns that samples are made of, at least.
        share: of those in which the effect acts, at least.
        samples: of a posterior.
        least_weight: of a nearest campaign, over that of one at no distance.
        least_freedom: degrees of freedom of the samples' spread.
    """

    penalty: float = 0.05
    intercept: float = 100.0
    nearest: int = 30
    share: float = 0.5
    samples: int = 400
    least_weight: float = 0.05
    least_freedom: float = 1.0


PARAMETERS = ParameterConstants()


@dataclass(frozen=True, eq=False)
class Parameters:
    """Of all effects.

    Attributes:
        library: effects.
        residuals: of the campaigns with an effect, disturbed, shape (n, columns).
        rows: of the campaigns in which each effect acts, by name.
        values: of its free parameters there, shape (rows, parameters), by name.
    """

    library: Library
    residuals: NDArray[np.float32]
    rows: Mapping[str, NDArray[np.int64]]
    values: Mapping[str, Array]

    @property
    def known(self) -> frozenset[str]:
        """Effects that act in a simulated campaign; of others there are no parameters to sample."""
        return frozenset(self.rows)

    def sample(
        self,
        name: str,
        residuals: Array,
        rng: np.random.Generator,
        *,
        columns: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Samples of an effect's free parameters given one campaign, shape (samples, parameters).

        Args:
            name: of the effect, one of `known`.
            residuals: of the campaign, shape (columns,).
            rng: of the draws.
            columns: of the residuals that are known; None: all.
        """
        near, weight, shift = self._nearest(name, residuals, columns)
        chosen = rng.choice(near.size, PARAMETERS.samples, p=weight)
        points = self._targets(name)[near] + shift
        mean, count = weight @ points, 1 / float((weight**2).sum())
        freedom = max(count - 1, PARAMETERS.least_freedom)
        spread = np.sqrt((1 + 1 / count) * freedom / rng.chisquare(freedom, chosen.size))
        return self._values(name, mean + spread[:, None] * (points[chosen] - mean))

    def expected(self, name: str, residuals: Array) -> Array:
        """Mean residuals of campaigns like one in which an effect acts, shape (columns,)."""
        near, weight, _ = self._nearest(name, residuals, None)
        return np.asarray(weight @ self.residuals[self.rows[name][near]])

    def _nearest(
        self, name: str, residuals: Array, columns: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Campaigns whose regressed targets lie nearest, their weights, how far these are off."""
        known = slice(None) if columns is None else columns
        x = self.residuals[self.rows[name]][:, known].astype(np.float64)
        own, left_out = _regressed(x, self._targets(name), residuals[known])
        scale = np.maximum(left_out.std(axis=0), 1e-9)
        distance = np.sqrt((((left_out - own) / scale) ** 2).sum(axis=1))
        count = min(max(PARAMETERS.nearest, int(PARAMETERS.share * len(distance))), len(distance))
        order = np.argsort(distance, kind="stable")[:count]
        width = max(float(distance[order[-1]]), 1e-9)
        weight = np.maximum(1 - (distance[order] / width) ** 2, PARAMETERS.least_weight)
        return order, weight / weight.sum(), own - left_out[order]

    def _targets(self, name: str) -> Array:
        """What is regressed, shape (rows, targets): see `_values` for the way back.

        Of a primary parameter its distance from the null, over the greatest; of an angle a point on
        the circle; of others the value over their range.
        """
        columns = []
        for parameter, value in zip(self._free(name), self.values[name].T, strict=True):
            if is_angle(parameter):
                turn = 2 * np.pi * (value - parameter.lower) / turn_of(parameter)
                columns += [np.cos(turn), np.sin(turn)]
            elif parameter.secondary:
                columns.append((value - parameter.lower) / (parameter.upper - parameter.lower))
            else:
                gap = _distance(parameter, value)
                size = max(float(np.abs(gap).max()), 1e-12)
                columns.append(gap / size)
        return np.stack(columns, axis=1)

    def _values(self, name: str, targets: Array) -> Array:
        """Parameters at targets, within their ends, shape (n, parameters).

        Args:
            name: of the effect.
            targets: shape (n, targets).
        """
        columns, k = [], 0
        for parameter, value in zip(self._free(name), self.values[name].T, strict=True):
            if is_angle(parameter):
                turn = np.arctan2(targets[:, k + 1], targets[:, k]) / (2 * np.pi) % 1.0
                columns.append(parameter.lower + turn * turn_of(parameter))
                k += 2
                continue
            ends = np.array([parameter.lower, parameter.upper])
            if parameter.secondary:
                columns.append(ends[0] + np.clip(targets[:, k], 0.0, 1.0) * np.ptp(ends))
            else:
                gap = _distance(parameter, value)
                size = max(float(np.abs(gap).max()), 1e-12)
                gap = nearest_of_prior(targets[:, k] * size, _distance(parameter, ends), 0.0 in gap)
                with np.errstate(divide="ignore"):
                    columns.append(1 / gap if np.isinf(parameter.null) else parameter.null + gap)
            k += 1
        return np.stack(columns, axis=1)

    def _free(self, name: str) -> tuple[Parameter, ...]:
        return free_parameters(self.library[name])


def _distance(parameter: Parameter, value: Array) -> Array:
    """From the null; of an infinite null the inverse of the value."""
    return 1 / value if np.isinf(parameter.null) else value - parameter.null


def nearest_of_prior(gap: Array, ends: Array, null: bool) -> Array:
    """Distances from the null, each at the nearest one that the prior holds.

    Args:
        gap: distances, shape (n,).
        ends: of the prior; zero may lie outside.
        null: whether the null is held too, beside another parameter that acts.
    """
    low, high = np.sort(ends)
    held = np.clip(gap, low, high)
    return np.where(null & (np.abs(gap) < np.abs(gap - held)), 0.0, held)


def fit_parameters(
    library: Library, campaigns: Campaigns, residuals: NDArray[np.floating[Any]]
) -> Parameters:
    """What parameters are sampled from.

    Args:
        library: effects.
        campaigns: simulated.
        residuals: of them, disturbed, shape (n, columns).
    """
    acting = np.flatnonzero(~campaigns.gap_free)
    rows: dict[str, list[int]] = {name: [] for name in library}
    values: dict[str, list[list[float]]] = {name: [] for name in library}
    for place, row in enumerate(acting):
        for one in campaigns.sets[row]:
            effect = library[one.name]
            index = [list(effect.parameters).index(p) for p in free_parameters(effect)]
            rows[one.name].append(place)
            values[one.name].append([one.values[k] for k in index])
    return Parameters(
        library,
        residuals[acting].astype(np.float32, copy=False),
        {name: np.array(own, dtype=np.int64) for name, own in rows.items() if own},
        {name: np.array(own, dtype=np.float64) for name, own in values.items() if own},
    )


def _regressed(x: Array, y: Array, own: Array) -> tuple[Array, Array]:
    """Ridge regression in its dual form: of one campaign, and of each other without itself.

    Leaving a row out of a ridge regression needs no second fit (G. H. Golub, M. Heath, G. Wahba,
    "Generalized cross-validation", Technometrics 21, 1979).
    """
    gram = x @ x.T
    scale = float(np.trace(gram)) / len(x)
    # The intercept is a column so large that the penalty does not reach it.
    intercept = PARAMETERS.intercept * scale
    gram += intercept
    gram[np.diag_indices(len(x))] += PARAMETERS.penalty * scale
    inverse = np.linalg.inv(gram)
    dual = inverse @ y
    return (own @ x.T + intercept) @ dual, y - dual / np.diag(inverse)[:, None]
