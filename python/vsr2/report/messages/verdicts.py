"""Sentences about a diagnosis: the one place where its codes and values are worded.

All functions read the content of `diagnosis.json`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from vsr2.diagnosis.verdict.next_measurement import Instrument, MeasurementKind
from vsr2.diagnosis.verdict.statements import (
    Code,
    GapState,
    LimitCode,
    ReasonCode,
    VerdictKind,
)
from vsr2.diagnosis.where.scan import SCAN
from vsr2.report.pages import listed, plain

Values = Mapping[str, Any]

_REASONS: dict[Code, str | Callable[[Values], str]] = {
    ReasonCode.NO_GAP: lambda v: (
        "no gap beyond noise: the loss is "
        + (
            f"larger than in most campaigns simulated without any effect (p = {v['p_size']:.2g}), "
            "but over these motions its interval reaches down to the floor"
            if v["size_significant"]
            else f"no larger than in campaigns simulated without any effect (p = {v['p_size']:.2g})"
        )
        + ", and none of the effects is favoured beyond what such campaigns show (p = "
        f"{v['p_direction']:.2g})"
    ),
    ReasonCode.NONE_IMPROBABLE: (
        "but weighed by its prior, none has a probability of {none:.1g}: {favoured} or another "
        "effect is likely; a larger budget, or more trials, may decide"
    ),
    ReasonCode.NONE_NOT_IN_SET: (
        "but none has a probability of {none:.2g} and is not in the 90 % set, which {favoured} "
        "leads: more trials may decide"
    ),
    ReasonCode.NONE_LESS_PROBABLE: lambda v: (
        f"weighed by its prior, {'a cause outside the library, ' if v['out_of_library'] else ''}"
        f"{v['favoured']} or another effect is more probable than none, but no more than in "
        "gap-free campaigns by chance: too weak to be called a gap"
    ),
    ReasonCode.GAP: (
        "a gap beyond noise: p = {p_size:.2g} for its size, {p_direction:.2g} for its direction, "
        "against campaigns simulated without any effect"
    ),
    ReasonCode.SIGNS_OF_GAP: (
        "signs of a gap: p = {p_size:.2g} for its size, {p_direction:.2g} for its direction, "
        "against campaigns simulated without any effect"
    ),
    ReasonCode.SURPRISING_OUTCOMES: (
        "trials did what they never do in simulations without effect, more often than chance has "
        "it (p = {p:.2g})"
    ),
    ReasonCode.SIZE_OPEN: (
        "but over these motions the interval of its size reaches down to zero: what would shrink "
        "is not known, so that nothing is named; {leading} leads"
    ),
    ReasonCode.ROUTE_SET_EXCLUDES: "the {route}'s 90 % set holds none of {effects}",
    ReasonCode.ROUTE_FAVOURS_OTHER: (
        "the {route} favours {effect}, which the other route rules out"
    ),
    ReasonCode.HALVES_DISAGREE: ("half of the draws lead to another answer: spend a larger budget"),
    ReasonCode.TOO_MANY_EQUIVALENT: (
        "with these trials and simulations {count} of the library's {offered} effects cannot be "
        "told apart: the data do not decide"
    ),
    ReasonCode.TOO_MANY_NEEDED: lambda v: (
        f"{_first(v)}; it takes {v['count']} of the library's {v['offered']} effects to reach "
        f"{v['wanted']:g}: the data do not decide"
    ),
    ReasonCode.GAP_LEFT: lambda v: (
        f"the best effect leaves {min(v['left'], 1.0):.0%} of the gap on motions that it did not "
        "see"
    ),
    ReasonCode.GAP_LEFT_AND_MISFIT: (
        "the best effect leaves {left:.0%} of the gap on motions that it did not see, and fits "
        "worse than {worse_than:.0%} of the campaigns that the library makes"
    ),
    ReasonCode.FLOOR_EXCEEDED: (
        "what the best effect leaves is more than {times:g} times the floor's own loss: it is no "
        "explanation, however much of the gap it closes"
    ),
    ReasonCode.RESIMULATION_SHORT: (
        "re-simulated under what leads, the uncertain trials lose {closure:.0%} of their gap where "
        "the emulator predicts {predicted:.0%}: it cannot be trusted here"
    ),
    ReasonCode.NONE_BEATS_OUT_OF_LIBRARY: (
        "the best effect leaves a gap above the floor on motions that it did not see, but by its "
        "prior none, with {none:.2f}, is more probable than a cause outside the library, with "
        "{out_of_library:.2f}"
    ),
    ReasonCode.MISFIT: (
        "the best effect leaves a gap above the floor on motions that it did not see, and fits "
        "worse than {worse_than:.0%} of the campaigns that the library makes"
    ),
    ReasonCode.PAIR_LEAVES_GAP: lambda v: (
        f"{listed(v['effects'], 'and')} together do better there than one effect, but leave "
        f"{min(max(v['left'], 0.0), 1.0):.0%} of the gap: two effects, or a cause outside the "
        "library"
    ),
    ReasonCode.PART_OF_THE_CAUSE: (
        "that best one, {effect}, still closes {closed:.0%} of the gap there: it may be a part of "
        "the cause, beside what the library lacks"
    ),
    ReasonCode.SECOND_EFFECT_HELPS: (
        "a second effect improves the score on motions that the choice did not see"
    ),
    ReasonCode.EQUIVALENT_HERE: "this campaign does not tell these effects apart",
    ReasonCode.OTHERS_FIT_WORSE: lambda v: (
        f"{_first(v)}; {v['wanted']:g} takes the others too, which fit worse"
    ),
}

_LIMITS: dict[Code, str | Callable[[Values], str]] = {
    LimitCode.POSSIBLY_OUT_OF_LIBRARY: (
        "the best effect fits worse than {worse_than:.0%} of the library's own campaigns: the "
        "chance that the cause lies outside the library is {probability:.0%}, from {prior:.0%} "
        "before"
    ),
    LimitCode.HALVES_TOO_SMALL: (
        "too few draws for half of them to say anything: repeat with another seed, or a larger "
        "budget, before you rely on what is named"
    ),
    LimitCode.CONTROL_CLOSES_AS_MUCH: (
        "a wrong effect, or a plain rescaling of the probabilities, closes about as much of the "
        "gap on motions not seen: that the gap shrinks does not speak for what is named"
    ),
    LimitCode.NOT_IN_SET: (
        "{effects} named beside {leading} without a place in the 90 % set: what theory takes for "
        "about the same is told apart by strong evidence alone"
    ),
    LimitCode.EQUIVALENT_TO_MEMBER: lambda v: (
        f"in place of {v['effect']} it may be {' or '.join(v['others'])}, which theory takes for "
        "about the same"
    ),
    LimitCode.EQUIVALENT_EXCLUDED: lambda v: (
        f"{' or '.join(v['others'])}, which theory takes for about the same as {v['effect']}, was "
        f"left out of the library: {v['effect']} may stand for it"
    ),
    LimitCode.BEYOND_TOLERANCE: lambda v: (
        f"a set-up whose {' or '.join(v['nuisances'])} lies further off the scene than the "
        "tolerance that was reckoned with would look the same: check what was measured of it"
    ),
    LimitCode.SIZE_MAY_BE_NULL: lambda v: f"{_size(v)}, {v['null']:g} being no effect",
    LimitCode.SIZE_AS_WIDE_AS_PRIOR: lambda v: _size(v) + ", nearly all that its prior allows",
    LimitCode.TRIALS_INCOMPLETE: (
        "{count} trials of the campaign have no motion or no outcome and were not used"
    ),
    LimitCode.EFFECTS_EXCLUDED: "left out of the library as asked: {effects}",
    LimitCode.EFFECT_UNAVAILABLE: (
        "{effect} was not looked for, this scene cannot have it: {error}"
    ),
    LimitCode.SPECIMENS: lambda v: (
        f"{len(v['specimens'])} specimens ({', '.join(v['specimens'])}) were all simulated as the "
        "one of the scene: a difference between them may pass for an effect; diagnose each alone"
    ),
    LimitCode.FEW_TRIALS: (
        "{count} trials: effects near the noise floor stay undetected, and classes are wide; "
        "single effects need some hundred trials"
    ),
    LimitCode.FEW_MOTIONS: (
        "{count} ground motions: intervals over motions are rough, and held-out motions few"
    ),
    LimitCode.OUTCOMES_ALONE: (
        "outcomes alone: what changes the response without changing who overturns cannot be seen; "
        "the largest tilt of each trial would say much more"
    ),
    LimitCode.TILTS_LACKING: (
        "{count} trials that stood have no largest tilt: their outcomes are used"
    ),
    LimitCode.TILTS_UNUSED: (
        "{count} of {of} trials that stood have a largest tilt that tier B does not use; the next "
        "tier needs it of nine in ten"
    ),
    LimitCode.SERIES_UNUSED: (
        "{count} of {of} trials have a series that tier M does not use; the next tier needs it of "
        "nine in ten"
    ),
    LimitCode.ALL_OVERTURNED: (
        "every trial overturned: outcomes tell only that the boundary of overturning lies "
        "elsewhere; add motions on its other side"
    ),
    LimitCode.ALL_STOOD: (
        "every trial stood: outcomes tell only that the boundary of overturning lies elsewhere; "
        "add motions on its other side"
    ),
    LimitCode.LOW_DETECTION_RATE: (
        "of gaps from a cause outside the library, {rate:.0%} would be detected as unknown (each "
        "effect left out in turn): a named effect may stand for one that the library lacks"
    ),
    LimitCode.NO_DETECTION_RATE: (
        "of gaps from a cause outside the library, none would be detected as unknown (each effect "
        "left out in turn): a named effect may stand for one that the library lacks"
    ),
    LimitCode.INTERLEAVED_SESSIONS: (
        "sessions are interleaved: no change over the order can be found, because nothing but "
        "parts of them could be permuted"
    ),
    LimitCode.INTERLEAVED_IN_ONE_SESSION: (
        "motions of one session are interleaved: no change over the order can be found, because "
        "nothing but parts of them could be permuted"
    ),
    LimitCode.INTERLEAVED_MOTIONS: (
        "motions are interleaved over the sessions: whether one session stands out is not known, "
        "because trials of a motion err together and could not be permuted as a unit"
    ),
    LimitCode.ONE_SESSION: ("one session: a change between sessions cannot be told from a trend"),
    LimitCode.FEW_SESSIONS: (
        "few sessions: their order can be changed in {orders} ways, so that no change over the "
        "order is significant (p of {p:.2f} at least)"
    ),
    LimitCode.FEW_UNCERTAIN: (
        "only {count} trials are uncertain under the library's effects: choose motions nearer to "
        "the boundary of overturning"
    ),
    LimitCode.INSENSITIVE: (
        "this campaign hardly responds to {effects}: nothing is said about them"
    ),
    LimitCode.TRIALS_BEYOND_BUDGET: (
        "{count} uncertain trials were not used: the budget does not reach them"
    ),
    LimitCode.CERTAIN_TRIALS_CHANGE: (
        "{count} of the trials that did the same in all simulations do otherwise with the effect "
        "added: that counts in the gap and its closure, but neither parameters nor probabilities "
        "rest on it"
    ),
    LimitCode.BUDGET_EXCEEDED: (
        "a diagnosis of these trials needs at least {simulations} simulations, more than the "
        "budget of {allowed}"
    ),
    LimitCode.BUDGET_ENDED_EARLY: (
        "the budget ended before the answer stood on two doublings of the simulations"
    ),
    LimitCode.NO_REPEATS: "no repeats: the physical noise floor is unknown",
    LimitCode.REPEATS_SCATTER: (
        "of {pairs} pairs of repeats {share:.0%} end otherwise, where the simulations have "
        "{expected:.0%}: the laboratory scatters more than the tolerances say, and what scatters "
        "is no effect; state wider ones (--nuisance), or find what differs between repeats"
    ),
    LimitCode.MEASURES_LACKING: (
        "some trials have no intensity measures and are left out of the conditions"
    ),
}

_INSTRUMENTS = {
    Instrument.SCAN_AND_TILT: (
        "scan the specimen and its base, and tilt the base slowly until it overturns: the static "
        "angle gives the slenderness without any motion"
    ),
    Instrument.WEIGH_AND_SWING: (
        "weigh the specimen and swing it as a pendulum: mass centre and inertia"
    ),
    Instrument.PUSH_AND_ROCK: (
        "push the specimen slowly and let it rock freely on the table at rest: friction and decay "
        "of rocking"
    ),
    Instrument.FILM_FREE_ROCKING: (
        "let the specimen rock freely on the table at rest and film it: energy lost per impact"
    ),
    Instrument.TABLE_SENSORS: (
        "record the table beside the specimen with an independent accelerometer (and a rotation "
        "sensor), and compare with the channel that drives the simulation"
    ),
    Instrument.SECOND_TABLE_INSTRUMENT: "record the table with a second instrument",
    Instrument.SURVEY_STARTS: "survey the specimen's position and yaw before every trial",
    Instrument.REPEAT_FIRST_TRIALS: (
        "repeat the first trials at the end of the campaign, and inspect the edges between sessions"
    ),
    Instrument.FILM_OUTCOMES: "film every trial and judge all of them again by one rule",
    Instrument.SLACK: (
        "measure the slack of all that can hold the specimen, and film whether it is taut"
    ),
    Instrument.PULL_OFF: (
        "pull the specimen up from its base with a load cell before the first trial"
    ),
    Instrument.EDGE_TORQUE: (
        "look for soft or loose contact under the edges, and measure the torque that turns the "
        "specimen about one"
    ),
    Instrument.SPIN_TORQUE: ("turn the specimen slowly about the vertical and measure the torque"),
    Instrument.FEELER_GAUGES: (
        "look under the specimen for grains and bumps, with feeler gauges or carbon paper between "
        "the base and the table"
    ),
    Instrument.TABLE_ROTATION: (
        "record the rotation of the table beside the specimen under one of the motions"
    ),
    Instrument.OFF_AXIS_RECORD: "record the table across the shaking and about the vertical",
    Instrument.VERTICAL_RECORD: "record the table's vertical acceleration",
}
_MISSING = {"B": "largest tilt and series", "M": "series", "T": "contacts and a second table"}
"""What a tier lacks, for instruments beyond it."""


def sentence(statement: Mapping[str, Any]) -> str:
    """A reason or a limit, with its code and values."""
    code, values = statement["code"], statement["values"]
    template = _REASONS.get(code) or _LIMITS[code]
    if not isinstance(template, str):
        return template(values)
    lists = {name: ", ".join(v) for name, v in values.items() if isinstance(v, list | tuple)}
    return template.format(**{**values, **lists})


def instrument(code: str) -> str:
    """What to do with an instrument."""
    return _INSTRUMENTS[Instrument(code)]


def next_measurement(measure: Mapping[str, Any]) -> str:
    """What to measure next."""
    outside, own = measure["out_of_library"], ""
    if measure["instruments"]:
        word = "; and " if measure["kind"] == MeasurementKind.BOTH else "; or "
        own = word.join(instrument(code) for code in measure["instruments"])
    if outside is None:
        return own
    case = "if the cause lies outside the library" if own else "no effect of the library fits"
    text = (
        f"{case}: repeat trial {outside['trial']}, which the best of them explains least, with "
        f"instruments beyond tier {outside['tier']} ({_MISSING[outside['tier']]} channel), and "
        "film base and edges"
    )
    if outside["location"] is not None:
        text += f"; the residuals point to: {outside['location']}"
    return f"{text}; otherwise {own}" if own else text


def location(row: Mapping[str, Any]) -> str:
    """A location of the gap, with the feature where that is not the outcome."""
    feature = "" if row["channel"] == "outcome" else f"{row['feature']}: "
    return feature + str(row["location"])


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in one sentence."""
    verdict = content["verdict"]
    names = [plain(name) for name in verdict["effects"]]
    chance = f"{verdict['probability']:.0%}" if verdict["probability"] < 0.995 else "over 99%"
    match verdict["kind"]:
        case VerdictKind.NONE:
            found = [row for row in content["where"] if row["p_familywise"] <= SCAN.significant]
            if found:
                return (
                    "No gap beyond noise in the loss, but residuals stand out: "
                    f"{plain(location(found[0]))} (family-wise p {found[0]['p_familywise']:.2g})."
                )
            return (
                "No gap beyond noise: this campaign gives no reason to change the model, and does "
                f"not exclude what is too weak to show (none: {chance})."
            )
        case VerdictKind.EFFECT:
            said = f"Of the effects in the library, {names[0]} explains the gap ({chance})"
        case VerdictKind.CLASS:
            groups = {
                row["class"] for row in content["effects"] if row["name"] in verdict["effects"]
            }
            does = "cannot tell them apart" if len(groups) == 1 else "does not decide between them"
            said = (
                f"Of the effects in the library, {listed(names)} explains the gap ({chance} "
                f"together; this campaign {does})"
            )
        case VerdictKind.PAIR:
            said = f"{listed(names, 'and').capitalize()} together explain the gap ({chance})"
        case VerdictKind.UNKNOWN:
            return (
                f"There is a gap; no effect of the library explains it ({chance}), and no pair of "
                "them was found that does."
            )
        case _:
            return _unresolved(content, names)
    bounds = content["gap"]["headline"]["ci95"]
    if bounds[0] <= 0 or content["gap"]["closure"]["ci95"][0] <= 0:
        return f"{said}, but not surely better than a wrong effect or a plain rescaling does."
    closed = content["gap"]["closure"]["value"]
    return f"{said}: added, it closes {closed:.0%} of the gap on motions that it did not see."


