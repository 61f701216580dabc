"""Sentences of the command line about what a verb did."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isnan, pi
from pathlib import Path
from typing import TYPE_CHECKING

from vsr2._native import FastRefusal
from vsr2.analysis.bootstrap import SCORES
from vsr2.diagnosis.iteration import Ended
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.one_line import counted
from vsr2.report.messages.agreement import FITTED, IDENTIFIABILITY
from vsr2.report.messages.data import scene_note
from vsr2.report.messages.runs import compatible_values
from vsr2.report.messages.templates import check_worded
from vsr2.report.messages.verdicts import shown
from vsr2.scene.notes import WARNINGS
from vsr2.simulation.native_scenes import FAST_REFUSALS

if TYPE_CHECKING:
    from vsr2.analysis import TimeStepChoice, TimeStepError
    from vsr2.analysis.baseline import BaselineScore
    from vsr2.calibration import CalibrationResult
    from vsr2.diagnosis import Iteration
    from vsr2.effects import Effect, Parameter
    from vsr2.ensemble.reference_campaign import Agreement
    from vsr2.prediction import Prediction
    from vsr2.results import BatchResult
    from vsr2.simulation import BatchEstimate
    from vsr2.simulation.bench import Rock
    from vsr2.simulation.effect_checks import EffectReport, Liveness
    from vsr2.trial import Trial


def table(rows: Sequence[Sequence[str]], align: Callable[[str, int], str] = str.rjust) -> str:
    """Rows of text, of which the first is the header, in columns two blanks apart."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(align, row, widths)).rstrip() for row in rows)


def interrupted_batch(result: BatchResult, folder: Path) -> str:
    """How much of an interrupted batch is kept, and how to go on."""
    finished = int(result.finished.sum())
    return (
        f"interrupted; {finished} of {counted(len(result), 'trial')} are finished and kept in "
        f"{folder}. `--resume` runs the others."
    )


def finished_before(folder: Path, trials: int) -> str:
    """That a run is finished, so that resuming it has nothing to do."""
    return f"nothing to do: {folder} holds the finished result of {counted(trials, 'trial')}"


def merged_logs_lost(folder: Path, lost: Sequence[int]) -> str:
    """That a merged result lost logs since, and how to get them back."""
    return (
        f"{folder}: the logs of {counted(len(lost), 'trial')} are gone or damaged, the first is "
        f"that of trial {lost[0]}; make them again by --resume in place of --merge"
    )


def few_draws(folder: Path, written: int, asked: int) -> str:
    """That `--posterior-draws` wrote fewer scenes than were asked for, and why."""
    why = "no study can state more" if written else "nothing is named that a study can state"
    return f"{written} of {counted(asked, 'draw')} of the posterior are written to {folder}: {why}"


def interrupted_calibration(folder: Path) -> str:
    """How much of an interrupted calibration is kept, and how to go on."""
    return f"interrupted; what is finished is kept in {folder}. `--resume` goes on."


def calibration_search(result: CalibrationResult) -> str:
    """What a calibration searched, and how much of it was simulated now."""
    return (
        f"{counted(len(result.steps), 'set')} searched, best objective "
        f"{result.searched.score:.4g}; {counted(len(result.evaluations), 'set')} in all, "
        f"{result.provenance['simulated_in_this_run']} of them simulated now"
    )


def calibration_summary(result: CalibrationResult) -> str:
    """Optimism of a search, and the best value of each parameter: lines."""
    lines = [f"optimism: {result.optimism:+.3f}"] if result.folds else []
    lines += [
        f"{profile.name}: {profile.best} "
        f"({IDENTIFIABILITY[profile.verdict]}; {compatible_values(profile)})"
        for profile in result.profiles
    ]
    return "".join(f"{line}\n" for line in lines)


