"""`vsr2.diagnose`: a campaign against the scene of a study."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from vsr2.argument_names import checked_names
from vsr2.campaign import Campaign, Tier, load_campaign
from vsr2.config import Study, load_study
from vsr2.config.seeds import checked_seed
from vsr2.diagnosis.budget import SCHEDULE, Budget, Stopwatch
from vsr2.diagnosis.corrected import with_correction, write_corrected, write_scenes
from vsr2.diagnosis.pipeline import Question, diagnose_with
from vsr2.diagnosis.verdict.document import FILE, Diagnosis
from vsr2.effects import check_study_effects
from vsr2.ensemble.execution import EXECUTION, Execution, made_folder, simulator_of
from vsr2.ensemble.observed.observations import Observations, observe_campaign, outcomes_hash
from vsr2.ensemble.simulated.hypotheses import Hypotheses
from vsr2.ensemble.simulated.scene_simulator import HYPOTHESES, SceneSimulator
from vsr2.errors import DiagnosisError
from vsr2.results import refuse_other_work

BUDGET = Budget()


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
        ResultError: `out` holds a diagnosis of another scene, campaign, tier, prior or seed.
        CampaignError, ConfigError, GeometryError, MotionError, SimulationError: campaign or scene
            cannot be used.
    """
    watch, seed = Stopwatch(), checked_seed(seed, DiagnosisError)
    given = (campaign if isinstance(campaign, Campaign) else load_campaign(campaign)).on_file()
    study = scene if isinstance(scene, Study) else load_study(scene)
    check_study_effects(study.effects, study.name if isinstance(scene, Study) else scene)
    seen = observe_campaign(given, tier)
    simulator = scene_simulator(seen, study, hypotheses, execution, seed)
    _check_budget(budget, simulator, execution, len(seen))
    folder = None if out is None else _own_folder(Path(out), simulator, seen, hypotheses)
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
            **execution.notes,
            "scene": study.name,
            "outcomes": outcomes_hash(seen.overturned, seen.features),
            "scene_effects": study.effects,
            "left_out": len(given) - len(seen),
            "unavailable": {
                name: str(error.fault) for name, error in simulator.unavailable.items()
            },
            "priors": hypotheses.ends,
            "nuisance_priors": [one.to_json() for one in simulator.nuisances],
        },
        watch=watch,
    )
    found = with_correction(found, study, simulator.library)
    if folder is not None:
        found.save(folder)
        write_corrected(found, study, folder)
        write_scenes([], folder)
    return found


def _check_budget(
    budget: Budget, simulator: SceneSimulator, execution: Execution, trials: int
) -> None:
    """Refuse a budget that this work cannot have."""
    # The least number may be asked for of any campaign: all trials of a shorter one are meant.
    if budget.trials is not None and budget.trials > max(trials, SCHEDULE.least_trials):
        raise DiagnosisError(
            f"campaign_trials is {budget.trials}; the campaign has {trials} trials: give at most "
            "so many, or leave it out for all"
        )
    if budget.cpu_minutes is not None and execution.client is not None:
        raise DiagnosisError(
            "budget_cpu_minutes counts processor time of this process, and a cluster's workers are "
            "others; give wall time, simulations or campaigns"
        )
    if budget.simulator not in ("", simulator.identity):
        raise DiagnosisError(
            "like: that diagnosis is of another scene, schedule of trials, tier, tolerance or "
            "seed; ask as it did, or give a budget"
        )


def _own_folder(
    folder: Path, simulator: SceneSimulator, seen: Observations, hypotheses: Hypotheses
) -> Path:
    """The folder of a diagnosis, made where it is not there; refused where it holds another."""
    file = made_folder(folder) / FILE
    for key, value in (
        ("simulator", simulator.identity),
        ("outcomes", outcomes_hash(seen.overturned, seen.features)),
        ("priors", hypotheses.ends),
    ):
        refuse_other_work(file, ("provenance", key), value, "a diagnosis")
    return folder


def scene_simulator(
    seen: Observations, study: Study, hypotheses: Hypotheses, execution: Execution, seed: int
) -> SceneSimulator:
    """Simulator of the observed trials.

    Raises:
        DiagnosisError: it leaves no effect to look for.
    """
    simulator = simulator_of(
        seen.campaign, study, hypotheses, execution, seed, series=seen.reads_series
    )
    if not set(simulator.library) - set(simulator.excluded):
        raise DiagnosisError("no effect is left to look for: exclude fewer")
    return simulator