def _unresolved(content: Mapping[str, Any], names: Sequence[str]) -> str:
    said = {
        GapState.NOT_FOUND: "Whether there is a gap is not resolved",
        GapState.SIZE_OPEN: "There are signs of a gap, but its size is not told from zero",
        GapState.FOUND: "There is a gap, but its cause is not resolved",
    }[content["gap"]["state"]]
    if not names:
        return f"{said}."
    outside = content["unknown"]["probability"]
    if outside > 0.5:
        return (
            f"{said}; most probable is a cause outside the library ({outside:.0%}), before "
            f"{_candidates(names)}."
        )
    are = "the leading candidate is" if len(names) == 1 else "candidates are"
    return f"{said}; {are} {_candidates(names)}."


def closure_note(content: Mapping[str, Any]) -> str:
    """What the closures say, beside the figure of losses."""
    gap, control = content["gap"], content["negative_control"]
    size = f"The gap is {interval(gap['excess'])} nat a trial over the floor. "
    if gap["closure"]["value"] is None:
        return size + "No closure is given, because the gap's interval touches the floor."
    text = (
        f"{size}Closure {interval(gap['closure'])}; negative control "
        f"{interval(control['closure'])} ({plain(str(control['effect']))}); recalibration "
        f"{interval(control['recalibration'])}. Headline, closure minus the better of these, or "
        f"0: {interval(gap['headline'])}."
    )
    if gap["closure_resimulated"]["value"] is None:
        return text
    return (
        f"{text} These are the emulator's; the uncertain trials re-simulated with what was chosen "
        "on other motions, judged by simulations alone: closure "
        f"{interval(gap['closure_resimulated'])}."
    )


