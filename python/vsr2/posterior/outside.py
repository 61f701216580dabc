"""Whether the cause lies outside the library: judged by what the library leaves over.

No network can learn a cause that was never simulated. What tells such a campaign from others must
not depend on which cause it is. It is how far the effects' curves stay away from the campaign,
before any effect is fitted, after one, after two and so on: logarithms of chi-squares. A logistic
regression on these gives the probability of a cause outside. It is learned from parts of the
library that are withheld (:mod:`vsr2.posterior.withheld_parts`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsr2.posterior.effect_curves import Curves
from vsr2.posterior.truth import PRIOR

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OutsideConstants:
    """How a cause outside is judged; chosen by hand.

    Attributes:
        penalty: of the squares of the regression's coefficients, by campaign.
        least: of what is left over by degree of freedom, before the logarithm.
        tiny: least probability of the library, so that its effects keep their odds.
    """

    penalty: float = 1e-3
    least: float = 1e-3
    tiny: float = 1e-9


OUTSIDE = OutsideConstants()


def left_over(curves: Curves, discriminants: Array, most: int) -> Array:
    """What is left of campaigns before an effect is fitted, after one, ..., shape (n, most + 1).

    One effect after the other is added that leaves least, and those before it are fitted again.

    Args:
        curves: of the effects.
        discriminants: of the campaigns, shape (n, targets).
        most: effects that are fitted.

    Returns:
        Logarithms of chi-squares by degree of freedom.
    """
    own = (discriminants - curves.origin) @ curves.white
    count, freedom = own.shape
    effects, points = curves.sizes.shape
    means = curves.means.reshape(effects * points, freedom)
    half, of_point = curves.half_squares.ravel(), np.repeat(np.arange(effects), points)
    most_fitted = min(most, effects)
    fitted = np.zeros((most_fitted, count, freedom))
    taken = np.full((most_fitted, count), -1)
    left = [own]
    for number in range(most_fitted):
        for slot in (number, *range(number)):
            rest = own - fitted.sum(axis=0) + fitted[slot]
            taken[slot] = -1
            gain = rest @ means.T - half
            for other in taken:
                gain[other[:, None] == of_point] = -np.inf
            best = gain.argmax(axis=1)
            better = gain[np.arange(count), best] > 0
            fitted[slot] = np.where(better[:, None], means[best], 0.0)
            taken[slot] = np.where(better, of_point[best], -1)
        left.append(own - fitted.sum(axis=0))
    left += [left[-1]] * (most - most_fitted)
    squares = np.stack([(one**2).sum(axis=1) for one in left], axis=1)
    return np.asarray(np.log(squares / max(freedom, 1) + OUTSIDE.least))


@dataclass(frozen=True, eq=False)
class Outside:
    """Logistic regression of a cause outside on what is left over.

    Attributes:
        constant: of the logit.
        coefficients: of what is left over, shape (most + 1,).
    """

    constant: float
    coefficients: Array

    @classmethod
    def prior(cls, most: int) -> Outside:
        """Where nothing can be withheld: its prior probability, whatever is left over."""
        return cls(float(np.log(PRIOR.outside / (1 - PRIOR.outside))), np.zeros(most + 1))

    @classmethod
    def of(cls, left: Sequence[tuple[Array, Array, bool]], most: int) -> Outside:
        """From campaigns whose cause the library has, and whose cause is withheld.

        Args:
            left: of some campaigns what is left over, shape (n, most + 1), their weights, shape
                (n,), and whether their cause is withheld; each kind counts by its prior.
            most: effects that may act together.
        """
        from scipy.optimize import minimize
        from scipy.special import expit

        if len({outside for _, own, outside in left if own.sum() > 0}) < 2:
            return cls.prior(most)
        x = np.concatenate([own for own, _, _ in left])
        truth = np.concatenate([np.full(len(own), outside) for own, _, outside in left])
        weight = np.concatenate([own for _, own, _ in left])
        for kind, share in ((True, PRIOR.outside), (False, 1 - PRIOR.outside)):
            weight[truth == kind] *= share / weight[truth == kind].sum()
        mean, scale = weight @ x, np.sqrt(weight @ (x - weight @ x) ** 2) + OUTSIDE.least
        terms = np.concatenate([np.ones((len(x), 1)), (x - mean) / scale], axis=1)
        penalty = np.full(terms.shape[1], OUTSIDE.penalty)
        penalty[0] = 0.0

        def score(w: Array) -> tuple[float, Array]:
            logit = terms @ w
            loss = weight @ (np.logaddexp(0, logit) - truth * logit) + penalty @ w**2
            slope = terms.T @ (weight * (expit(logit) - truth)) + 2 * penalty * w
            return float(loss), slope

        w = minimize(score, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B").x
        return cls(float(w[0] - w[1:] @ (mean / scale)), np.asarray(w[1:] / scale))

    def probability(self, left: Array) -> Array:
        """Of a cause outside, shape (n,).

        Args:
            left: what is left over, shape (n, most + 1).
        """
        from scipy.special import expit

        found = expit(self.constant + left @ self.coefficients)
        return np.asarray(np.minimum(found, 1 - OUTSIDE.tiny))

    def beside(self, probability: Array, left: Array) -> Array:
        """Probability of every set, that of outside among them, shape (n, sets).

        Args:
            probability: given that the cause is in the library, shape (n, sets).
            left: what is left over, shape (n, most + 1).
        """
        outside = self.probability(left)[:, None]
        out = probability * (1 - outside)
        out[:, -1:] = outside
        return np.asarray(out)
