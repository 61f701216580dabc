"""The posterior over what acts, by sequential Monte Carlo.

Particles of the prior are led to the posterior through powers of the likelihood (P. Del Moral, A.
Doucet, A. Jasra, "Sequential Monte Carlo samplers", Journal of the Royal Statistical Society B 68,
2006). Three moves leave each power's distribution as it is: a walk along differences of particles
(C. J. F. ter Braak, "A Markov chain Monte Carlo version of the genetic algorithm differential
evolution", Statistics and Computing 16, 2006), which also draws again what does not act; an effect
that begins or ceases to act; and one that takes the place of another. What does not act keeps
coordinates of its prior, so that all particles have one dimension (B. P. Carlin, S. Chib, "Bayesian
model choice via Markov chain Monte Carlo methods", ibid. 57, 1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.outcome_model import OutcomeModel, Particles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SamplerConstants:
    """How the posterior is sampled; chosen by hand, judged by how other seeds agree.

    Attributes:
        particles: their number, where scenes are chosen.
        final: their number, where it is said what acts.
        rounds: of walk, flip, walk, swap at each power.
        effective: share of the particles that the next power leaves.
        halvings: by which it is found.
        steps: of the walk, in differences of two particles, of which each particle takes one.
        shorter: of steps in nuisances, strength, scatter and error, over those in coordinates.
        jitter: beside these, in coordinates and standard deviations.
        acceptance: that the length of steps is led to.
    """

    particles: int = 600
    final: int = 3000
    rounds: int = 5
    effective: float = 0.5
    halvings: int = 30
    steps: tuple[float, ...] = (0.2, 0.5)
    shorter: float = 0.5
    jitter: float = 0.1
    acceptance: float = 0.25


SAMPLER = SamplerConstants()


@dataclass(frozen=True, eq=False)
class ActingPosterior:
    """What acts, given outcomes.

    Attributes:
        particles: equally probable.
        log_evidence: of the outcomes, to the power that was asked for.
    """

    particles: Particles
    log_evidence: float


def sample_posterior(
    model: OutcomeModel,
    rows: NDArray[np.int64],
    rng: np.random.Generator,
    *,
    particles: int = SAMPLER.particles,
    power: float = 1.0,
) -> ActingPosterior:
    """Sample what acts, given the outcomes of some trials.

    Args:
        model: of outcomes.
        rows: of the trials that are seen.
        rng: of all draws.
        particles: their number.
        power: of the likelihood; below 1, what acts is less sure than the outcomes make it.
    """
    from scipy.special import logsumexp

    here = model.draw(particles, rng)
    logs = model.log_likelihood(here, rows)
    reached, evidence, length = 0.0, 0.0, 1.0
    while reached < power:
        following = _next_power(logs, reached, power)
        weights = (following - reached) * logs
        total = logsumexp(weights)
        evidence += float(total) - np.log(particles)
        reached = following
        ends = np.cumsum(np.exp(weights - total))
        chosen = np.searchsorted(ends, (rng.random() + np.arange(particles)) / particles)
        chosen = np.minimum(chosen, particles - 1)
        here, logs = here.taken(chosen), logs[chosen]
        accepted = []
        for _ in range(SAMPLER.rounds):
            for move in (_walk, _flip, _walk, _swap):
                there, ratio = move(model, here, rng, length)
                possible = np.isfinite(ratio)
                new = np.full(particles, -np.inf)
                if possible.any():
                    new[possible] = model.log_likelihood(there.taken(possible), rows)
                with np.errstate(invalid="ignore"):
                    taken = np.log(rng.random(particles)) < ratio + reached * (new - logs)
                here, logs = here.mixed(there, taken), np.where(taken, new, logs)
                if move is _walk:
                    accepted.append(float(taken.mean()))
        length *= float(np.exp(np.mean(accepted) - SAMPLER.acceptance))
    return ActingPosterior(here, evidence)


def _next_power(logs: Array, power: float, most: float) -> float:
    """The power of the likelihood that leaves enough effective particles."""
    from scipy.special import logsumexp

    def enough(step: float) -> bool:
        effective = np.exp(2 * logsumexp(step * logs) - logsumexp(2 * step * logs))
        return bool(effective > SAMPLER.effective * logs.size)

    if enough(most - power):
        return most
    low, high = 0.0, most - power
    for _ in range(SAMPLER.halvings):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if enough(middle) else (low, middle)
    return power + low


def _walk(
    model: OutcomeModel, here: Particles, rng: np.random.Generator, length: float
) -> tuple[Particles, Array]:
    """Steps along the difference of two other particles, of what acts in all three."""
    count, space = len(here), model.space
    one, other = rng.integers(count, size=(2, count))
    step = length * rng.choice(SAMPLER.steps, size=count)
    jitter = SAMPLER.jitter * length
    owner = space.effect_of
    acting = here.acts[:, owner]
    common = here.acts[one][:, owner] & here.acts[other][:, owner]
    points = here.points + jitter * rng.standard_normal(here.points.shape)
    points += np.where(common, step[:, None] * (here.points[one] - here.points[other]), 0.0)
    width = 1 - space.lows
    points = np.where(space.turns, (points - space.lows) % width + space.lows, points)
    points = np.where(acting, points, space.draw(count, rng))
    ratio = np.where(((points < space.lows) | (points > 1)).any(axis=1), -np.inf, 0.0)
    moved = {}
    for name in ("nuisances", "strength", "scatter", "error"):
        old = getattr(here, name)
        along = step.reshape((-1,) + (1,) * (old.ndim - 1))
        drift = SAMPLER.shorter * along * (old[one] - old[other])
        new = old + drift + jitter * rng.standard_normal(old.shape)
        moved[name] = new
        ratio += 0.5 * (old**2 - new**2).reshape(count, -1).sum(axis=1)
    return replace(here, points=points, **moved), ratio


def _flip(
    model: OutcomeModel, here: Particles, rng: np.random.Generator, length: float
) -> tuple[Particles, Array]:
    """An effect begins or ceases to act."""
    count = len(here)
    possible = np.flatnonzero(model.open)
    if not possible.size:
        return here, np.full(count, -np.inf)
    chosen = possible[rng.integers(possible.size, size=count)]
    rows = np.arange(count)
    acted = here.acts[rows, chosen]
    acts = here.acts.copy()
    acts[rows, chosen] = ~acted
    odds = np.log(model.prior[chosen] / (1 - model.prior[chosen]))
    there = _redrawn(model, replace(here, acts=acts), chosen, rng)
    return there, np.where(acted, -odds, odds)


def _swap(
    model: OutcomeModel, here: Particles, rng: np.random.Generator, length: float
) -> tuple[Particles, Array]:
    """An effect takes the place of another."""
    count = len(here)
    free, bound = ~here.acts & model.open, here.acts & model.open
    possible = bound.any(axis=1) & free.any(axis=1)
    ceases = (rng.random(here.acts.shape) * bound).argmax(axis=1)
    begins = (rng.random(here.acts.shape) * free).argmax(axis=1)
    rows = np.arange(count)
    acts = here.acts.copy()
    acts[rows[possible], ceases[possible]] = False
    acts[rows[possible], begins[possible]] = True
    there = replace(here, acts=acts)
    for effect in (ceases, begins):
        there = _redrawn(model, there, effect, rng)
    # Equal prior probabilities of all effects, and as many choices on the way back.
    return there, np.where(possible, 0.0, -np.inf)


def _redrawn(
    model: OutcomeModel, there: Particles, effect: NDArray[np.int64], rng: np.random.Generator
) -> Particles:
    """Coordinates from their prior of an effect that begins, or of one that ceases to act."""
    columns = model.space.effect_of == effect[:, None]
    points = np.where(columns, model.space.draw(len(there), rng), there.points)
    motion = effect == len(model.names) - 1
    strength = np.where(motion, rng.standard_normal(len(there)), there.strength)
    return replace(there, points=points, strength=strength)