def channels_note(content: Mapping[str, Any]) -> str:
    """What other channels would show, and how the table was checked."""
    unseen = {
        "B": "Outcomes alone tell nothing of phases; largest tilts and series would. ",
        "M": "Series would tell uplift, impacts, decay and rest pose apart. ",
    }
    if any(row["channel"] == "table" for row in content["where"]):
        table = "Record gain and phase: the table's acceleration against its displacement."
    else:
        table = (
            "The table's motion was recorded once, so that it cannot be checked: its errors show "
            "in the response alone."
        )
    return unseen.get(content["campaign"]["tier"], "") + table


def with_sentences(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with a `text` beside every code: verdict, reasons, limits, next measurement."""

    def worded(statements: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
        return [{**one, "text": sentence(one)} for one in statements]

    verdict, measure = content["verdict"], content["next_measurement"]
    return {
        **content,
        "verdict": {
            **verdict,
            "reasons": worded(verdict["reasons"]),
            "text": verdict_sentence(content),
        },
        "limits": worded(content["limits"]),
        "next_measurement": measure and {**measure, "text": next_measurement(measure)},
    }


def interval(estimate: Mapping[str, Any]) -> str:
    """Value and 95 % interval."""
    value, bounds = estimate["value"], estimate["ci95"]
    if value is None or not math.isfinite(value):
        return "not given"
    return f"{value:.2f} [{bounds[0]:.2f}, {bounds[1]:.2f}]"


def _first(v: Values) -> str:
    """The first effect, with those that are not told from it, and their probability."""
    names = v["first"][0] if len(v["first"]) == 1 else f"the class of {v['first'][0]}"
    return f"{names} has a probability of {v['probability']:.2f} if something is missing"


def _size(v: Values) -> str:
    unit = "" if v["unit"] == "1" else f" {v['unit']}"
    return (
        f"the size of {v['effect']} is not determined: its {v['parameter']} lies from "
        f"{v['low']:.3g} to {v['high']:.3g}{unit}"
    )


def _candidates(names: Sequence[str]) -> str:
    """The first four, and how many more."""
    if len(names) <= 4:
        return listed(names, "and")
    return f"{', '.join(names[:4])} and {len(names) - 4} more"
