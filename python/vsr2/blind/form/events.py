"""What happens while packs are made, diagnosed and scored, as codes with values."""

from __future__ import annotations

from collections.abc import Callable

from vsr2.codes import Code, Statement


class EventCode(Code):
    """What happens; `vsr2.report.messages.blind_packs` words it."""

    AMPLITUDES = "amplitudes", {"engine": str, "motions": int}
    DETECTION_LIMIT = (
        "detection_limit",
        {"engine": str, "effect": str, "sign": int, "limit": float},
    )
    SIGNAL = "signal", {"engine": str, "effect": str}
    CAMPAIGN = "campaign", {"number": int, "of": int}
    CHECKING = "checking", {"due": int, "of": int}
    EXCLUDED_ANYWAY = "excluded_anyway", {"campaign": str, "effect": str}
    DIAGNOSED = "diagnosed", {"campaign": str, "tier": str, "verdict": str}
    FAILED = "failed", {"campaign": str, "tier": str, "cause": str, "message": str}
    OPENED = "opened", {"key": str}


Say = Callable[[Statement], None]
"""Gets each event."""


def unheard(event: Statement) -> None:
    """Takes no notice of an event."""
