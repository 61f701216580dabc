"""Parameters of what acts: samples of their posterior.

Each free parameter is regressed on the residuals of the simulated campaigns in which its effect
acts. The posterior of a campaign is the values of those whose regressed values lie nearest to its
own, weighted by nearness (M. A. Beaumont, W. Zhang, D. J. Balding, "Approximate Bayesian
computation in population genetics", Genetics 162, 2002). Each of these was regressed without
itself, so that intervals hold what they state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.simulated.campaigns import Campaigns
from vsr2.diagnosis.simulated.library import Library, free_parameters, is_angle, turn_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ParameterConstants:
    """How parameters are regressed; chosen by hand.

    Attributes:
        penalty: of the ridge regression, over the mean square of a campaign's residuals.
        nearest: campaigns that a posterior is made of, at least.
        share: of those in which the effect acts.
        samples: of a posterior.
    """

    penalty: float = 0.2
    nearest: int = 30
    share: float = 0.2
    samples: int = 400


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

    def sample(
        self,
        name: str,
        residuals: Array,
        seed: int = 0,
        *,
        columns: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Samples of an effect's free parameters given one campaign, shape (samples, parameters).

        Args:
            name: of the effect.
            residuals: of the campaign, shape (columns,).
            seed: of the draws.
            columns: of the residuals that are known; None: all.
        """
        near, weight = self._nearest(name, residuals, columns)
        rng = np.random.default_rng([seed, 41])
        return np.asarray(self.values[name][rng.choice(near, PARAMETERS.samples, p=weight)])

    def expected(self, name: str, residuals: Array) -> Array:
        """Mean residuals of campaigns like one in which an effect acts, shape (columns,)."""
        near, weight = self._nearest(name, residuals, None)
        return np.asarray(weight @ self.residuals[self.rows[name][near]])

    def _nearest(
        self, name: str, residuals: Array, columns: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.int64], Array]:
        """Campaigns whose regressed parameters lie nearest, and their weights."""
        known = slice(None) if columns is None else columns
        x = self.residuals[self.rows[name]][:, known].astype(np.float64)
        own, left_out = _regressed(x, self._targets(name), residuals[known])
        scale = np.maximum(left_out.std(axis=0), 1e-9)
        distance = np.sqrt((((left_out - own) / scale) ** 2).sum(axis=1))
        count = min(max(PARAMETERS.nearest, int(PARAMETERS.share * len(distance))), len(distance))
        order = np.argsort(distance, kind="stable")[:count]
        width = max(float(distance[order[-1]]), 1e-9)
        weight = np.maximum(1 - (distance[order] / width) ** 2, 0.05)
        return order, weight / weight.sum()

    def _targets(self, name: str) -> Array:
        """What is regressed: values, inverse ones of infinite nulls, angles on a circle."""
        columns = []
        for parameter, value in zip(
            free_parameters(self.library[name]), self.values[name].T, strict=True
        ):
            if is_angle(parameter):
                turn = 2 * np.pi * value / turn_of(parameter)
                columns += [np.cos(turn), np.sin(turn)]
            else:
                columns.append(1 / value if np.isinf(parameter.null) else value)
        out = np.stack(columns, axis=1)
        return np.asarray(out / np.maximum(out.std(axis=0), 1e-12))


def fit_parameters(library: Library, campaigns: Campaigns, residuals: Array) -> Parameters:
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
        residuals[acting].astype(np.float32),
        {name: np.array(own, dtype=np.int64) for name, own in rows.items() if own},
        {name: np.array(own, dtype=np.float64) for name, own in values.items() if own},
    )


def _regressed(x: Array, y: Array, own: Array) -> tuple[Array, Array]:
    """Ridge regression in its dual form: of one campaign, and of each other without itself.

    Leaving a row out of a ridge regression needs no second fit (G. H. Golub, M. Heath, G. Wahba,
    "Generalized cross-validation", Technometrics 21, 1979).
    """
    centre = y.mean(axis=0)
    gram = x @ x.T
    gram[np.diag_indices(len(x))] += PARAMETERS.penalty * float(np.trace(gram)) / len(x)
    inverse = np.linalg.inv(gram)
    dual = inverse @ (y - centre)
    return (own @ x.T) @ dual + centre, y - dual / np.diag(inverse)[:, None]
