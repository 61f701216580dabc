"""How far a diagnosis is, line by line."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping

from vsr2.ensemble.execution import Progress, Stage, Turn
from vsr2.report.messages.templates import check_worded

STAGES: Mapping[Stage, str] = {
    Stage.LOOK: "trying effects",
    Stage.SIMULATION: "simulating",
    Stage.TRAINING: "training",
    Stage.JUDGEMENT: "judging",
    Stage.WATERFALL: "judging causes one by one",
    Stage.MARGINS: "seeking margins",
    Stage.TIME_STEP: "choosing the time step",
    Stage.INFERENCE: "inferring what acts",
    Stage.PLANTED: "planting campaigns",
}
check_worded(Stage, STAGES, __name__)


class ProgressLines:
    """Writes how far a diagnosis is to standard error, at most two lines a second.

    Args:
        verb: of the command line that is under way.
    """

    def __init__(self, verb: str = "diagnose") -> None:
        self._verb = verb
        self._last = 0.0
        self._stage: tuple[Turn | None, Stage] | None = None
        self._began = 0.0

    def __call__(self, progress: Progress) -> None:
        """Write a line, if it is time for one."""
        now, share, turn = time.monotonic(), progress.share, progress.turn
        stage = (turn, progress.stage)
        if stage == self._stage and now - self._last < 0.5 and share < 1:
            return
        if stage != self._stage:
            self._began = now
        self._last, self._stage = now, stage
        best = ", ".join(f"{name} {p:.2f}" for name, p in progress.leading.items())
        left = ""
        if progress.left_s <= 0:
            left = ", past its budget"
        elif not math.isnan(progress.left_s):
            left = f", {_duration(progress.left_s)} left"
        elif 0 < share < 1 and now > self._began:
            left = f", {_duration((now - self._began) * (1 - share) / share)} left of this"
        leading = f"; leading: {best}" if best else ""
        which = f"{turn.campaign} {turn.tier} ({turn.number} of {turn.of}): " if turn else ""
        line = f"vsr2 {self._verb}: {which}{STAGES[progress.stage]} {share:4.0%}{left}{leading}"
        end = "\n" if share >= 1 or not sys.stderr.isatty() else "\r"
        print(f"{line:<100}", end=end, file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
