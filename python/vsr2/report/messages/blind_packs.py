"""Sentences about blind packs: what happens to them, and what was made and diagnosed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from vsr2.blind.form.diagnosis_form import FailureCode
from vsr2.blind.form.events import EventCode
from vsr2.report.messages.templates import check_worded, filled_in

if TYPE_CHECKING:
    from vsr2.blind.custodian.pack_making import Made
    from vsr2.blind.pack_diagnoses import PackOutcome
    from vsr2.codes import Statement

EVENTS: Mapping[str, str] = {
    EventCode.AMPLITUDES: "{engine}: amplitudes of {motions} motions",
    EventCode.DETECTION_LIMIT: "detection limit of {engine} {effect} {sign:+d}: {limit:.3g}",
    EventCode.SIGNAL: "{engine}: measuring the signal of a draw of {effect}",
    EventCode.CAMPAIGN: "campaign {number} of {of}",
    EventCode.CHECKING: "checking {due} of {of} campaigns and tiers; the others are diagnosed",
    EventCode.EXCLUDED_ANYWAY: (
        "{campaign}: exclude names {effect!r}, which the library lacks anyway"
    ),
    EventCode.DIAGNOSED: "{campaign} {tier}: {verdict}",
    EventCode.FAILED: "{campaign} {tier}: failed: {cause}: {message}",
    EventCode.OPENED: "{key}: opened, and all that it seals found right",
}
"""Templates of the values."""
check_worded(EventCode, EVENTS, __name__)
FAILURES: Mapping[str, str] = {
    FailureCode.CAMPAIGN_UNUSABLE: "the campaign cannot be used",
    FailureCode.DIAGNOSIS_ENDED: "the diagnosis ended with an error",
    FailureCode.DIAGNOSIS_UNREADABLE: "the diagnosis cannot be scored",
}
check_worded(FailureCode, FAILURES, __name__)


def event_text(event: Statement) -> str:
    """What happened: a line."""
    values = dict(event.values)
    if event.code is EventCode.FAILED:
        values["cause"] = FAILURES[values["cause"]]
    return filled_in(EVENTS[event.code], values)


def diagnosed_pack(progress: PackOutcome, out: Path) -> str:
    """How many diagnoses there are, and how many failed."""
    return f"{out}: {progress.done} diagnoses, {len(progress.failed)} failed"


def sealed_pack(made: Made, pack: Path) -> str:
    """What a blind pack holds, and which effects were not drawn: lines."""
    lines = [f"{pack / 'data'}: {made.campaigns} campaigns, sealed as {made.commitment}"]
    lines += [
        f"{engine}: no magnitudes from 0.5 to 6 detection limits, not drawn: {', '.join(effects)}"
        for engine, effects in made.not_drawn.items()
        if effects
    ]
    for engine, refused in made.refused.items():
        if refused:
            counts = ", ".join(f"{name} ({count})" for name, count in refused.items())
            lines.append(
                f"{engine}: every draw measured outside 0.5 to 6 detection limits, not drawn for "
                f"so many campaigns: {counts}"
            )
    return "\n".join(lines)