def baseline_table(scores: Sequence[BaselineScore]) -> str:
    """Ways of predicting outcomes: scores with their 95 % intervals."""
    header = ["prediction", "fitted", "trials", *SCORES[:4], "mean of three"]
    rows = [
        [
            one.name,
            FITTED[one.fitted],
            str(one.metrics.trials),
            *(str(one.intervals[name]) for name in SCORES),
        ]
        for one in scores
    ]
    return table([header, *rows], str.ljust)


def prediction_table(found: Prediction) -> str:
    """Scores of predictions with their 95 % intervals and the calibration curve; or a count."""
    if not found.scores:
        count, p = len(found.campaign), found.probability
        return (
            f"{int(found.predicted.sum())} of {count} trials are predicted to overturn, "
            f"{p.sum():.1f} on average; no outcome is known"
        )
    names = ("log_loss", "brier", "accuracy", "precision", "recall", "objective")
    header = ["prediction", "fitted", "trials", "log loss", "Brier", *names[2:5], "mean of three"]
    rows = [
        [
            one.name,
            FITTED[one.fitted],
            str(one.trials),
            *(str(one.intervals[name]) for name in names),
        ]
        for one in found.scores
    ]
    curve = [["probability", "trials", "predicted", "observed"]]
    curve += [
        [f"{one.low:.1f} to {one.high:.1f}", str(one.trials), f"{one.predicted:.3f}",
         str(one.observed)]
        for one in found.curve
        if one.trials
    ]  # fmt: skip
    return f"{table([header, *rows], str.ljust)}\n\n{table(curve, str.ljust)}"


_ENDED = {
    Ended.NOTHING_NAMED: "the last round names nothing",
    Ended.MOST_ROUNDS: "as many rounds as were asked for; --most-rounds allows more",
    Ended.NOTHING_CHANGED: "what the last round names leaves the scene as it is",
    Ended.NOT_STATED: "no study states what the last round names beside the scene's own effects",
}
check_worded(Ended, _ENDED, __name__)


def iteration_table(found: Iteration) -> str:
    """Rounds of diagnosis: what each names, what it adds to the scene, and the losses."""
    header = ["round", "verdict", "named", "none", "loss before", "floor", "added to the scene"]
    rows = []
    for k, one in enumerate(found.to_json()["rounds"]):
        verdict, added = one["verdict"], one["corrected"] or {}
        # Of a gap that is not resolved these are what leads, and nothing is named.
        named = verdict["effects"] if VerdictKind(verdict["kind"]).names_effects else []
        rows.append(
            [
                str(k + 1), verdict["kind"], ", ".join(named) or "-",
                f"{one['none_probability']:.2f}", _estimate(one["before"]), _estimate(one["floor"]),
                "; ".join(f"{name}: {_values(values)}" for name, values in added.items()) or "-",
            ]
        )  # fmt: skip
    return f"{table([header, *rows], str.ljust)}\n{_ENDED[found.ended]}"


def _estimate(one: Mapping[str, float | None]) -> str:
    return "-" if one["value"] is None else f"{one['value']:.3f}"


def _values(values: Mapping[str, float | str]) -> str:
    return ", ".join(f"{name} {shown(value)}" for name, value in values.items())


_MEASURES = {
    "outcomes": ("outcomes that differ", 100.0, "%"),
    "tilt_mean": ("ln largest tilt, mean difference", 1.0, "1"),
    "tilt_size": ("ln largest tilt, mean absolute difference", 1.0, "1"),
    "turn_mean": ("final turn, mean difference", 180 / pi, "degree"),
    "turn_size": ("final turn, mean absolute difference", 180 / pi, "degree"),
}
"""Words, factor and unit by measure of `Agreement`."""


