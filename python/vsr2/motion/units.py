"""Units of recorded motions, and what they measure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, get_args

from vsr2.config.motion_source import RecordUnits
from vsr2.errors import MotionError

Quantity = Literal["displacement", "velocity", "acceleration"]

STANDARD_GRAVITY = 9.80665
"""The unit g of recorded accelerations and of PGA [m/s^2] (CGPM 1901); not the engine's gravity."""

UNITS: dict[str, tuple[Quantity, float]] = {
    "g": ("acceleration", STANDARD_GRAVITY),
    "m/s^2": ("acceleration", 1.0),
    "cm/s^2": ("acceleration", 0.01),
    "mm/s^2": ("acceleration", 0.001),
    "m/s": ("velocity", 1.0),
    "cm/s": ("velocity", 0.01),
    "mm/s": ("velocity", 0.001),
    "m": ("displacement", 1.0),
    "cm": ("displacement", 0.01),
    "mm": ("displacement", 0.001),
    "in": ("displacement", 0.0254),
}
"""Quantity of each unit, and its size in m, m/s or m/s^2."""

_NAMES = {"gal": "cm/s^2", "inch": "in"}
_PER_SECOND_SQUARED = re.compile(r"/s(?:/s|\*\*2|2)$")


def unit_in(text: str) -> str | None:
    """The unit that a header's word names, spelt as in `UNITS`; None: none we know."""
    word = text.strip().strip(".,;:()[]").lower()
    word = _PER_SECOND_SQUARED.sub("/s^2", word.replace("/sec", "/s"))
    word = _NAMES.get(word, word)
    return word if word in UNITS else None


def require_units(path: Path, kind: str, units: RecordUnits | None) -> tuple[Quantity, float]:
    """Quantity and size of the `units` given for a file whose format carries none.

    Raises:
        MotionError: none are given.
    """
    if units is None:
        raise MotionError(
            f"{path}: {kind}, which carries no units: give them, for example units='g' "
            "(in a study `motion.units: g`, on the command line `--units g`); known: "
            f"{', '.join(get_args(RecordUnits))}"
        )
    return UNITS[units]
