"""What the diagnoses of several campaigns of one protocol have in common."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vsr2.ensemble.observed.features import Sampling

SIMULATIONS = "simulations.jsonl"


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
