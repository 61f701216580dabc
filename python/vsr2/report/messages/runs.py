"""Sentences about the results of runs: batches, fragility, calibration; each written once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from vsr2.one_line import counted
from vsr2.report.messages.templates import check_worded
from vsr2.results import STATUSES, HandOver, Status

if TYPE_CHECKING:
    from vsr2.calibration import Profile
    from vsr2.calibration.calibrate import NoBaselines
    from vsr2.fragility import FragilityFit, FragilityResult

# Batches

STATUS_MEANING = {
    Status.ok: "finished",
    Status.settling_timeout: "not at rest before the motion; no outcome",
    Status.tail_timeout: "not at rest in the end; the outcome is of the last state",
    Status.diverged: "the state became infinite or NaN; no outcome",
    Status.error: "see the message; no outcome",
    Status.cancelled: "stopped while it ran; no outcome",
    Status.not_run: "not started; no outcome",
}
check_worded(STATUSES, STATUS_MEANING, __name__)
HAND_OVERS = {
    HandOver.motor_on_a_slope: "a motor on a slope",
    HandOver.off_the_top: "off the top",
    HandOver.too_deep: "too deep",
}
check_worded([one for one in HandOver if one != HandOver.none], HAND_OVERS, __name__)


def trial_end(row: Mapping[str, Any]) -> str:
    """Why a trial did not end as it should, and what to do about it; empty: it did."""
    match Status[row["status"]]:
        case Status.settling_timeout:
            return (
                f"the rock did not come to rest within {row['settling_time']:g} s before the "
                "motion; raise settling.timeout or the rest speeds, or start it nearer to "
                "equilibrium"
            )
        case Status.tail_timeout:
            return (
                f"the rock was still moving {row['simulated_time']:g} s after it had settled; the "
                "outcome is of that state"
            )
        case Status.diverged:
            return (
                "the rock's state became infinite or NaN; check contact stiffness, damping and "
                "the time step"
            )
    return str(row["message"])


INTERRUPTED_TRIALS = "interrupted: trials that had not finished have no outcome"


def more_failures(count: int) -> str:
    """That failures beside those listed are left out, and where they are."""
    return f"and {count} more; see the column `status`"


def time_spent(simulated: float, steps: int, wall: object, threads: object) -> str:
    """What a batch simulated, and how fast.

    Args:
        simulated: [s].
        steps: of time, in all trials.
        wall: on the clock [s]; nothing is said where it is no number above 0.
        threads: number of them; None: not known.
    """
    parts = [f"{simulated:.4g} s simulated", f"{steps} time steps"]
    if isinstance(wall, (int, float)) and wall > 0:
        parts += [f"{wall:.4g} s on the clock", f"{steps / wall:.4g} steps/s"]
    if threads is not None:
        parts.append(f"{threads} thread{'' if threads == 1 else 's'}")
    return ", ".join(parts)


def engine_in_use(engine: str, hand_over: HandOver) -> str:
    """The engine that ran a trial, and why another went on with it."""
    if hand_over == HandOver.none:
        return engine
    return f"{engine}, then exact ({HAND_OVERS[hand_over]})"


def trial_name(index: int, name: str) -> str:
    """A trial by its index and name."""
    return f"trial {index} ({name})"


def trial_result(index: int, name: str, outcome: str, status: str) -> str:
    """A trial, its outcome, and its status where that is not ok."""
    said = f"{trial_name(index, name)}: {outcome}"
    return said if status == Status.ok else f"{said}, {status}"


def diagram_caption(trials: int) -> str:
    """What an overturning diagram shows."""
    shown = counted(trials, "trial")
    return f"Outcomes of {shown} in PGA [g] against PGV/PGA [s] of the motions as driven"


def history_caption(trial: str) -> str:
    """What time histories show, of a :func:`trial_result`."""
    return (
        "Pedestal position commanded and actual [m], tilt [deg], slip [mm] and change of roll, "
        f"pitch, yaw [deg] against time [s]; {trial}"
    )


def tracking_caption(trials: Iterable[str]) -> str:
    """What a tracking figure shows, of trials by :func:`trial_name`."""
    return (
        "Commanded against actual pedestal motion (supplement Fig. S1): position [m], power "
        "spectral density of both accelerations and, unless the drive prescribes the motion, "
        f"error [mm], gain and phase [deg] against frequency [Hz]; {', '.join(trials)}"
    )


# Fragility


def fit_note(fit: FragilityFit) -> str:
    """What keeps a fit from being a curve, or a surface from rising; empty: nothing."""
    from vsr2.fragility import FitNote
    from vsr2.fragility.settings import FIT

    if fit.falling:
        return (
            f"falls with {' and '.join(fit.falling)} in part of the range, by more than "
            f"{FIT.fall:g}: see whether the trials do, or set `surface: linear`"
        )
    sentences = {
        FitNote.ALL_OVERTURNED: "all trials overturned: no curve; widen the range of intensities",
        FitNote.ALL_STOOD: "all trials stood: no curve; widen the range of intensities",
        FitNote.NOT_RISING: "the probability does not rise with the measure: no lognormal curve",
    }
    check_worded(FitNote, sentences, __name__)
    return sentences[fit.note] if fit.note else ""


def fit_caveats(fit: FragilityFit) -> str:
    """What to know of a curve, parted by semicolons; empty: nothing."""
    found = [
        "outcomes separated without error: the steepness is the prior's" if fit.separated else "",
        "curved: a lognormal does not fit" if fit.lognormal and not fit.lognormal.fits else "",
        fit_note(fit),
    ]
    return "; ".join(filter(None, found))


def lognormal_text(result: FragilityResult) -> str:
    """One line a curve: median, beta, and what to know of them."""
    lines = []
    for name, fit in result.curves.items():
        parts = [
            f"{name}: {counted(fit.trials, 'trial')} of {counted(fit.groups, 'motion')}, "
            f"{fit.overturned} overturned"
        ]
        if (found := fit.lognormal) is not None:
            parts.append(
                f"median {found.median:.4g} [{found.median_lower:.4g}, {found.median_upper:.4g}], "
                f"beta {found.beta:.3g} [{found.beta_lower:.3g}, {found.beta_upper:.3g}]"
            )
        lines.append("; ".join(filter(None, [*parts, fit_caveats(fit)])))
    return "\n".join(lines)


def hazard_text(found: Mapping[str, Any]) -> str:
    """Rate, excluded age and survival of `vsr2 hazard`, a line each."""
    lines = [
        f"hazard curve  {found['curve']}, {found['measure']}",
        f"rate          {found['rate_per_year']:.3g} per year "
        f"[{found['rate_lower_per_year']:.3g}, {found['rate_upper_per_year']:.3g}]",
        f"              from intensities below the curve's levels "
        f"{100 * found['share_below_levels']:.2g} %, "
        f"above {100 * found['share_above_levels']:.2g} %",
        f"excluded age  {found['excluded_age_years']:.4g} years with "
        f"{100 * found['confidence']:g} % confidence "
        f"[{found['excluded_age_lower_years']:.4g}, {found['excluded_age_upper_years']:.4g}]",
    ]
    if "age_years" in found:
        lines.append(
            f"survival      a rock of {found['age_years']:g} years would stand with probability "
            f"{found['survival']:.3g}"
        )
    return "\n".join(lines)


# Calibration


def no_baselines(why: NoBaselines | None) -> str:
    """Why a campaign gives no baselines, and what to do about it; empty: it does."""
    from vsr2.calibration.calibrate import NoBaselines

    sentences = {
        NoBaselines.FEW_MOTIONS: (
            "fewer motions with outcome, PGA and PGV/PGA than folds, or a single one"
        ),
        NoBaselines.NO_INTENSITIES: (
            "no trial has an outcome, PGA and PGV/PGA; give trials.csv pga_g and pgv_pga_s, or "
            "motions"
        ),
    }
    check_worded(NoBaselines, sentences, __name__)
    return sentences[why] if why else ""


def optimism_note(optimism: float | None) -> str:
    """How to read scores in sample; None: there are no folds."""
    if optimism is None:
        return (
            "The simulator's scores are in sample: the values were chosen on the trials that they "
            "are judged on, so the scores are too good. Set `folds` to see by how much."
        )
    return (
        f"Optimism (objective in sample minus out of fold): {optimism:+.3f}. Out of fold, every "
        "trial is predicted with values chosen without any trial of its ground motion; judge by "
        "that line. The lines in sample are too good, the more so the more sets were tried. "
        "Intervals are 95 %, from a bootstrap over motions, for the predictions as they are."
    )


def compatible_values(profile: Profile) -> str:
    """The compatible values of a parameter, and how much of its range no set has tried."""
    kept = [cell for cell in profile.cells if cell.compatible]
    if kept and kept[0].low == kept[0].high:
        text = ", ".join(
            cell.low if isinstance(cell.low, str) else f"{cell.low:g}" for cell in kept
        )
    else:
        text = f"{kept[0].low:g} to {kept[-1].high:g}" if kept else "none"
    untried = sum(cell.sets == 0 for cell in profile.cells)
    return text + (
        f"; {untried} of {counted(len(profile.cells), 'part')} untried" if untried else ""
    )
