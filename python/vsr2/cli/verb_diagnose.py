"""`vsr2 diagnose`: where a campaign's sim-to-real gap lies, its cause, and how far it shrinks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from vsr2.cli import options as opt
from vsr2.cli.chosen_step import with_time_step
from vsr2.cli.exclusive_options import one_of
from vsr2.codes import Tier
from vsr2.errors import ConfigError

if TYPE_CHECKING:
    from vsr2.config import Study
    from vsr2.diagnosis import Budget, Diagnosis
    from vsr2.ensemble import Hypotheses

BUDGET = Group("Budget (one of)", validator=one_of)


@Parameter(name="*")
@dataclass(frozen=True)
class QuestionOptions:
    """What may be the cause, and what it is judged by.

    Attributes:
        tier: information to use (default: all there is, or that of --like)
        reference: folder of a campaign of the same trials that is known to have no effect, not one
            of a known effect (may be repeated)
        most_effects: so many effects may act together, 1 to 4; more need more simulated campaigns
        seed: of everything random
    """

    tier: Tier | None = None
    exclude: opt.Excluded = ()
    prior: opt.Priors = ()
    nuisance: opt.Nuisances = ()
    reference: tuple[Path, ...] = ()
    most_effects: opt.Integer = 2
    seed: opt.Integer = 0


@Parameter(name="*")
@dataclass(frozen=True)
class Effort:
    """How much is simulated, and where.

    Attributes:
        budget_minutes: wall time, training and judging included
        budget_cpu_minutes: processor time of all threads together in place of wall time
        simulations: so many at most instead of a time; more where the trials need more
        campaigns: so many simulated campaigns, 150 at least, whatever they cost: equal numbers give
            equal verdicts, and campaigns of one set-up share them; 48 without effect, which tell
            what chance does, are used besides
        like: do what the finished diagnosis in this folder did: with its --cache, another campaign
            of the same scene and trials takes seconds
        campaign_trials: so many trials of each simulated campaign, 40 at least (default: all with
            --campaigns, else as many as leave time for 60 campaigns of each effect)
        no_how_far: do not simulate again what is named, to say how far the gap shrinks; not with
            --waterfall
        waterfall: judge each of the likeliest causes, on motions that neither fit nor choice saw
        cache: folder of simulations and trained posteriors that campaigns of one set-up share
            (default: the output folder)
        posterior_draws: write so many scenes with a draw of the posterior each, too
        iterate: diagnose the corrected scene again until nothing is named, each round in a folder
            of its own
        most_rounds: of --iterate, four by default
        check: instead of diagnosing, plant so many campaigns, 200 say, and count how often the
            posterior of the finished diagnosis in --out holds their truth; give the options of that
            diagnosis
    """

    budget_minutes: Annotated[float, Parameter(group=BUDGET)] = 10.0
    budget_cpu_minutes: Annotated[float | None, Parameter(group=BUDGET)] = None
    simulations: Annotated[opt.Integer | None, Parameter(group=BUDGET)] = None
    campaigns: Annotated[opt.Integer | None, Parameter(group=BUDGET)] = None
    like: Annotated[Path | None, Parameter(group=BUDGET)] = None
    campaign_trials: opt.Integer | None = None
    no_how_far: bool = False
    waterfall: bool = False
    cache: Path | None = None
    overwrite: opt.Overwrite = False
    resume: opt.Resume = False
    threads: opt.Threads = None
    scheduler: opt.Scheduler = None
    set: opt.Settings = ()
    posterior_draws: opt.Integer = 0
    iterate: bool = False
    most_rounds: opt.Integer | None = None
    check: opt.Integer | None = None
    quiet: opt.Quiet = False


QUESTION, EFFORT = QuestionOptions(), Effort()


def diagnose(
    campaign: opt.Campaign,
    /,
    *,
    scene: Path,
    out: Path,
    question: QuestionOptions = QUESTION,
    effort: Effort = EFFORT,
) -> int:
    """Find the cause of a campaign's sim-to-real gap.

    Writes diagnosis.json, tables, a page (index.html) and the scene with what is named
    (corrected.yaml) to the output folder. Simulations and trained posteriors are kept there or in
    --cache: after an interruption, or with more campaigns, --resume reuses them.
    docs/explanation/diagnosis.md says what each number means.

    Args:
        scene: study of the nominal scene
        out: folder for the results
    """
    from vsr2.campaign import load_campaign
    from vsr2.diagnosis import diagnose as find
    from vsr2.diagnosis import iterate
    from vsr2.diagnosis.corrected import check_draws
    from vsr2.diagnosis.iteration import WORK_FILES, Asked
    from vsr2.diagnosis.verdict.document import PAGE_FILE
    from vsr2.ensemble import campaign_step_trials
    from vsr2.report.diagnosis_page import format_diagnosis
    from vsr2.report.messages.commands import iteration_table
    from vsr2.report.messages.written import wrote

    _refuse_without_use(effort)
    if effort.check is not None:
        return _check(campaign, scene, out, question, effort)
    check_draws(effort.posterior_draws)
    measured, study = load_campaign(campaign).on_file(), opt.scene(scene, effort.set)
    (budget, tier), hypotheses = _budget(effort, question.tier), _hypotheses(question)
    opt.work_folder(out, WORK_FILES, "a diagnosis", effort)
    study, notes = with_time_step(study, campaign_step_trials(measured), "diagnose", effort)
    with opt.cluster(effort.scheduler, effort.threads) as client:
        asked = Asked(
            tier=tier,
            budget=budget,
            hypotheses=hypotheses,
            execution=opt.execution(effort, client, "diagnose", notes),
            seed=question.seed,
        )

        def written(found: Diagnosis, of: Study, folder: Path) -> None:
            _write(found, of, folder, effort)

        if effort.iterate:
            rounds = iterate(
                measured, study, out, asked=asked, most=effort.most_rounds, finished=written
            )
            said, path = iteration_table(rounds), out
        else:
            found = find(measured, study, out=out, **vars(asked))
            written(found, study, out)
            said, path = format_diagnosis(found), out / PAGE_FILE
    if not effort.quiet:
        print(said)
        print(wrote(path))
    return 0


def _refuse_without_use(effort: Effort) -> None:
    """Refuse options that another one, or its lack, leaves without use.

    Raises:
        ConfigError: names them.
    """
    if effort.check is not None and effort.iterate:
        raise ConfigError(
            "--check: does not go with --iterate; check the folder of one round, by --out"
        )
    if effort.waterfall and effort.no_how_far:
        raise ConfigError("--waterfall: does not go with --no-how-far; leave one of them out")
    if effort.like is not None and effort.campaign_trials is not None:
        raise ConfigError("--campaign-trials: --like states it; leave one of them out")
    if effort.most_rounds is not None and not effort.iterate:
        raise ConfigError("--most-rounds: only for rounds; add --iterate, or leave it out")


def _budget(effort: Effort, tier: Tier | None) -> tuple[Budget, Tier | None]:
    """The budget, and the tier that goes with it.

    Raises:
        ConfigError: --like is of another tier than is asked for.
    """
    from vsr2.diagnosis import Budget
    from vsr2.diagnosis.verdict.document import finished_diagnosis

    held_out, waterfall = not effort.no_how_far, effort.waterfall
    if effort.like is not None:
        its_tier, known = finished_diagnosis(effort.like)
        if tier not in (None, its_tier):
            raise ConfigError(
                f"--tier {tier}: the diagnosis in {effort.like} (--like) is of tier {its_tier}; "
                "leave --tier out, or give a budget in place of --like"
            )
        return Budget.repeating(known, held_out=held_out, waterfall=waterfall), its_tier
    budget = Budget(
        effort.budget_minutes,
        effort.simulations,
        effort.campaigns,
        trials=effort.campaign_trials,
        held_out=held_out,
        waterfall=waterfall,
        cpu_minutes=effort.budget_cpu_minutes,
    )
    return budget, tier


def _hypotheses(question: QuestionOptions) -> Hypotheses:
    from vsr2.campaign import load_campaign
    from vsr2.ensemble import Hypotheses

    return Hypotheses(
        exclude=question.exclude,
        priors=opt.priors(question.prior, question.exclude),
        nuisances=opt.nuisances(question.nuisance),
        references=[load_campaign(folder) for folder in question.reference],
        most_effects=question.most_effects,
    )


def _check(
    campaign: Path, scene: Path, out: Path, question: QuestionOptions, effort: Effort
) -> int:
    """Planted campaigns against the posterior of a finished diagnosis."""
    from vsr2.campaign import load_campaign
    from vsr2.coverage import check_posterior
    from vsr2.ensemble import campaign_step_trials
    from vsr2.report.messages.posterior_checks import check_sentences
    from vsr2.report.messages.written import wrote
    from vsr2.report.posterior_check_figure import write_check_figure

    measured = load_campaign(campaign)
    study, _ = with_time_step(
        opt.scene(scene, effort.set), campaign_step_trials(measured), "diagnose", effort
    )
    with opt.cluster(effort.scheduler, effort.threads) as client:
        found = check_posterior(
            measured,
            study,
            out=out,
            planted=effort.check or 0,
            tier=question.tier,
            hypotheses=_hypotheses(question),
            execution=opt.execution(effort, client, "diagnose"),
        )
    path = write_check_figure(found, out)
    if not effort.quiet:
        print(check_sentences(found))
        print(wrote(path))
    return 0


def _write(found: Diagnosis, study: Study, folder: Path, effort: Effort) -> None:
    """The page of a diagnosis and, where they are asked for, draws of its posterior."""
    from vsr2.diagnosis.corrected import write_draws
    from vsr2.report.diagnosis_page import write_diagnosis_page
    from vsr2.report.messages.commands import few_draws

    write_diagnosis_page(found, folder)
    asked = effort.posterior_draws
    written = write_draws(found, study, folder, asked) if asked else []
    if len(written) < asked and not effort.quiet:
        print(few_draws(folder, len(written), asked))
