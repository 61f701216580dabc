"""`vsr2.diagnose`: a campaign against the scene of a study."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import Study, load_study
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis.budget import Budget
from vsr2.diagnosis.corrected import with_correction, write_corrected
from vsr2.diagnosis.observed.features import Sampling
from vsr2.diagnosis.observed.observations import Observations, observe_campaign
from vsr2.diagnosis.pipeline import Question, Report, diagnose_with
from vsr2.diagnosis.protocol_cache import ProtocolCache
from vsr2.diagnosis.simulated.hypotheses import Hypotheses
from vsr2.diagnosis.simulated.scene_simulator import HYPOTHESES, SceneSimulator
from vsr2.diagnosis.verdict.document import FILE, Diagnosis
from vsr2.effects import check_study_effects
from vsr2.errors import DiagnosisError
from vsr2.results import refuse_other_work

if TYPE_CHECKING:
    import distributed


@checked_names(DiagnosisError)
@dataclass(frozen=True)
class Execution:
    """How a diagnosis runs, none of which changes what it finds.

    Attributes:
        threads: of the native core; None: all that this process may use.
        client: of a Dask cluster that runs the trials.
        cache: folder that diagnoses of several campaigns of the same trials share: simulate and
            train once.
        report: gets stage, share done, time left and leading effects as it goes on.
    """

    threads: int | None = None
    client: distributed.Client | None = None
    cache: ProtocolCache | None = None
    report: Report | None = None

    def __post_init__(self) -> None:
        if self.threads is not None and self.threads < 1:
            raise DiagnosisError(
                f"threads is {self.threads}; give at least 1, or leave it out for all"
            )


BUDGET, EXECUTION = Budget(), Execution()


@checked_names(DiagnosisError)
def diagnose(
    campaign: Campaign | str | PathLike[str],
    scene: Study | str | PathLike[str],
    *,
    tier: Tier | None = None,
    out: str | PathLike[str] | None = None,
    budget: Budget = BUDGET,
    hypotheses: Hypotheses = HYPOTHESES,
    execution: Execution = EXECUTION,
    seed: int = 0,
) -> Diagnosis:
    """Where the sim-to-real gap of a campaign lies, which effect causes it, how far it shrinks.

    Args:
        campaign: measured (or simulated) trials, or the folder that holds them.
        scene: the study of the nominal scene, its effects included, or its file; its own motions
            are not used.
        tier: information to use: B outcomes, M largest tilts too, T series too; None: all that the
            campaign shares.
        out: folder for `diagnosis.json` (without sentences), tables, the corrected scene,
            simulations and the posterior, which later runs of the same reuse; None: none.
        budget: wall or processor time, judging included, or numbers of simulations or of simulated
            campaigns; equal numbers of campaigns give equal verdicts.
        hypotheses: effects that may be the cause, and what is uncertain about the set-up.
        execution: threads or a cluster, a cache that several diagnoses share, who gets progress.
        seed: of everything random.

    Returns:
        The diagnosis.

    Raises:
        DiagnosisError: the campaign holds too little, or an option cannot be used.
        ResultError: `out` holds a diagnosis of another scene, campaign or seed.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
    """
    seed = checked_seed(seed, DiagnosisError)
    if budget.cpu_minutes is not None and execution.client is not None:
        raise DiagnosisError(
            "budget_cpu_minutes counts processor time of this process, and a cluster's workers are "
            "others; give wall time, simulations or campaigns"
        )
    given = (campaign if isinstance(campaign, Campaign) else load_campaign(campaign)).on_file()
    study = scene if isinstance(scene, Study) else load_study(scene)
    check_study_effects(study.effects, study.name if isinstance(scene, Study) else scene)
    seen = observe_campaign(given, tier)
    simulator = scene_simulator(seen, study, hypotheses, execution, seed)
    folder = None if out is None else _own_folder(Path(out), simulator)
    if execution.cache is not None:
        made_folder(execution.cache.folder)
    found = diagnose_with(
        simulator,
        seen.campaign,
        Question(
            seen.tier,
            simulator.excluded,
            tuple(hypotheses.references),
            seed,
            hypotheses.most_effects,
            budget.waterfall,
        ),
        cache=folder if execution.cache is None else execution.cache,
        budget=budget,
        report=execution.report,
        provenance={
            "scene": study.name,
            "scene_effects": study.effects,
            "left_out": len(given) - len(seen),
            "unavailable": {
                name: str(error.fault) for name, error in simulator.unavailable.items()
            },
            "priors": hypotheses.ends,
            "nuisance_priors": [one.to_json() for one in simulator.nuisances],
        },
    )
    found = with_correction(found, study, simulator.library)
    if folder is not None:
        found.save(folder)
        write_corrected(found, study, folder)
    return found


def _own_folder(folder: Path, simulator: SceneSimulator) -> Path:
    """The folder of a diagnosis, made where it is not there; refused where it holds another."""
    identity = ("provenance", "simulator"), simulator.identity
    refuse_other_work(made_folder(folder) / FILE, *identity, "a diagnosis")
    return folder


def scene_simulator(
    seen: Observations, study: Study, hypotheses: Hypotheses, execution: Execution, seed: int
) -> SceneSimulator:
    """Simulator of the observed trials.

    Raises:
        DiagnosisError: it leaves no effect to look for.
    """
    simulator = simulator_of(
        seen.campaign, study, hypotheses, execution, seed, series=seen.tier == "T"
    )
    if not set(simulator.library) - set(simulator.excluded):
        raise DiagnosisError("no effect is left to look for: exclude fewer")
    return simulator


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