def reference_table(found: Sequence[Agreement]) -> str:
    """A reference campaign against the nominal scene, with the noise floor beside it."""
    header = ["measure", "unit", "trials", "campaign", "starts moved", "fresh draws, 90 %", "p"]
    rows = []
    for one in found:
        words, factor, unit = _MEASURES[one.measure]
        campaign, starts, low, high = (
            f"{factor * value:.3g}" for value in (one.campaign, one.starts, one.low, one.high)
        )
        rows.append(
            [
                words, unit, str(one.trials), campaign, starts, f"{low} to {high}",
                f"{one.p_value:.2g}",
            ]
        )  # fmt: skip
    apart = [_MEASURES[one.measure][0] for one in found if one.differs]
    said = (
        f"differs by more than nuisances, contact models and starts explain: {'; '.join(apart)}. "
        "The nominal scene lacks something, or its tolerances are too narrow."
        if apart
        else "agrees within what nuisances, contact models and starts leave open"
    )
    return f"{table([header, *rows], str.ljust)}\n{said}"


def effect_report(report: EffectReport) -> str:
    """The checks of an effect, one a line."""
    from vsr2.simulation.effect_checks import CHECK

    neutral = "yes" if report.neutral else "NO: the trajectory differs at the null value"
    lines = [
        f"{report.effect.name}: {'passes' if report.good else 'FAILS'}",
        f"  neutral: {neutral}",
    ]
    if report.step:
        found = "yes" if report.is_continuous else "NO: responses jump beside the null value"
        lines.append(f"  continuous: {found}, {_ratios(report.step)}")
    elif report.effect.jump:
        lines.append(f"  continuous: exempt, it declares a jump: {report.effect.jump}")
    else:
        lines.append("  continuous: not checked, the null value has no value beside it")
    alive = f"  alive: {'yes' if report.is_alive else 'NO'}, {_ratios(report.alive)}"
    if not report.is_alive:
        alive += f"; more than {CHECK.alive:g} times is wanted, so widen a prior's ends"
    lines.append(alive)
    if report.right is None:
        lines.append(
            "  right: not part of the installed package; VSR2's own tests hold "
            f"`{report.effect.name}` in studies/effect_closed_forms"
        )
    elif not report.right:
        lines.append("  right: NO, its `verify` gives no check")
    lines += [
        f"  right: {'yes' if check.good else 'NO'}, {check.what}: {check.measured:.5g}, "
        f"expected {check.expected:.5g} +- {check.tolerance:.2g}"
        for check in report.right or ()
    ]
    lines.append(f"  {engine_fast(report.fast_refusal)}")
    return "\n".join(lines)


def effect_text(one: Effect) -> str:
    """What an effect of the library is, with its parameters."""
    lines = [f"{one.name}: {one.meaning}.", f"stage: {one.stage}"]
    for parameter in one.parameters:
        unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
        second = "; has no effect on its own" if parameter.secondary else ""
        lines.append(f"parameter {parameter.name}{unit}: {parameter.meaning}")
        lines.append(f"  prior {parameter.range_text}; none given: {_null(parameter)}{second}")
    lines.append(f"touches: {', '.join(one.channels)}")
    if one.confounded_with:
        lines.append(f"confounded with: {', '.join(one.confounded_with)}")
    return "\n".join([*lines, *([f"source: {one.source}"] if one.source else [])])


def _null(parameter: Parameter) -> str:
    if isnan(parameter.null):
        return "as in the study"
    if parameter.choices:
        return parameter.choices[int(parameter.null)]
    return f"{parameter.null:g}"


check_worded(
    [one for one in FastRefusal.__members__.values() if one is not FastRefusal.none],
    FAST_REFUSALS,
    "vsr2.simulation.native_scenes",
)


def engine_fast(refusal: FastRefusal) -> str:
    """Whether the engine `fast` takes an effect, and why not."""
    if refusal is FastRefusal.none:
        return "engine fast: yes"
    return f"engine fast: no, {FAST_REFUSALS[refusal]}"


def effects_passed(passed: int, checked: int) -> str:
    """How many effects pass what was checked."""
    return f"{passed} of {checked} effects pass all four checks"


