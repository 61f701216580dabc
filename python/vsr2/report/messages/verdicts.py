"""Sentences about a diagnosis: the one module that words its codes and values.

The templates stand in `verdicts.toml`. All functions read the content of `diagnosis.json`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from vsr2.codes import TIERS
from vsr2.diagnosis.verdict.next_measurement import Instrument, MeasurementKind
from vsr2.diagnosis.verdict.statements import LimitCode, ReasonCode, VerdictKind
from vsr2.diagnosis.where.scan import LocationKind
from vsr2.ensemble.observed.features import FeatureChannel, Phase
from vsr2.ensemble.simulated.library import NONE, UNKNOWN
from vsr2.errors import Fault, ResultError
from vsr2.report.messages.templates import NO_BOUNDS, check_worded, written
from vsr2.report.pages import environment, listed, plain

if TYPE_CHECKING:
    from jinja2 import Template


_SECTIONS: Mapping[str, Mapping[str, str]] = tomllib.loads(
    files("vsr2.report.messages").joinpath("verdicts.toml").read_text(encoding="utf-8")
)
_CODES: Mapping[str, Iterable[str]] = {
    "reasons": ReasonCode,
    "limits": LimitCode,
    "faults": Fault,
    "instruments": Instrument,
    "verdicts": VerdictKind,
    "closes": [kind for kind in VerdictKind if kind.names_effects],
    "locations": LocationKind,
    "phases": Phase,
    "missing": TIERS,
}
"""What sections of `verdicts.toml` word."""
for _section, _codes in _CODES.items():
    check_worded(_codes, _SECTIONS[_section], f"report/messages/verdicts.toml: [{_section}]")


@cache
def _templates() -> dict[tuple[str, str], Template]:
    """By section and key of `verdicts.toml`."""
    made = environment(
        {
            "candidates": _candidates,
            "fault": lambda fault: _say("faults", fault),
            "interval": interval,
            "location": location,
            "number": written,
            "small_probability": _small_probability,
            "say": lambda key, section: _say(section, key),
            "unit": _unit,
        }
    )
    return {
        (section, key): made.from_string(template)
        for section, templates in _SECTIONS.items()
        for key, template in templates.items()
    }


def _small_probability(value: float) -> str:
    """Two digits; what is smaller than an estimate can tell is below a thousandth."""
    return f"{value:.2g}" if value >= 0.001 else "below 0.001"


def _say(section: str, key: str, **values: Any) -> str:
    template = _templates().get((section, key))
    if template is None:
        raise ResultError(
            f"{key!r} is none of the {section} that this version words; read the diagnosis with "
            "the version that wrote it, or diagnose again"
        )
    return template.render(values)


def sentence(statement: Mapping[str, Any]) -> str:
    """A reason or a limit, with its code and values.

    Raises:
        ResultError: a code that this version does not know.
    """
    code = str(statement["code"])
    section = "reasons" if ("reasons", code) in _templates() else "limits"
    # `none`, a name of some values, is a constant to a template.
    return _say(section, code, values=statement["values"], **statement["values"])


def instrument(code: str) -> str:
    """What to do with an instrument."""
    return _say("instruments", str(code))


def next_measurement(measure: Mapping[str, Any]) -> str:
    """What to measure next."""
    word = "; and " if measure["kind"] == MeasurementKind.BOTH else "; or "
    own = word.join(instrument(code) for code in measure["instruments"])
    return _say("notes", "next_measurement", own=own, **measure)


def phase(code: str) -> str:
    """Part of the response, or of the motion."""
    return _say("phases", str(code))


def location(row: Mapping[str, Any]) -> str:
    """A location of the gap, with the feature where that is not the outcome."""
    feature = "" if row["channel"] == FeatureChannel.OUTCOME else f"{plain(row['feature'])}: "
    return feature + _say("locations", row["location"]["kind"], **row["location"])


def noise_floor(layers: Mapping[str, Any]) -> list[str]:
    """What is changed in each layer of the noise floor that is known, and its share."""
    return [
        f"{_say('layers', name)}: {written(layers[name], '.1%')}"
        for section, name in _templates()
        if section == "layers" and layers.get(name) is not None
    ]


def standing_out(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Locations that hold more than their share of the effect: the only ones to be named."""
    return [row for row in content["where"] if row["trials"] is not None]


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in one sentence."""
    verdict, gap = content["verdict"], content["gap"]
    named, reasons = verdict["effects"], [reason["code"] for reason in verdict["reasons"]]
    said = _say(
        "verdicts",
        verdict["kind"],
        names=[plain(name) for name in named],
        findings=[" or ".join(plain(name) for name in one) for one in verdict["findings"]],
        chance=written(verdict["probability"], ".0%")
        if verdict["probability"] < 0.995
        else "over 99 %",
        alike=ReasonCode.EQUIVALENT_HERE in reasons,
        found=standing_out(content),
        **content,
    )
    if not VerdictKind(verdict["kind"]).names_effects:
        return said
    closed = gap["closure"]["value"]
    ends = [gap[name]["ci95"] for name in ("headline", "closure")]
    sure = closed is not None and all(one is not None and one[0] > 0 for one in ends)
    kind = verdict["kind"]
    return _say("closing", "sure" if sure else "unsure", said=said, kind=kind, closed=closed)


def corrected_note(content: Mapping[str, Any]) -> str:
    """What the corrected scene holds; empty where nothing is named."""
    corrected = content["corrected"]
    if corrected is None:
        return ""
    stated = [
        f"{plain(name)} ({', '.join(f'{key} {shown(value)}' for key, value in values.items())})"
        for name, values in corrected["effects"].items()
    ]
    among = corrected["among"] if len(corrected["among"]) > len(stated) else []
    known = corrected["scene"] is not None
    return _say(
        "notes", "corrected", stated=stated if known else [], among=among,
        names=list(corrected["effects"]),
    )  # fmt: skip


def shown(value: float | str) -> str:
    """A number to three digits, or a word."""
    return value if isinstance(value, str) else f"{value:.3g}"


def figure_caption(name: str) -> str:
    """What a figure of the page shows."""
    return _say("figures", name)


def nothing_found_note(content: Mapping[str, Any]) -> str:
    """What the numbers mean where no gap is found; empty where one is."""
    if VerdictKind(content["verdict"]["kind"]) is not VerdictKind.NONE:
        return ""
    before, floor = content["gap"]["before"]["value"], content["gap"]["floor"]["value"]
    others = sum(name not in (NONE, UNKNOWN) for name in content["conformal_set_90"])
    known = before is not None and floor is not None
    return _say("notes", "nothing_found", others=others, below=known and before < floor)


def closure_note(content: Mapping[str, Any]) -> str:
    """What the closures say, beside the figure of losses."""
    return _say("notes", "closure", **content)


def channels_note(content: Mapping[str, Any]) -> str:
    """What other channels would show, and how the shake table was checked."""
    return _say("notes", "channels", **content)


def waterfall_note(content: Mapping[str, Any]) -> str:
    """What each cause takes off the loss; empty: they were not judged one by one."""
    return _say("notes", "waterfall", **content) if content["waterfall"] else ""


def with_sentences(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with a `text` beside every code, location and measurement, and the verdict."""

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
        "where": [{**row, "text": location(row)} for row in content["where"]],
        "limits": worded(content["limits"]),
        "next_measurement": measure and {**measure, "text": next_measurement(measure)},
    }


def interval(estimate: Mapping[str, Any]) -> str:
    """Value and 95 % interval."""
    value, bounds = estimate["value"], estimate["ci95"]
    if value is None or not math.isfinite(value):
        return "not given"
    if bounds is None:
        return f"{value:.2f} {NO_BOUNDS}"
    return f"{value:.2f} [{bounds[0]:.2f}, {bounds[1]:.2f}]"


def parameters(effect: Mapping[str, Any]) -> list[str]:
    """Median and 90 % interval of each parameter, given that its effect acts."""
    return [
        f"{name} {found['median']:.3g} [{found['ci90'][0]:.3g}, {found['ci90'][1]:.3g}]"
        + _unit(found["unit"])
        for name, found in effect["parameters"].items()
    ]


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _candidates(names: Sequence[str]) -> str:
    """The first four, and how many more."""
    if len(names) <= 4:
        return listed(names, "and")
    return f"{', '.join(names[:4])} and {len(names) - 4} more"
