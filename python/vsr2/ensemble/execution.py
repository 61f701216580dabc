"""How a campaign is simulated, whatever is asked of it: threads, cluster, cache, progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, Tier
from vsr2.config import Study
from vsr2.ensemble.observed.features import Sampling
from vsr2.ensemble.protocol_cache import SIMULATIONS, ProtocolCache
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.errors import DiagnosisError
from vsr2.one_line import OnlyGiven

if TYPE_CHECKING:
    import distributed


class Stage(StrEnum):
    """What the work on a campaign is at; `vsr2.report.messages.progress_lines` words it."""

    LOOK = "look"
    SIMULATION = "simulation"
    TRAINING = "training"
    JUDGEMENT = "judgement"
    WATERFALL = "waterfall"
    MARGINS = "margins"
    TIME_STEP = "time_step"
    INFERENCE = "inference"
    PLANTED = "planted"


class Turn(NamedTuple):
    """Which of several diagnoses is under way.

    Attributes:
        number: from 1.
        of: as many in all.
        campaign: its id.
        tier: information that it uses.
    """

    number: int
    of: int
    campaign: str
    tier: Tier


@dataclass(frozen=True)
class Progress:
    """How far the work on a campaign is.

    Attributes:
        stage: what it is at.
        share: done of that.
        left_s: time left to its end; NaN: not known [s].
        leading: probabilities of what leads, so far.
        turn: of a diagnosis among several; None: it is alone.
    """

    stage: Stage
    share: float
    left_s: float = np.nan
    leading: Mapping[str, float] = field(default_factory=dict)
    turn: Turn | None = None


Report = Callable[[Progress], None]


@checked_names(DiagnosisError)
@dataclass(frozen=True, repr=False)
class Execution(OnlyGiven):
    """How work on a campaign runs, none of which changes what it finds.

    Attributes:
        threads: of the native core; None: all that this process may use.
        client: of a Dask cluster that runs the trials.
        cache: folder that diagnoses of several campaigns of the same trials share: simulate and
            train once.
        report: gets stage, share done, time left and leading effects as it goes on.
        notes: for the provenance of what is found, such as how its time step was chosen.
    """

    threads: int | None = None
    client: distributed.Client | None = None
    cache: ProtocolCache | None = None
    report: Report | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.threads is not None and self.threads < 1:
            raise DiagnosisError(
                f"threads is {self.threads}; give at least 1, or leave it out for all"
            )

    def notify(self, stage: Stage, share: float) -> None:
        """Report progress, where somebody gets it."""
        if self.report is not None:
            self.report(Progress(stage, share))

    def simulations(self, folder: Path | None) -> Path | None:
        """File of simulations: of the cache, or in the folder of results; None: in memory.

        Raises:
            DiagnosisError: the cache's folder cannot be used.
        """
        if self.cache is not None:
            made_folder(self.cache.folder)
            return self.cache.simulations
        return None if folder is None else folder / SIMULATIONS


EXECUTION = Execution()


def simulator_of(
    campaign: Campaign,
    study: Study,
    hypotheses: Hypotheses,
    execution: Execution,
    seed: int,
    *,
    series: bool = False,
) -> SceneSimulator:
    """Simulator of a campaign's trials; `series`: with those of the tilt, though no cache asks."""
    cache = execution.cache
    if cache is not None and (series or cache.series):
        series_of: bool | Sampling = cache.sampling or True
    else:
        series_of = series
    return SceneSimulator(
        campaign,
        study,
        hypotheses=hypotheses,
        series=series_of,
        threads=execution.threads,
        client=execution.client,
        seed=seed,
    )


def made_folder(folder: Path) -> Path:
    """A folder for results, made where it is not there.

    Raises:
        DiagnosisError: it cannot be used.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiagnosisError(
            f"{folder}: cannot be used ({error.strerror}); choose another folder"
        ) from error
    return folder
