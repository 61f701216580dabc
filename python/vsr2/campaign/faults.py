"""Why a value cannot be an id, a text or a number of a campaign."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import date

import numpy as np

from vsr2.campaign.columns import NUMBER_COLUMNS
from vsr2.config.problems import shown
from vsr2.errors import CampaignError
from vsr2.near_words import peak
from vsr2.one_line import counted

MAX_TEXT = 200
"""Of a name or a description [characters]."""
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}\Z")
_EXTRA = re.compile(r"x_[A-Za-z0-9][A-Za-z0-9._-]{0,99}\Z")


def id_fault(value: object) -> str | None:
    """Why `value` is no id (it names a file, too); None: it is one."""
    if isinstance(value, str) and _ID.match(value):
        return None
    if isinstance(value, (int, float, np.number, date)):
        return f"{shown(value)} is no id, as it is no text; put it in quotes, as it is written"
    return (
        f"{shown(value)} is no id: 1 to 100 letters, digits, `.`, `_` or `-`, the first a letter "
        "or digit; rename it"
    )


_PEAK_TILT = re.compile("peak.*tilt|tilt.*(max|peak|largest|greatest)")
"""What people put into names of their own for the largest tilt, in whatever unit."""


def extra_fault(value: object) -> str | None:
    """Why `value` is no name of an extra column; None: it is one."""
    if isinstance(value, str) and _EXTRA.match(value):
        meant = peak(value.removeprefix("x_").lower())
        if _PEAK_TILT.search(meant):
            meant = "peak_tilt_rad"
        if meant not in ("overturned", *NUMBER_COLUMNS.values()):
            return None
        return (
            f"{shown(value)} is an extra column, of which no diagnosis reads anything; call it "
            f"{meant}, or remove it"
        )
    return (
        f"{shown(value)} is no name of an extra column: `x_`, then letters, digits, `.`, `_` or "
        "`-`; rename it"
    )


def text_fault(value: object, *, limit: int = MAX_TEXT, empty: bool = False) -> str | None:
    """Why `value` cannot be a cell of text; None: it can."""
    if not isinstance(value, str):
        return f"{shown(value)} is no text"
    if not value:
        return None if empty else "is blank; fill it in"
    if len(value) > limit:
        return f"has {counted(len(value), 'character')}, at most {limit} are allowed; shorten it"
    if not value.isprintable() or value != value.strip():
        return f"{shown(value)} holds line breaks, outer blanks or control characters; remove them"
    return None


def number_fault(
    value: object, low: float, high: float, unit: str, *, above: bool = False
) -> str | None:
    """Why `value` is no number from `low` (excluded if `above`) to `high`; None: it is one."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return f"{shown(value)} is no number"
    if not math.isfinite(value):
        return f"is {value}; give a finite number, or leave it blank where it is unknown"
    if not (low < value if above else low <= value) or value > high:
        edge = "above" if above else "from"
        ends = f"{low:g} to {high:g}{f' {unit}' if unit else ''}"
        return f"is {value:g}, must lie {edge} {ends}; check sign and unit"
    return None


def refuse(owner: str, faults: Mapping[str, str | None]) -> None:
    """Refuse the first fault that there is.

    Args:
        owner: of the values.
        faults: by key; None: there is none.

    Raises:
        CampaignError: names owner, key and fault.
    """
    for key, fault in faults.items():
        if fault is not None:
            raise CampaignError(f"{key}: {fault}", key=owner)
