"""Fields of a motion beside its samples: of which types they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vsr2.errors import MotionError
from vsr2.motion.samples import number_of

if TYPE_CHECKING:
    from vsr2.motion.motion import Motion

KINDS = ("cosine", "recording")
_NUMBERS = {"time_step": "s", "resampling_error": "m", "resampling_error_rms": "m"}
"""Fields that are numbers, with their unit."""


def check_fields(motion: Motion) -> None:
    """Refuse a name, kind, source or record of another type, and make numbers Python's own.

    Raises:
        MotionError: names the field.
    """
    for text in ("name", "source"):
        given = getattr(motion, text)
        if not isinstance(given, str):
            label = "motion" if text == "name" else f"motion {motion.name!r}"
            raise MotionError(f"{label}: {text} must be text (is of type {type(given).__name__})")
    if motion.kind not in KINDS:
        raise MotionError(
            f"motion {motion.name!r}: kind must be {' or '.join(KINDS)} (is {motion.kind!r})"
        )
    for field, unit in _NUMBERS.items():
        what, positive = f"motion {motion.name!r}: {field}", field == "time_step"
        number = number_of(getattr(motion, field), what, unit, positive=positive)
        object.__setattr__(motion, field, number)
    if motion.recorded is not None:
        from vsr2.motion.study_motions import Recorded

        if not isinstance(motion.recorded, Recorded):
            raise MotionError(
                f"motion {motion.name!r}: recorded must be a vsr2.motion.Recorded or None (is of "
                f"type {type(motion.recorded).__name__})"
            )
