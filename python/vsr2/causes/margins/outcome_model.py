"""How likely outcomes are, given what acts in the scene.

A trial overturns if its margin, less the logarithm of the factor by which the real motion is
stronger than the scene's, is below 0. What neither scene nor emulator holds scatters it: a part is
common to all trials of a ground motion, which differ in scale alone, and a part belongs to the
trial. The common part is integrated out, so that nine scales of one motion do not count as nine
witnesses (random effects; A. Gelman et al., "Bayesian Data Analysis", 3rd edition, 2013, ch. 5).
What all trials share of the emulator's error is a coordinate of the posterior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.overturning_margin import MARGIN
from vsr2.causes.margins.cause_space import Acts, CauseSpace
from vsr2.causes.margins.margin_emulator import MarginEmulator
from vsr2.causes.margins.session_steps import SeenScenes, SessionSteps

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OutcomeModelConstants:
    """Priors of the outcome model; chosen by hand.

    Attributes:
        causes: expected number of effects that act.
        strength: standard deviation of the logarithm of the motion's factor, where it acts: it is
            a quarter, as far as the two records of a shake table part.
        motion, trial: medians of the scatter of a motion and of a trial.
        spread: standard deviation of the logarithms of these.
        nodes, reach: of the sum over a motion's part, equally spaced, and standard deviations to
            which it goes both ways. An equal spacing sums bells that are as wide as it to 1e-6 and
            better (L. N. Trefethen, J. A. C. Weideman, "The exponentially convergent trapezoidal
            rule", SIAM Review 56, 2014), so motions may scatter three times as trials do.
        most: probability that an effect acts, at most, where few are looked for.
        nuisance: what one standard deviation of a nuisance weighs, in ranges of a cause.
    """

    causes: float = 2.0
    strength: float = 0.25
    motion: float = 0.1
    trial: float = 0.08
    spread: float = 0.7
    nodes: int = 25
    reach: float = 4.0
    most: float = 0.5
    nuisance: float = 0.5


OUTCOME_MODEL = OutcomeModelConstants()


@dataclass(frozen=True, eq=False)
class Particles:
    """Points of the posterior, one row each.

    Attributes:
        points: coordinates of the cause space, shape (n, coordinates).
        acts: which effects act, and last the strength of the motion, shape (n, effects + 1).
        nuisances: standardised, shape (n, q).
        strength: standardised logarithm of the motion's factor, shape (n,).
        scatter: standardised logarithms of the scatter of motions and trials, shape (n, 2).
        error: of the emulator, that all trials share, standardised, shape (n,).
    """

    points: Array
    acts: Acts
    nuisances: Array
    strength: Array
    scatter: Array
    error: Array

    def __len__(self) -> int:
        return len(self.strength)

    def taken(self, rows: NDArray[np.int64] | Acts) -> Particles:
        """Some of them."""
        return Particles(*(getattr(self, one.name)[rows] for one in fields(self)))

    def mixed(self, other: Particles, which: Acts) -> Particles:
        """Others in some rows, shape (n,)."""
        out = {}
        for one in fields(self):
            own, theirs = getattr(self, one.name), getattr(other, one.name)
            rows = which.reshape((-1,) + (1,) * (own.ndim - 1))
            out[one.name] = np.where(rows, theirs, own)
        return replace(self, **out)


@dataclass(frozen=True, eq=False)
class OutcomeModel:
    """Of the trials of a campaign.

    Attributes:
        space: of all causes; those that act throughout first, then the steps.
        emulator: of margins; its features are those of what acts throughout, then
            :func:`emulated_nuisances`.
        overturned: of each trial, shape (trials,).
        motions: ground motion of each trial, shape (trials,).
        nuisances: their number.
        allowed: names of the effects that may act, the strength of the motion by its own; None:
            all.
        expected: number of effects that act, in the prior.
        certain: names of the effects that act for sure.
        steps: what comes in at a session; None: nothing is looked for that does.
    """

    space: CauseSpace
    emulator: MarginEmulator
    overturned: Acts
    motions: NDArray[np.str_]
    nuisances: int
    allowed: frozenset[str] | None = None
    expected: float = OUTCOME_MODEL.causes
    steps: SessionSteps | None = None
    certain: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Of all that may act, the strength of the motion last."""
        return self.space.all_names

    @cached_property
    def prior(self) -> Array:
        """Probability that each effect acts, the strength of the motion last."""
        chance = min(self.expected / len(self.names), OUTCOME_MODEL.most)
        may = [self.allowed is None or name in self.allowed for name in self.names]
        return np.where([name in self.certain for name in self.names], 1.0, chance * np.array(may))

    @cached_property
    def open(self) -> Acts:
        """Whether it is open that each acts, the strength of the motion last."""
        return np.asarray((self.prior > 0) & (self.prior < 1))

    @property
    def looked_for(self) -> tuple[str, ...]:
        """Names of all that may act here."""
        return tuple(name for name, p in zip(self.names, self.prior, strict=True) if p > 0)

    def draw(self, count: int, rng: np.random.Generator) -> Particles:
        """Particles of the prior."""
        return Particles(
            self.space.draw(count, rng),
            rng.random((count, len(self.names))) < self.prior,
            rng.standard_normal((count, self.nuisances)),
            rng.standard_normal(count),
            rng.standard_normal((count, 2)),
            rng.standard_normal(count),
        )

    def margins(self, given: Particles) -> tuple[Array, Array, Array]:
        """Mean margins with the motion's strength, and the emulator's variances.

        Returns:
            Shapes (n, trials), (n,) of what trials of a motion share, (n,) of each trial.
        """
        seen = SeenScenes(self.emulator, emulated_nuisances(given.nuisances), given.error)
        points, acts = given.points, given.acts[:, :-1]
        if self.steps is None:
            mean, by_motion, by_trial = seen(self.space.features(points, acts))
        else:
            mean, by_motion, by_trial = self.steps.margins(seen, points, acts)
        return mean - self.log_strength(given)[:, None], by_motion, by_trial

    def log_strength(self, given: Particles) -> Array:
        """Logarithm of the factor by which the real motion is stronger, shape (n,)."""
        return np.where(given.acts[:, -1], OUTCOME_MODEL.strength * given.strength, 0.0)

    def scatter(self, given: Particles) -> tuple[Array, Array]:
        """Standard deviations of margins by motion and by trial, shapes (n,)."""
        factor = np.exp(OUTCOME_MODEL.spread * given.scatter)
        return OUTCOME_MODEL.motion * factor[:, 0], OUTCOME_MODEL.trial * factor[:, 1]

    def log_likelihood(self, given: Particles, rows: NDArray[np.int64]) -> Array:
        """Of the outcomes of some trials, shape (n,).

        Those without a margin in any scene are as likely as not.
        """
        from scipy.special import logsumexp, ndtr

        mean, of_motion, of_trial = self.margins(given)
        by_motion, by_trial = self.scatter(given)
        by_trial = np.sqrt(by_trial**2 + of_trial)
        order, starts = self._by_motion(rows)
        ordered = rows[order]
        sign = np.where(self.overturned[ordered], 1.0, -1.0)
        nodes = np.linspace(-OUTCOME_MODEL.reach, OUTCOME_MODEL.reach, OUTCOME_MODEL.nodes)
        weights = np.exp(-0.5 * nodes**2)
        common = (np.sqrt(by_motion**2 + of_motion) / by_trial)[:, None] * nodes
        own = sign * mean[:, ordered] / by_trial[:, None]
        # In place: this takes most of a search's time after its simulations.
        logs = common[:, :, None] * sign - own[:, None, :]
        ndtr(logs, out=logs)
        logs *= 1 - MARGIN.lapse
        logs += 0.5 * MARGIN.lapse
        np.log(np.nan_to_num(logs, copy=False, nan=0.5), out=logs)
        together = np.add.reduceat(logs, starts, axis=2)
        mixed = logsumexp(together + np.log(weights / weights.sum())[:, None], axis=1)
        return np.asarray(mixed.sum(axis=1))

    def probability(self, given: Particles, rows: NDArray[np.int64]) -> Array:
        """Of overturning in trials of motions that were not seen, shape (rows,).

        It is 1/2 where no scene has a margin.
        """
        from scipy.special import ndtr

        mean, of_motion, of_trial = self.margins(given)
        by_motion, by_trial = self.scatter(given)
        reach = np.sqrt(by_motion**2 + by_trial**2 + of_motion + of_trial)[:, None]
        chance = ndtr(-mean[:, rows] / reach).mean(axis=0)
        chance = (1 - MARGIN.lapse) * chance + 0.5 * MARGIN.lapse
        return np.asarray(np.nan_to_num(chance, nan=0.5))

    def _by_motion(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Order of some trials by motion, and where each motion starts."""
        _, group = np.unique(self.motions[rows], return_inverse=True)
        order = np.argsort(group, kind="stable")
        return order, np.flatnonzero(np.diff(group[order], prepend=-1))


def joined_particles(some: Sequence[Particles]) -> Particles:
    """All of them, one after another."""
    return Particles(
        *(np.concatenate([getattr(part, one.name) for part in some]) for one in fields(Particles))
    )


def emulated_nuisances(standardised: Array) -> Array:
    """As features of an emulator, shape as given."""
    return OUTCOME_MODEL.nuisance * standardised


def acting_share(particles: Particles, names: tuple[str, ...]) -> Mapping[str, float]:
    """Probability that each effect acts."""
    return dict(zip(names, particles.acts.mean(axis=0).tolist(), strict=True))
