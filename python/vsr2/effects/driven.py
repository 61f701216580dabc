"""A trial under another motion of its table, and what effects on the motion have in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vsr2.effects.oscillator import Array, Path, held
from vsr2.motion import SideMotion
from vsr2.motion.resample import Resampled
from vsr2.motion.samples import Deferred
from vsr2.trial import Trial


def driven(
    trial: Trial,
    path: Path,
    note: str,
    beside: Callable[[SideMotion], SideMotion] = lambda side: side,
) -> Trial:
    """The trial under another path, all directions brought to rest at the last sample.

    Args:
        trial: to change.
        path: along x, in place of the motion's.
        note: what was done, for the motion's source.
        beside: what is done to the motions beside x.
    """
    motion = trial.motion
    sides = {name: beside(side) for name, side in motion.sides.items() if side is not None}
    rates = path.velocity, *(side.velocity for side in sides.values())
    moving = any(rate[-1] != 0 for rate in rates)
    size = path.displacement.size + (moving or not _at_rest(path))
    more = held(path, size - path.displacement.size)
    displacement = more.displacement - more.displacement[0]
    for samples in (displacement, more.velocity):
        samples.setflags(write=False)  # Nobody else has them; a motion copies what can be written.
    changed: dict[str, Any] = {name: held_side(side, size) for name, side in sides.items()} | {
        "displacement": displacement,
        "velocity": more.velocity,
        "acceleration": Deferred(lambda: more.acceleration),
        "source": f"{motion.source}; {note}",
        # From here on the record no longer tells the motion.
        "recorded": None,
    }
    return trial.under(replace(motion, **changed))


def _at_rest(path: Path) -> bool:
    """Whether the acceleration is 0 at the last sample; what is resampled ends so."""
    return isinstance(path, Resampled) or bool(path.acceleration[-1] == 0)


def held_side(side: SideMotion, size: int) -> SideMotion:
    """The motion continued to `size` samples, at rest at its last displacement."""
    more = (0, size - side.displacement.size)
    return SideMotion(np.pad(side.displacement, more, mode="edge"), np.pad(side.velocity, more))


def delayed(signal: Array, count: int) -> Array:
    """The signal after `count` samples of rest at 0, shape (n + count,) of (n,)."""
    return np.pad(signal, (count, 0))


def delayed_side(side: SideMotion, count: int) -> SideMotion:
    """The motion after `count` samples of rest."""
    return SideMotion(delayed(side.displacement, count), delayed(side.velocity, count))


def half_passed(one: float, other: float, power: int) -> float:
    """Corner of a low-pass where two in a row pass half of what they would without a corner.

    Each passes 1 / (1 + (f / corner)^power), of the amplitude or of the power.

    Args:
        one: corner [Hz]; infinite: none.
        other: corner of the second [Hz].
        power: of the frequency over the corner.
    """
    if math.isinf(one) or math.isinf(other):
        return min(one, other)
    # (1 + x) (1 + r x) = 2 with x = (f / one)^power, r = (one / other)^power.
    ratio = (one / other) ** power
    x = 2 / (1 + ratio + math.sqrt((1 + ratio) ** 2 + 4 * ratio))
    return float(one * x ** (1 / power))
