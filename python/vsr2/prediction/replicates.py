"""Replicates of a campaign in a scene: outcomes, and the margins at which they overturn.

A replicate draws the nuisances of a set-up, a contact model, placement and motion noise as a
simulated campaign of the diagnosis does. The first replicates are those of its `before`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.analysis.baseline import LOGISTIC
from vsr2.analysis.overturning_margin import seek_margins
from vsr2.campaign import Campaign
from vsr2.config import Study
from vsr2.ensemble.execution import Execution, Stage, simulator_of
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.library import GAIN
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request
from vsr2.results import refuse_other_work

Array = NDArray[np.float64]
PROVENANCE = "provenance.json"


@dataclass(frozen=True)
class PredictionConstants:
    """How trials are predicted; chosen by hand.

    Attributes:
        replicates: of each trial by default.
        chunk: simulations between two writes.
        folds: of the logistic curve and of margins, where there are as many motions.
        reach: greatest size of a margin: a motion is scaled from 1 / e to e times itself.
        halvings: of that range.
    """

    replicates: int = 16
    chunk: int = 128
    folds: int = LOGISTIC.folds
    reach: float = 1.0
    halvings: int = 6


PREDICTION = PredictionConstants()


@dataclass(eq=False)
class Replicates:
    """Replicates of a campaign under scenes that take turns.

    One scene's simulator is held at a time: each has the motions of all trials.

    Attributes:
        campaign: trials with a motion.
        scenes: that replicates take in turn.
        hypotheses: of which nuisances and contact models are drawn.
        execution: threads or a cluster, cache, progress.
        seed: of all draws.
        identities: of the simulators that gave outcomes.
    """

    campaign: Campaign
    scenes: Sequence[Study]
    hypotheses: Hypotheses
    execution: Execution
    seed: int
    identities: list[str] = field(default_factory=list)

    def _simulator(self, campaign: Campaign, study: Study) -> SceneSimulator:
        return simulator_of(campaign, study, self.hypotheses, self.execution, self.seed)

    def check(self) -> None:
        """Refuse a scene that cannot be built or have its effects, before any is simulated."""
        if len(self.scenes) > 1:
            first = self.campaign.select([self.campaign.trials[0].trial])
            for study in self.scenes:
                self._simulator(first, study)

    def outcomes(self, replicates: int, folder: Path | None) -> Array:
        """1, 0 or NaN, shape (replicates, trials)."""
        out = np.full((replicates, len(self.campaign)), np.nan)
        done = 0

        def progress(n: int, m: int) -> None:
            self.execution.notify(Stage.SIMULATION, (done + n) / out.size)

        for k, study in enumerate(self.scenes):
            rows = range(k, replicates, len(self.scenes))
            simulator = self._simulator(self.campaign, study)
            self.identities.append(simulator.identity)
            if folder is not None:
                identity = ("simulators", k), simulator.identity
                refuse_other_work(folder / PROVENANCE, *identity, "a prediction")
            requests = [Request(i, (), row + 1, 1) for row in rows for i in range(out.shape[1])]
            path = self.execution.simulations(folder)
            with SimulationCache(simulator, path, chunk=PREDICTION.chunk) as store:
                found = store.run(requests, progress=progress)
            out[rows] = found.overturned.reshape(len(rows), -1)
            done += len(requests)
        return out

    def margins(self, outcomes: Array, folder: Path | None) -> Array:
        """Logarithms of the factors at which replicates overturn, by bisection; NaN: one failed.

        Args:
            outcomes: of the motions as they are, where bisection begins, shape (replicates,
                trials).
            folder: of simulations.
        """
        out = np.full(outcomes.shape, np.nan)
        for k, study in enumerate(self.scenes):
            rows = np.arange(k, len(outcomes), len(self.scenes))
            simulator = self._simulator(self.campaign, study)
            path = self.execution.simulations(folder)
            with SimulationCache(simulator, path, chunk=PREDICTION.chunk) as store:
                out[rows] = self._sought(store, rows, outcomes[rows], k)
        return out

    def _sought(
        self, store: SimulationCache, rows: NDArray[np.int64], outcomes: Array, k: int
    ) -> Array:
        """Margins of the replicates in the k-th scene, shape (rows, trials)."""
        halving = 0

        def overturns(logs: Array) -> Array:
            nonlocal halving
            ends = self._scaled(store, rows, logs) if halving else outcomes
            halving += 1
            done = (k + halving / PREDICTION.halvings) / len(self.scenes)
            self.execution.notify(Stage.MARGINS, done)
            return ends

        reach = PREDICTION.reach
        return seek_margins(overturns, outcomes.shape, (-reach, reach), PREDICTION.halvings)

    @staticmethod
    def _scaled(store: SimulationCache, rows: NDArray[np.int64], logs: Array) -> Array:
        """1, 0 or NaN of replicates under scaled motions, shape (rows, trials)."""
        requests = [
            Request(i, ((GAIN, (float(np.expm1(log)),)),), int(row) + 1, 1)
            for row, scaled in zip(rows, logs, strict=True)
            for i, log in enumerate(scaled)
        ]
        return np.asarray(store.run(requests).overturned.reshape(logs.shape))
