"""Scenes whose margins are sought: from the prior, of single effects, and of what is likely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.cause_space import Acts, CauseSpace, draw_scene
from vsr2.causes.margins.margin_emulator import MarginEmulator, fit_emulator
from vsr2.causes.margins.margin_search import SEARCH, scene_margins
from vsr2.causes.margins.margin_streams import MarginStream
from vsr2.causes.margins.outcome_model import (
    OutcomeModel,
    Particles,
    emulated_nuisances,
    joined_particles,
)
from vsr2.causes.margins.session_steps import SeenScenes
from vsr2.causes.margins.trial_groups import Rows, TrialGroups, trial_groups
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.library import GAIN
from vsr2.errors import DiagnosisError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SceneConstants:
    """How scenes are chosen; chosen by hand.

    Attributes:
        usual: number of scenes where none is asked for: about an hour on two cores for 300 trials
            of a scanned rock. With 800 the laboratory's motions that were not seen lost .146
            nat a trial, with 600 .154 and .171.
        prior: share of the scenes that are drawn at random.
        alone: share of those in which an effect acts alone, each in its turn.
        powers: of the likelihood, at which these are drawn, in as many rounds.
        rounds: in which the others come from the posterior of the time.
        particles: from which scenes of one effect are chosen.
        least: scenes that an emulator needs.
        known: share of the trials that it is asked for whose margin a scene must have to be used.
    """

    usual: int = 800
    prior: float = 0.25
    alone: float = 0.35
    powers: tuple[float, ...] = (0.5, 1.0)
    rounds: int = 4
    particles: int = 200
    least: int = 24
    known: float = 0.5

    def at_random(self, scenes: int) -> int:
        """Number of scenes that are drawn at random."""
        return max(round(self.prior * scenes), min(self.least, scenes))

    def ends(self, scenes: int) -> tuple[list[int], list[int]]:
        """Number of scenes after each round of single effects, and after each of the posterior."""
        random = self.at_random(scenes)
        alone = max(round((self.prior + self.alone) * scenes), random)
        single = np.linspace(random, alone, len(self.powers) + 1)[1:]
        several = np.linspace(alone, scenes, self.rounds + 1)[1:]
        return [round(float(end)) for end in single], [round(float(end)) for end in several]


SCENES = SceneConstants()


@dataclass(frozen=True, eq=False)
class SimulatedScenes:
    """Scenes and their margins, one row each.

    Attributes:
        points: coordinates of the cause space, shape (scenes, coordinates).
        acts: which effects act, shape (scenes, effects).
        nuisances: standardised, shape (scenes, q).
        margins: NaN where a simulation failed or was not asked for, shape (scenes, trials).
        group: of trials that each was asked for, shape (scenes,).
        groups: of trials.
    """

    points: Array
    acts: Acts
    nuisances: Array
    margins: Array
    group: Rows
    groups: TrialGroups

    def __len__(self) -> int:
        return len(self.points)

    def joined(self, other: SimulatedScenes) -> SimulatedScenes:
        """These and others."""
        return SimulatedScenes(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.acts, other.acts]),
            np.concatenate([self.nuisances, other.nuisances]),
            np.concatenate([self.margins, other.margins]),
            np.concatenate([self.group, other.group]),
            self.groups,
        )

    def known(self) -> SimulatedScenes:
        """Those in which enough of the trials have a margin (`SceneConstants.known`)."""
        asked = self.groups.asked[self.group].sum(axis=1)
        kept = np.isfinite(self.margins).sum(axis=1) >= SCENES.known * asked
        return SimulatedScenes(
            self.points[kept], self.acts[kept], self.nuisances[kept], self.margins[kept],
            self.group[kept], self.groups,
        )  # fmt: skip

    def emulator(self, space: CauseSpace) -> MarginEmulator:
        """Fitted to all of them.

        Raises:
            DiagnosisError: there is none.
        """
        if not len(self):
            raise DiagnosisError(
                "in every scene too few trials end with an outcome; try the scene with "
                "`vsr2 campaign simulate`"
            )
        features = space.features(self.points, self.acts)
        features = np.hstack([features, emulated_nuisances(self.nuisances)])
        return fit_emulator(features, self.margins, self.group, self.groups)


def simulate_scenes(
    cache: SimulationCache,
    space: CauseSpace,
    overturned: Acts,
    motions: NDArray[np.str_],
    count: int,
    *,
    allowed: frozenset[str] | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> SimulatedScenes:
    """Margins of scenes at random, then with each effect alone, then of such as are likely.

    The posterior of what is known says where to simulate next (history matching; I. Vernon, M.
    Goldstein, R. G. Bower, "Galaxy formation: a Bayesian uncertainty analysis", Bayesian Analysis
    5, 2010). But a cause whose margins the emulator knows badly seems unlikely, however well it
    would explain the outcomes. So no effect is dismissed before scenes have shown it where it
    alone, with the strength of the motion, would explain them best.

    Args:
        cache: of simulations.
        space: of causes.
        overturned: outcome of each trial, shape (trials,).
        motions: ground motion of each trial, shape (trials,).
        count: of scenes.
        allowed: as of :class:`OutcomeModel`.
        seed: of all draws.
        progress: called with the share of the scenes that is done.

    Raises:
        DiagnosisError: simulations fail in all scenes.
    """
    random = SCENES.at_random(count)
    pilot = min(SEARCH.pilot, random)
    done = _Simulating(cache, space, trial_groups(motions), count, progress)
    first = [draw_scene(space, row, seed) for row in range(random)]
    points = np.stack([point for point, _ in first])
    acts = np.stack([acting for _, acting in first])
    found = done.run(points[:pilot], acts[:pilot], np.zeros((pilot, overturned.size)))
    guess = _median(found.margins)
    rest = random - pilot
    if rest:
        found = found.joined(done.run(points[pilot:], acts[pilot:], np.tile(guess, (rest, 1))))
    single, several = SCENES.ends(count)
    powers = (*SCENES.powers, *[None] * len(several))
    for (start, stop), power in zip(pairwise([random, *single, *several]), powers, strict=True):
        if start == stop:
            continue
        nuisances = done.nuisances(start, stop)
        emulator = found.known().emulator(space)
        model = OutcomeModel(space, emulator, overturned, motions, nuisances.shape[1], allowed)
        rng = np.random.default_rng([seed, MarginStream.ROUNDS, start])
        if power is None:
            chosen = _likely(model, stop - start, rng)
        else:
            chosen = _alone(model, stop - start, power, rng)
        points, acts = chosen.points, chosen.acts[:, :-1]
        seen = SeenScenes(emulator, emulated_nuisances(nuisances), np.zeros(stop - start))
        found = found.joined(done.run(points, acts, seen(space.features(points, acts))[0]))
    return found


def _likely(model: OutcomeModel, count: int, rng: np.random.Generator) -> Particles:
    """Draws of the posterior."""
    drawn = sample_posterior(model, np.arange(model.overturned.size), rng).particles
    return drawn.taken(rng.choice(len(drawn), count, replace=count > len(drawn)))


def _alone(model: OutcomeModel, count: int, power: float, rng: np.random.Generator) -> Particles:
    """Draws in which one effect acts, each as it would explain the outcomes best."""
    rows, names = np.arange(model.overturned.size), model.space.names
    share = np.bincount(np.arange(count) % len(names), minlength=len(names))
    drawn = []
    for name, own in zip(rng.permutation(names).tolist(), share.tolist(), strict=True):
        if own:
            together = frozenset({name, GAIN}).intersection(model.looked_for)
            single = replace(model, allowed=together, certain=frozenset({name}))
            found = sample_posterior(
                single, rows, rng, particles=SCENES.particles, power=power
            ).particles
            drawn.append(found.taken(rng.choice(len(found), own, replace=own > len(found))))
    return joined_particles(drawn)


def _median(margins: Array) -> Array:
    """Over scenes, NaN where all simulations of a trial failed, shape (trials,)."""
    known = np.isfinite(margins).any(axis=0)
    out = np.full(known.size, np.nan)
    out[known] = np.nanmedian(margins[:, known], axis=0)
    return out


@dataclass
class _Simulating:
    """Runs scenes one after another; the number of a scene is that of its nuisances."""

    cache: SimulationCache
    space: CauseSpace
    groups: TrialGroups
    total: int
    progress: Callable[[float], None] | None
    done: int = 0

    def nuisances(self, start: int, stop: int) -> Array:
        draws = [self.cache.simulator.nuisance_draw(row + 1) for row in range(start, stop)]
        return np.stack(draws)

    def run(self, points: Array, acts: Acts, guess: Array) -> SimulatedScenes:
        """Margins of further scenes, each sought from a guess, shape (scenes, trials)."""
        start, count = self.done, len(points)
        group = np.arange(start, start + count) % len(self.groups)
        scenes = [(start + k + 1, self.space.effects(points[k], acts[k])) for k in range(count)]

        def report(share: float) -> None:
            if self.progress is not None:
                self.progress((start + share * count) / self.total)

        margins = scene_margins(
            self.cache, scenes, guess, self.groups.asked[group], progress=report
        )
        report(1.0)
        self.done += count
        nuisances = self.nuisances(start, self.done)
        return SimulatedScenes(points, acts, nuisances, margins, group, self.groups)
