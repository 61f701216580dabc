"""An emulator of margins: what they would be in a scene that was not simulated.

A Gaussian process over what acts in a scene, common to all trials (C. E. Rasmussen, C. K. I.
Williams, "Gaussian Processes for Machine Learning", 2006; for several outputs with one kernel, S.
Conti, A. O'Hagan, "Bayesian emulation of complex multi-output and dynamic computer models", Journal
of Statistical Planning and Inference 140, 2010). Its kernel holds effects, their squares and their
products two by two: k(x, y) = s^2 + w.x.y + c (w.x.y)^2, with the sum over features weighted. Most
effects matter little: weights have an exponential prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EmulatorConstants:
    """How an emulator is fitted; chosen by hand, judged by scenes left out one by one.

    Attributes:
        weight: mean of the prior of a feature's weight, in margin for each unit of it.
        evidence: number of trials that the weights' prior counts as.
        start: weight, constant and noise from which the fit begins.
        product: weight of products from which the fit begins.
        ends: of the logarithms of weights, products, constant and noise.
        steps: of the fit at most.
    """

    weight: float = 0.1
    evidence: float = 3.0
    start: float = 0.1
    product: float = 1.0
    ends: tuple[tuple[float, float], ...] = ((-9.0, 1.0), (-4.0, 4.0), (-5.0, 1.0), (-4.0, 0.0))
    steps: int = 500


EMULATOR = EmulatorConstants()


@dataclass(frozen=True, eq=False)
class MarginEmulator:
    """Of all trials.

    Attributes:
        weights: of the features, shape (features,).
        product: c of the kernel.
        constant: s of the kernel.
        noise: standard deviation of a margin that features do not tell: chaos and interactions of
            more than two effects.
        scenes: weighted features of the scenes, shape (scenes, features).
        centre: mean margin of each trial, NaN where all its simulations failed, shape (trials,).
        inverse: of the scenes' covariance, shape (scenes, scenes).
        deviations: of the scenes' margins from the centre, shape (scenes, trials).
    """

    weights: Array
    product: float
    constant: float
    noise: float
    scenes: Array
    centre: Array
    inverse: Array
    deviations: Array

    def __call__(self, features: Array) -> tuple[Array, Array]:
        """Mean and variance of margins.

        Args:
            features: of scenes, shape (n, features).

        Returns:
            Means, NaN of trials without a margin in any scene, shape (n, trials), and variances,
            equal for all trials, shape (n,).
        """
        weighted = features * self.weights
        crossed = self._kernel(weighted @ self.scenes.T)
        own = self._kernel((weighted**2).sum(axis=1))
        explained = ((crossed @ self.inverse) * crossed).sum(axis=1)
        variance = np.maximum(own - explained, 0.0) + self.noise**2
        return self.centre + crossed @ (self.inverse @ self.deviations), variance

    def knowing(self, features: Array) -> MarginEmulator:
        """With one more scene, whose margins are those it expects: its variances are then right.

        Args:
            features: of the scene, shape (features,).
        """
        new = features * self.weights
        crossed = self._kernel(self.scenes @ new)
        own = self._kernel(new @ new) + self.noise**2
        covariance = np.block(
            [[np.linalg.inv(self.inverse), crossed[:, None]], [crossed[None], own[None, None]]]
        )
        expected = crossed @ (self.inverse @ self.deviations)
        return replace(
            self,
            scenes=np.vstack([self.scenes, new]),
            inverse=np.linalg.inv(covariance),
            deviations=np.vstack([self.deviations, expected]),
        )

    def left_out(self) -> tuple[Array, Array]:
        """Errors of each scene's margins without it, and their standard deviations.

        In closed form (Rasmussen and Williams, section 5.4.2), shapes (scenes, trials), (scenes,).
        """
        diagonal = np.diag(self.inverse)
        return (self.inverse @ self.deviations) / diagonal[:, None], 1 / np.sqrt(diagonal)

    def quality(self) -> dict[str, float | None]:
        """How well it knows a scene that it did not see, over trials whose margins differ.

        None where no trial's do.
        """
        errors, expected = self.left_out()
        varied = np.ptp(self.deviations, axis=0) > 0
        found: dict[str, float | None] = {"used": len(errors)}
        found |= dict.fromkeys(("spread", "error", "error_over_expected"))
        if varied.any():
            errors = errors[:, varied]
            found["spread"] = float(self.deviations[:, varied].std())
            found["error"] = float(np.sqrt((errors**2).mean()))
            found["error_over_expected"] = float(
                np.sqrt(((errors / expected[:, None]) ** 2).mean())
            )
        return found | {"noise": self.noise}

    def _kernel(self, products: Array) -> Array:
        return np.asarray(self.constant**2 + products + self.product * products**2)


def fit_emulator(features: Array, margins: Array) -> MarginEmulator:
    """The most probable emulator of simulated scenes.

    Args:
        features: of the scenes, 0 where nothing acts, shape (scenes, features).
        margins: NaN where a simulation failed, shape (scenes, trials).
    """
    from scipy.optimize import minimize

    known = np.isfinite(margins).sum(axis=0)
    centre = np.where(known > 0, np.nansum(margins, axis=0) / np.maximum(known, 1), np.nan)
    deviations = np.nan_to_num(margins - centre)
    # Trials that always stand tell nothing of weights; all of them would call the rest noise.
    varied = deviations[:, np.ptp(deviations, axis=0) > 0]
    count = features.shape[1]
    log = np.log(EMULATOR.start)
    start = np.r_[np.full(count, log), np.log(EMULATOR.product), log, log]
    ends = [EMULATOR.ends[0]] * count + list(EMULATOR.ends[1:])
    found = minimize(
        _loss, start, args=(features, varied @ varied.T, varied.shape[1]), jac=True,
        method="L-BFGS-B", bounds=ends, options={"maxiter": EMULATOR.steps},
    )  # fmt: skip
    weights, (product, constant, noise) = np.exp(found.x[:count]), np.exp(found.x[count:])
    scenes = features * weights
    products = scenes @ scenes.T
    covariance = constant**2 + products + product * products**2 + noise**2 * np.eye(len(scenes))
    return MarginEmulator(
        weights, product, constant, noise, scenes, centre, np.linalg.inv(covariance), deviations
    )


def _loss(logs: Array, features: Array, squares: Array, trials: int) -> tuple[float, Array]:
    """Negative logarithm of the evidence and of the prior, and its gradient.

    Args:
        logs: logarithms of weights, product, constant and noise.
        features: of the scenes.
        squares: Y Y' of the margins Y about their centre, shape (scenes, scenes).
        trials: their number.
    """
    count = features.shape[1]
    weights, (product, constant, noise) = np.exp(logs[:count]), np.exp(logs[count:])
    scaled = features * weights
    products = scaled @ scaled.T
    identity = np.eye(len(features))
    covariance = constant**2 + products + product * products**2 + noise**2 * identity
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return 1e12, np.zeros_like(logs)
    inverse = np.linalg.inv(covariance)
    value = 0.5 * float((inverse * squares).sum())
    value += trials * float(np.log(np.diag(factor)).sum())
    by_covariance = 0.5 * (trials * inverse - inverse @ squares @ inverse)
    by_products = by_covariance * (1 + 2 * product * products)
    gradient = np.concatenate(
        [
            2 * ((by_products @ scaled) * scaled).sum(axis=0),
            [
                product * (by_covariance * products**2).sum(),
                2 * constant**2 * by_covariance.sum(),
                2 * noise**2 * np.trace(by_covariance),
            ],
        ]
    )
    prior = EMULATOR.evidence * weights / EMULATOR.weight
    gradient[:count] += prior
    return value + float(prior.sum()), gradient
