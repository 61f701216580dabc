"""`vsr2 campaign`: import, check, describe and simulate campaigns of trials."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from vsr2.campaign import Campaign, MeasurementNoise
from vsr2.campaign.series import MAX_NOISE
from vsr2.cli import options as opt
from vsr2.cli.chosen_step import with_time_step
from vsr2.errors import CampaignError, ConfigError

if TYPE_CHECKING:
    from vsr2.config import Study

verbs = App(name="campaign")
Destination = Annotated[Path, Parameter(help="folder for the campaign")]


@verbs.command
def import_lab(
    source: Path,
    /,
    *,
    out: Destination,
    specimen: str = "SP1",
    overwrite: opt.Overwrite = False,
    quiet: opt.Quiet = False,
) -> int:
    """Bring the published laboratory campaign into the form.

    SOURCE holds trials.csv and the table's motions, packed (motions/TestNNN.npz) or as the
    laboratory's text files (TestNNN.txt, beside it or in raw/).

    Args:
        source: folder of the laboratory's files
        specimen: `SP1` or `SP2`, whose outcomes may be missing
    """
    from vsr2.campaign import campaign_summary
    from vsr2.campaign import import_lab as bring
    from vsr2.report.messages.data import campaign_text
    from vsr2.report.messages.written import wrote

    made = bring(source, out, specimen=specimen, overwrite=overwrite)
    if not quiet:
        print(campaign_text(campaign_summary(made)))
        print(wrote(out))
    return 0


@verbs.command
def check(folder: opt.Campaign, /) -> int:
    """List all that is wrong with a campaign's files.

    Names file, row, column and remedy of each problem. Exit code 0: none; 2: some.
    """
    from vsr2.campaign import check_campaign
    from vsr2.report.messages.data import campaign_checked

    problems = check_campaign(folder)
    for problem in problems:
        print(problem if problem.file else f"{folder}: {problem}")
    print(campaign_checked(folder, len(problems)))
    return 2 if problems else 0


@verbs.command
def info(
    folder: opt.Campaign,
    /,
    *,
    baselines: bool = False,
    folds: opt.Integer = 10,
    seed: opt.Integer = 0,
    json: opt.Json = False,
) -> int:
    """What a campaign holds.

    Args:
        baselines: also score the no-physics logistic curve and the campaign's own predictions
        folds: of the logistic curve
        seed: of folds and bootstrap
    """
    from vsr2.analysis.baseline import baseline_scores
    from vsr2.campaign import campaign_summary, load_campaign
    from vsr2.report.messages.commands import baseline_table
    from vsr2.report.messages.data import campaign_text

    campaign = load_campaign(folder)
    scores = baseline_scores(campaign, folds=folds, seed=seed) if baselines else []
    summary = campaign_summary(campaign)
    if json:
        if baselines:
            summary["baselines"] = [
                {
                    "name": score.name,
                    "fitted": score.fitted,
                    "trials": score.metrics.trials,
                    "scores": score.intervals,
                }
                for score in scores
            ]
        opt.print_json(summary)
        return 0
    print(campaign_text(summary))
    if baselines:
        print()
        print(baseline_table(scores))
    return 0


@verbs.command
def compare(
    scene: Path,
    folder: opt.Campaign,
    /,
    *,
    nuisance: opt.Nuisances = (),
    seed: opt.Integer = 0,
    threads: opt.Threads = None,
    set: opt.Settings = (),
    json: opt.Json = False,
) -> int:
    """Check a nominal scene by a reference campaign.

    A reference campaign has no effect, or the ones that the scene's study names. Prints by how much
    outcomes, largest tilts and final turns differ from the scene's simulations, and by how much
    these differ among themselves. Exit code 0: no more than these; 1: more. JSON has these under
    `measures`, and under `constants` the chosen numbers that they rest on.

    Args:
        scene: study of the nominal scene
        seed: of the draws
    """
    from vsr2.campaign import load_campaign
    from vsr2.ensemble import Hypotheses, campaign_step_trials
    from vsr2.ensemble.reference_campaign import compare_reference, reference_constants
    from vsr2.report.messages.commands import reference_table

    campaign, running = load_campaign(folder), opt.StudyRun(threads=threads)
    steps = campaign_step_trials(campaign)
    study, notes = with_time_step(opt.scene(scene, set), steps, "campaign compare", running)
    found = compare_reference(
        campaign,
        study,
        hypotheses=Hypotheses(nuisances=opt.nuisances(nuisance)),
        threads=threads,
        seed=seed,
    )
    if json:
        opt.print_json({**notes, "constants": reference_constants(), "measures": found})
    else:
        print(reference_table(found))
    return int(any(one.differs for one in found))


@Parameter(name="*")
@dataclass(frozen=True)
class Resimulating:
    """How trials of a campaign are simulated again, and where that is kept.

    Attributes:
        out: folder for results and simulations (default: nothing is written)
        seed: of all draws
        cache: folder of simulations that other commands on the campaign share
    """

    out: Path | None = None
    nuisance: opt.Nuisances = ()
    seed: opt.Integer = 0
    cache: Path | None = None
    overwrite: opt.Overwrite = False
    resume: opt.Resume = False
    threads: opt.Threads = None
    scheduler: opt.Scheduler = None
    set: opt.Settings = ()
    json: opt.Json = False
    quiet: opt.Quiet = False


@Parameter(name="*")
@dataclass(frozen=True)
class Predicting(Resimulating):
    """How trials are predicted.

    Attributes:
        replicates: simulations of each trial (default: 16, or one for each scene)
        margins: seek the factor on the motion at which each replicate overturns, in six times the
            simulations; outcomes of other motions then give bias and scatter
    """

    replicates: opt.Integer | None = None
    margins: bool = False


PREDICTING = Predicting()


@verbs.command
def predict(scene: Path, folder: opt.Campaign, /, *, options: Predicting = PREDICTING) -> int:
    """Probability that each trial of a campaign overturns.

    Simulates every trial with a motion in replicates, which draw placement, motion noise, contact
    model and what else is uncertain of a set-up. Prints scores and a calibration curve where
    outcomes are known. docs/how-to/campaign.md explains.

    Args:
        scene: study of the scene, or a folder of studies: draws of a posterior, which replicates
            take in turn
    """
    import numpy as np

    from vsr2.campaign import load_campaign
    from vsr2.ensemble import Hypotheses, campaign_step_trials
    from vsr2.prediction import predict as predicted
    from vsr2.prediction.prediction import WORK_FILES
    from vsr2.report.messages.commands import prediction_table
    from vsr2.report.messages.written import wrote

    campaign = load_campaign(folder)
    if scene.is_dir() and options.set:
        raise CampaignError(f"--set: changes one study, and {scene} is a folder; give one study")
    study = None if scene.is_dir() else opt.scene(scene, options.set)
    if options.out is not None:
        opt.work_folder(options.out, WORK_FILES, "a prediction", options)
    notes: dict[str, Any] = {}
    if study is not None:
        steps = campaign_step_trials(campaign)
        study, notes = with_time_step(study, steps, "campaign predict", options)
    with opt.cluster(options.scheduler, options.threads) as client:
        found = predicted(
            campaign,
            scene if study is None else study,
            out=options.out,
            replicates=options.replicates,
            margins=options.margins,
            hypotheses=Hypotheses(nuisances=opt.nuisances(options.nuisance)),
            execution=opt.execution(options, client, "campaign predict", notes),
            seed=options.seed,
        )
    if options.json:
        p = found.probability.tolist()
        opt.print_json({"scores": found.scores, "curve": found.curve, "probability": p})
    elif not options.quiet:
        print(prediction_table(found))
        if options.out is not None:
            print(wrote(options.out))
    return int(bool(np.isnan(found.outcomes).all(axis=0).any()))


@Parameter(name="*")
@dataclass(frozen=True)
class Attributing(Resimulating):
    """How causes are sought.

    Attributes:
        scenes: whose margins are sought (default: 800)
        posterior_draws: write so many scenes with a draw of the posterior each, too; needs --out
        one_contact_model: keep the contact model of the study in all scenes, in place of drawing
            another correct one for each
    """

    scenes: opt.Integer | None = None
    posterior_draws: opt.Integer = 0
    exclude: opt.Excluded = ()
    prior: opt.Priors = ()
    one_contact_model: bool = False


ATTRIBUTING = Attributing()


@verbs.command
def causes(scene: Path, folder: opt.Campaign, /, *, options: Attributing = ATTRIBUTING) -> int:
    """Effects that act together in a campaign, by how strong motions must be to overturn the rock.

    Draws scenes in which any effects of the library act, and seeks the factor on the motion at
    which trials overturn. Outcomes then say which effects act, several at once, and how
    strongly. Each is judged on motions that it was not inferred from. docs/how-to/campaign.md
    explains.

    Args:
        scene: study of the scene
    """
    from vsr2.campaign import load_campaign
    from vsr2.causes import find_causes
    from vsr2.causes.causes import FILES
    from vsr2.ensemble import Hypotheses, campaign_step_trials
    from vsr2.ensemble.simulated.contact_family import CONTACT_FAMILY
    from vsr2.report.causes_figure import write_causes_figure
    from vsr2.report.messages.commands import few_draws
    from vsr2.report.messages.found_causes import causes_text
    from vsr2.report.messages.written import wrote

    if options.posterior_draws and options.out is None:
        raise ConfigError("--posterior-draws: are written to a folder; add --out, or leave it out")
    campaign = load_campaign(folder)
    study = opt.scene(scene, options.set)
    if options.out is not None:
        opt.work_folder(options.out, FILES, "a search for causes", options)
    steps = campaign_step_trials(campaign)
    study, notes = with_time_step(study, steps, "campaign causes", options)
    with opt.cluster(options.scheduler, options.threads) as client:
        found = find_causes(
            campaign,
            study,
            out=options.out,
            scenes=options.scenes,
            hypotheses=Hypotheses(
                exclude=options.exclude,
                priors=opt.priors(options.prior, options.exclude),
                nuisances=opt.nuisances(options.nuisance),
                contact_family=() if options.one_contact_model else CONTACT_FAMILY,
            ),
            posterior_draws=options.posterior_draws,
            execution=opt.execution(options, client, "campaign causes", notes),
            seed=options.seed,
        )
    if options.out is not None:
        write_causes_figure(found, options.out)
    if options.json:
        opt.print_json(found.content)
    elif not options.quiet:
        print(causes_text(found))
        if options.out is not None:
            print(wrote(options.out))
            if len(found.drawn) < options.posterior_draws:
                print(few_draws(options.out, len(found.drawn), options.posterior_draws))
    return 0


@Parameter(name="*")
@dataclass(frozen=True)
class Simulating:
    """How a campaign is simulated.

    Attributes:
        name: of the campaign (default: the study's)
        series_every: keep a row of the series every so many time steps; 0: no series
        session_size: trials a session (default: one session)
        seed: of the noise
    """

    name: str | None = None
    series_every: opt.Integer = 0
    session_size: opt.Integer | None = None
    seed: opt.Integer = 0
    threads: opt.Threads = None
    scheduler: opt.Scheduler = None
    set: opt.Settings = ()
    overwrite: opt.Overwrite = False
    resume: opt.Resume = False
    quiet: opt.Quiet = False


SIMULATING = Simulating()


class NoiseOptions(MeasurementNoise):
    """Measurement noise that options state, which errors name."""

    def __post_init__(self) -> None:
        for channel, value in vars(self).items():
            if value is not None and not 0 <= value <= MAX_NOISE:
                raise CampaignError(
                    f"--noise-{channel.replace('_', '-')} {value:g}: give a standard error from 0 "
                    f"to {MAX_NOISE:g}"
                )


NO_NOISE = NoiseOptions()
Noise = Annotated[
    NoiseOptions,
    Parameter(
        name="*",
        name_transform=lambda name: f"noise-{name.replace('_', '-')}",
        group="Standard errors of what is measured (default: none)",
    ),
]


@verbs.command
def simulate(
    study: opt.Study,
    /,
    *,
    out: Destination,
    options: Simulating = SIMULATING,
    noise: Noise = NO_NOISE,
) -> int:
    """Make a campaign out of a study.

    Runs the study's trials and writes what an experimenter would have measured: outcomes, largest
    tilts, the table's motions, and series on request, each with noise on request. Until it ends,
    what is finished is kept in OUT.checkpoint.
    """
    from vsr2.campaign import campaign_summary, save_campaign
    from vsr2.campaign.save import prepare_destination
    from vsr2.report.messages.commands import finished_before
    from vsr2.report.messages.data import campaign_text
    from vsr2.report.messages.written import wrote
    from vsr2.results import remove_result
    from vsr2.simulation import study_trials

    if options.session_size is not None and options.session_size < 1:
        raise CampaignError(
            f"--session-size {options.session_size}: give 1 or more trials a session"
        )
    loaded = opt.scene(study, options.set)
    replace = options.overwrite or options.resume
    prepare_destination(out, overwrite=replace)
    checkpoint = out.with_name(f"{out.name}.checkpoint")
    loaded, notes = with_time_step(loaded, study_trials, "campaign simulate", options)
    made = _made_before(out, checkpoint, options)
    campaign = _simulated(loaded, made, checkpoint, options, noise)
    if made is not None and options.name in (None, made.name):
        # Its files may have been edited since.
        if not options.quiet:
            print(finished_before(out, len(made)))
        return _code(made)
    campaign = dataclasses.replace(
        campaign,
        name=options.name or campaign.name,
        provenance={**campaign.provenance, **notes},
    )
    save_campaign(campaign, out, overwrite=replace)
    interrupted = bool(campaign.provenance.get("interrupted"))
    if not interrupted:
        remove_result(checkpoint)
    if not options.quiet:
        print(campaign_text(campaign_summary(campaign)))
        print(wrote(out))
    return 130 if interrupted else _code(campaign)


def _code(campaign: Campaign) -> int:
    """Exit code of a simulated campaign."""
    from vsr2.campaign import trial_statuses
    from vsr2.results import Status

    return 0 if set(trial_statuses(campaign).values()) <= {Status.ok} else 1


def _made_before(dest: Path, checkpoint: Path, options: Simulating) -> Campaign | None:
    """The finished campaign that `--resume` finds; None: there is something to simulate."""
    from vsr2.campaign import load_campaign
    from vsr2.results import has_journal, prepare_folder

    unfinished = has_journal(checkpoint)
    if unfinished and not (options.resume or options.overwrite):
        raise CampaignError(
            f"{checkpoint}: keeps an unfinished simulation; go on with --resume, or begin again "
            "with --overwrite"
        )
    made = None
    if options.resume and not unfinished and (dest / "campaign.yaml").exists():
        made = load_campaign(dest)
    if made is not None and made.provenance.get("interrupted"):
        made = None  # without its checkpoint nothing of it can be kept
    if made is None:
        prepare_folder(checkpoint, overwrite=options.overwrite, resume=options.resume)
    return made


def _simulated(
    study: Study,
    made: Campaign | None,
    checkpoint: Path,
    options: Simulating,
    noise: MeasurementNoise,
) -> Campaign:
    from vsr2.campaign import RunOptions, simulate_campaign

    with opt.cluster(options.scheduler, options.threads) as client:
        return simulate_campaign(
            study,
            sessions=options.session_size,
            noise=MeasurementNoise(**dataclasses.asdict(noise)),
            seed=options.seed,
            series_every=options.series_every,
            run=RunOptions(
                threads=options.threads,
                progress=not options.quiet,
                checkpoint=checkpoint if made is None else None,
                client=client,
                made=made,
            ),
        )
