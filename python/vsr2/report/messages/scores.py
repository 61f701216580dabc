"""Words for the scores of a blind check."""

from __future__ import annotations

from collections.abc import Mapping

from vsr2.blind.scoring.score import ScoreCode as Code
from vsr2.report.messages.templates import check_worded

SCORES: Mapping[Code, str] = {
    Code.ANSWER: "most probable answer is the true class (single)",
    Code.LEADS: "true class leads all other effects (single)",
    Code.NAMED: "named rightly, in at most 3 classes (single)",
    Code.DETECTED: "gap detected (single)",
    Code.WRONG: "wrong among all named (single, none, unknown)",
    Code.NONE_NAMED: "named without a gap (none)",
    Code.NONE_SAID: "`none` is said (none)",
    Code.REFERENCE_NONE: "`none` is said (reference without effect)",
    Code.REFERENCE_EFFECTS: "named rightly (reference with effects)",
    Code.PAIR_NAMED: "both names right (pair)",
    Code.PAIR_WRONG: "wrong among all named (pair)",
    Code.UNKNOWN_SAID: "`unknown` is said (unknown)",
    Code.UNKNOWN_AUROC: "unknown: AUROC",
    Code.UNKNOWN_RATE: "unknown: rate at 5 % false alarms",
    Code.SET_COVERAGE: "90 % set: coverage",
    Code.SET_SIZE: "90 % set: median size",
    Code.LOG_SCORE: "log score, mean",
    Code.CALIBRATION: "calibration error",
    Code.CALIBRATION_NOISE: "calibration error of true probabilities",
    Code.ESTIMATED: "magnitude: estimated (single)",
    Code.ERROR: "magnitude: median relative error (single)",
    Code.INTERVAL: "magnitude: 90 % interval holds the truth (single)",
    Code.CLOSURE: "gap closed on motions not seen, median (single)",
    Code.HEADLINE: "the same less the better negative control, median (single)",
    Code.LOSS_FALLS: "loss on motions not seen falls beyond its interval (single)",
    Code.LOSS_RISES: "loss on motions not seen rises beyond its interval (single)",
    Code.WHERE_GAIN: "where: share of the effect over share of the trials, median (single)",
    Code.WHERE_TWICE: "where: at least twice its share (single)",
    Code.WHERE_AXIS: "where: axis found (single)",
    Code.WHERE_FALSE: "where: any location stands out (none)",
    Code.UNRESOLVED: "failed or unresolved",
}
check_worded(Code, SCORES, __name__)


def auroc_label(kind: str) -> str:
    """Of how well the overturn rate separates a kind of campaigns from single causes."""
    return f"AUROC, {kind} or single"