def study_begins(name: str, trials: Sequence[Trial], engine: str) -> str:
    """What a run is about to do, and what was repaired: lines. Warnings are said elsewhere."""
    rock, pedestal = trials[0].scene.rock, trials[0].scene.pedestal
    first = (
        f"{name}: {counted(len(trials), 'trial')}, {Path(rock.source).name} "
        f"({rock.mass.mass:.4g} kg) on {Path(pedestal.source).name}, engine {engine}, "
        f"{pga_range([trial.motion.pga_g for trial in trials])}"
    )
    notes = [note for note in rock.notes if note.code not in WARNINGS]
    return "\n".join([first, *(f"note: {scene_note(note.to_json())}" for note in notes)])


def pga_range(values: Sequence[float]) -> str:
    """The range of peak ground accelerations [g], to read once whether their unit is right."""
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return f"PGA {low} g" if low == high else f"PGA {low} to {high} g"


def batch_estimate(estimate: BatchEstimate, folder: Path) -> str:
    """What a batch would take, and where it would go: lines. Nothing was run for it but a trial."""
    return (
        f"would run {counted(estimate.trials, 'trial')} of {estimate.motion_time:.4g} s of motion "
        f"in {counted(estimate.threads, 'thread')}: about {estimate.wall_time:.2g} s, if all are "
        "like the one that was timed\n"
        f"would write {_size(estimate.table_bytes)} of tables and at most "
        f"{_size(estimate.log_bytes)} of logs into {folder}"
    )


def time_step_table(found: Sequence[TimeStepError], longest: float | None, tolerance: float) -> str:
    """What time steps cost, and which keeps a tolerance."""
    rows = [["time step [ms]", "motions", "margin", "standard error", "scatter", "CPU [ms]"]]
    rows += [
        [
            f"{1e3 * one.time_step:g}", str(one.motions), f"{one.margin_change:+.4f}",
            f"{one.standard_error:.4f}", f"{one.scatter:.4f}", f"{1e3 * one.cpu_time:.1f}",
        ]
        for one in found
    ]  # fmt: skip
    lines = [
        table(rows),
        "",
        f"margin: mean change, against {1e3 * found[0].time_step:g} ms, of the logarithm of the "
        "factor on a motion at which the rock overturns. Above zero it overturns too late.",
    ]
    if longest is None:
        lines.append(
            f"No step surely keeps {tolerance:g}. More motions or --replicates make the standard "
            "errors smaller."
        )
    else:
        lines.append(
            f"{1e3 * longest:g} ms is the longest step that surely keeps {tolerance:g}: "
            f"--set engine.time_step={longest:g}"
        )
    return "\n".join(lines)


def chosen_time_step(choice: TimeStepChoice) -> str:
    """Which time step was chosen by a study's tolerance, and by what."""
    step = f"time step {1e3 * choice.time_step:g} ms"
    if not choice.kept:
        return f"{step}, the default: none surely keeps the tolerance {choice.tolerance:g}"
    own = next(one for one in choice.found if one.time_step == choice.time_step)
    return (
        f"{step}: the longest that surely keeps the tolerance {choice.tolerance:g}. Against "
        f"{1e3 * choice.found[0].time_step:g} ms it changes the mean margin of "
        f"{counted(own.motions, 'motion')} by {own.margin_change:+.4f} (standard error "
        f"{own.standard_error:.4f})"
    )


def _size(size: float) -> str:
    return f"{size / 1e6:.3g} MB" if size < 1e9 else f"{size / 1e9:.3g} GB"


def shard_done(shard: object, result: BatchResult, folder: Path) -> str:
    """What one shard of a study gave, and how to go on."""
    return (
        f"shard {shard}: {counted(len(result), 'trial')} in {folder}. Once all shards are run, "
        "--merge makes one result of them."
    )


def _ratios(found: Mapping[Rock, Liveness]) -> str:
    return ", ".join(
        f"{one.ratio:.3g} times the floor on the {rock} ({one.feature})"
        for rock, one in found.items()
    )


def completion_installed(file: Path) -> str:
    """Where the completion of a shell stands now."""
    return f"wrote {file}; a new shell reads it"


def replay_at(url: str) -> str:
    """Where a replay is seen, and how it ends."""
    return f"replay at {url} (Ctrl-C ends it)"
