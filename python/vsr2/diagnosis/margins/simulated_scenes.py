"""Scenes whose margins are sought: first from the prior, then from what the outcomes leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.margins.acting_posterior import sample_posterior
from vsr2.diagnosis.margins.cause_space import Acts, CauseSpace, draw_scene
from vsr2.diagnosis.margins.margin_emulator import MarginEmulator, fit_emulator
from vsr2.diagnosis.margins.margin_search import SEARCH, scene_margins
from vsr2.diagnosis.margins.outcome_model import OutcomeModel, emulated_nuisances
from vsr2.diagnosis.observed.random_streams import MarginStream
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.errors import DiagnosisError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SceneConstants:
    """How scenes are chosen; chosen by hand.

    Attributes:
        usual: number of scenes where none is asked for: about an hour on two cores for 300 trials
            of a scanned rock.
        prior: share of the scenes that come from the prior.
        rounds: in which the others come from the posterior of the time.
        least: scenes that an emulator needs.
        known: share of the trials whose margin a scene must have to be used.
    """

    usual: int = 112
    prior: float = 4 / 7
    rounds: int = 3
    least: int = 24
    known: float = 0.5

    def ends(self, scenes: int) -> list[int]:
        """Number of scenes after the prior's, and after each round."""
        first = max(round(self.prior * scenes), min(self.least, scenes))
        steps = np.linspace(first, scenes, self.rounds + 1)
        return sorted({round(float(step)) for step in steps})


SCENES = SceneConstants()


@dataclass(frozen=True, eq=False)
class SimulatedScenes:
    """Scenes and their margins, one row each.

    Attributes:
        points: coordinates of the cause space, shape (scenes, coordinates).
        acts: which effects act, shape (scenes, effects).
        nuisances: standardised, shape (scenes, q).
        margins: NaN where a simulation failed, shape (scenes, trials).
    """

    points: Array
    acts: Acts
    nuisances: Array
    margins: Array

    def __len__(self) -> int:
        return len(self.points)

    def joined(self, other: SimulatedScenes) -> SimulatedScenes:
        """These and others."""
        return SimulatedScenes(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.acts, other.acts]),
            np.concatenate([self.nuisances, other.nuisances]),
            np.concatenate([self.margins, other.margins]),
        )

    def known(self) -> SimulatedScenes:
        """Those in which enough of the trials have a margin (`SceneConstants.known`)."""
        kept = np.isfinite(self.margins).mean(axis=1) >= SCENES.known
        return SimulatedScenes(
            self.points[kept], self.acts[kept], self.nuisances[kept], self.margins[kept]
        )

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
        return fit_emulator(np.hstack([features, emulated_nuisances(self.nuisances)]), self.margins)


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
    """Margins of scenes of the prior, then of scenes in which the outcomes are likely.

    An emulator is needed where the posterior lies, and there alone: the posterior of what is known
    says where to simulate next (history matching; I. Vernon, M. Goldstein, R. G. Bower, "Galaxy
    formation: a Bayesian uncertainty analysis", Bayesian Analysis 5, 2010).

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
    ends = SCENES.ends(count)
    pilot = min(SEARCH.pilot, ends[0])
    done = _Simulating(cache, space, count, progress)
    first = [draw_scene(space, row, seed) for row in range(ends[0])]
    points = np.stack([point for point, _ in first])
    acts = np.stack([acting for _, acting in first])
    found = done.run(points[:pilot], acts[:pilot], np.zeros((pilot, overturned.size)))
    guess = _median(found.margins)
    rest = ends[0] - pilot
    if rest:
        found = found.joined(done.run(points[pilot:], acts[pilot:], np.tile(guess, (rest, 1))))
    for start, stop in pairwise(ends):
        rng = np.random.default_rng([seed, MarginStream.ROUNDS, start])
        emulator = found.known().emulator(space)
        nuisances = found.nuisances.shape[1]
        model = OutcomeModel(space, emulator, overturned, motions, nuisances, allowed)
        drawn = sample_posterior(model, np.arange(overturned.size), rng).particles
        few = stop - start > len(drawn)
        drawn = drawn.taken(rng.choice(len(drawn), stop - start, replace=few))
        expected = model.emulator(
            np.hstack(
                [
                    space.features(drawn.points, drawn.acts[:, :-1]),
                    emulated_nuisances(done.nuisances(start, stop)),
                ]
            )
        )[0]
        found = found.joined(done.run(drawn.points, drawn.acts[:, :-1], expected))
    return found


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
    total: int
    progress: Callable[[float], None] | None
    done: int = 0

    def nuisances(self, start: int, stop: int) -> Array:
        draws = [self.cache.simulator.nuisance_draw(row + 1) for row in range(start, stop)]
        return np.stack(draws)

    def run(self, points: Array, acts: Acts, guess: Array) -> SimulatedScenes:
        """Margins of further scenes, each sought from a guess, shape (scenes, trials)."""
        start, count = self.done, len(points)
        scenes = [(start + k + 1, self.space.effects(points[k], acts[k])) for k in range(count)]

        def report(share: float) -> None:
            if self.progress is not None:
                self.progress((start + share * count) / self.total)

        margins = scene_margins(self.cache, scenes, guess, progress=report)
        report(1.0)
        self.done += count
        return SimulatedScenes(points, acts, self.nuisances(start, self.done), margins)
