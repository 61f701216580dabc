"""What the diagnoses of several campaigns of one protocol have in common."""

from __future__ import annotations

import hashlib
from dataclasses import astuple, dataclass
from pathlib import Path

from vsr2.diagnosis.observed.features import Sampling
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.posterior.calibration import CALIBRATED
from vsr2.diagnosis.posterior.discrepancy import DISCREPANCY
from vsr2.diagnosis.posterior.goodness_of_fit import LIBRARY_FIT
from vsr2.diagnosis.posterior.naming import NAMING
from vsr2.diagnosis.posterior.network import NETWORK
from vsr2.diagnosis.posterior.parameters import PARAMETERS
from vsr2.diagnosis.posterior.summaries import SUMMARY
from vsr2.diagnosis.posterior.training import TRAINING
from vsr2.diagnosis.posterior.truth import PRIOR
from vsr2.diagnosis.simulated.campaigns import SET_PRIOR
from vsr2.diagnosis.simulated.hypotheses import HYPOTHESIS

SIMULATIONS, POSTERIORS = "simulations.jsonl", "posterior-*.npz"


@dataclass(frozen=True)
class ProtocolCache:
    """A folder of simulations and trained posteriors.

    Campaigns of one protocol have the same trials: motions, order, sessions. What is simulated and
    trained for one serves all; the second diagnosis takes seconds.

    Attributes:
        folder: of both.
        series: simulate series too, also for diagnoses that do not use them, so that those that do
            find their simulations.
        sampling: of series, where a campaign comes without them.
    """

    folder: Path
    series: bool = False
    sampling: Sampling | None = None

    @property
    def simulations(self) -> Path:
        """File of simulations."""
        return self.folder / SIMULATIONS

    def posterior(
        self,
        identity: str,
        seen: Observations,
        campaigns: int,
        seed: int,
        most: int = HYPOTHESIS.usual_effects,
    ) -> Path:
        """File of the posterior trained for a simulator and what a campaign measures.

        Args:
            identity: of the simulator.
            seen: the observed campaign, whose outcomes have no part in it.
            campaigns: simulated.
            seed: of the training.
            most: effects that may act together.
        """
        digest = hashlib.blake2b(digest_size=8)
        constants = (
            SUMMARY, DISCREPANCY, NETWORK, PRIOR, TRAINING, LIBRARY_FIT, NAMING, CALIBRATED,
            PARAMETERS, SET_PRIOR,
        )  # fmt: skip
        parts = (
            identity, seen.tier, [feature.name for feature in seen.measured], seen.tilt_offset,
            seen.tilt_noise, seen.rest_noise, campaigns, seed, most,
            [astuple(one) for one in constants],
        )  # fmt: skip
        digest.update(repr(parts).encode())
        return self.folder / POSTERIORS.replace("*", digest.hexdigest())
