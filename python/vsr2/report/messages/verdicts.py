"""Sentences about a diagnosis: the one module that words its codes and values.

The templates stand in `verdicts.toml`. All functions read the content of `diagnosis.json`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from vsr2.diagnosis.verdict.next_measurement import MeasurementKind
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.diagnosis.where.scan import SCAN
from vsr2.report.pages import environment, listed, plain

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def _templates() -> dict[tuple[str, str], Template]:
    """By table and key of `verdicts.toml`."""
    text = files("vsr2.report.messages").joinpath("verdicts.toml").read_text(encoding="utf-8")
    made = environment(
        {
            "candidates": _candidates,
            "class_of": _class_of,
            "interval": interval,
            "location": location,
            "number": format,
            "say": lambda key, table: _say(table, key),
            "unit": lambda unit: "" if unit == "1" else f" {unit}",
        }
    )
    return {
        (table, key): made.from_string(template)
        for table, templates in tomllib.loads(text).items()
        for key, template in templates.items()
    }


def _say(table: str, key: str, **values: Any) -> str:
    return _templates()[table, key].render(values)


def sentence(statement: Mapping[str, Any]) -> str:
    """A reason or a limit, with its code and values."""
    code = str(statement["code"])
    table = "reasons" if ("reasons", code) in _templates() else "limits"
    # `none`, a name of some values, is a constant to a template.
    return _say(table, code, values=statement["values"], **statement["values"])


def instrument(code: str) -> str:
    """What to do with an instrument."""
    return _say("instruments", str(code))


def next_measurement(measure: Mapping[str, Any]) -> str:
    """What to measure next."""
    word = "; and " if measure["kind"] == MeasurementKind.BOTH else "; or "
    own = word.join(instrument(code) for code in measure["instruments"])
    return _say("notes", "next_measurement", own=own, **measure)


def location(row: Mapping[str, Any]) -> str:
    """A location of the gap, with the feature where that is not the outcome."""
    feature = "" if row["channel"] == "outcome" else f"{row['feature']}: "
    return feature + str(row["location"])


def verdict_sentence(content: Mapping[str, Any]) -> str:
    """The verdict in one sentence."""
    verdict, gap = content["verdict"], content["gap"]
    named = verdict["effects"]
    said = _say(
        "verdicts",
        verdict["kind"],
        names=[plain(name) for name in named],
        chance=f"{verdict['probability']:.0%}" if verdict["probability"] < 0.995 else "over 99%",
        several_classes=len({r["class"] for r in content["effects"] if r["name"] in named}) != 1,
        significant=[row for row in content["where"] if row["p_familywise"] <= SCAN.significant],
        **content,
    )
    if verdict["kind"] not in (VerdictKind.EFFECT, VerdictKind.CLASS, VerdictKind.PAIR):
        return said
    sure = gap["headline"]["ci95"][0] > 0 and gap["closure"]["ci95"][0] > 0
    closed = gap["closure"]["value"]
    return _say("closing", "sure" if sure else "unsure", said=said, closed=closed)


def closure_note(content: Mapping[str, Any]) -> str:
    """What the closures say, beside the figure of losses."""
    return _say("notes", "closure", **content)


def channels_note(content: Mapping[str, Any]) -> str:
    """What other channels would show, and how the table was checked."""
    return _say("notes", "channels", **content)


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


def _class_of(names: Sequence[str]) -> str:
    """The first effect, with those that are equivalent to it."""
    return names[0] if len(names) == 1 else f"the class of {names[0]}"


def _candidates(names: Sequence[str]) -> str:
    """The first four, and how many more."""
    if len(names) <= 4:
        return listed(names, "and")
    return f"{', '.join(names[:4])} and {len(names) - 4} more"
