"""Ground motions from arrays of samples, without a file."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from vsr2.argument_names import checked_names
from vsr2.config.motion_source import Filter, RecordUnits
from vsr2.config.problems import shown
from vsr2.config.section import DEFAULT_TIME_STEP
from vsr2.errors import MotionError
from vsr2.motion.motion import Motion
from vsr2.motion.record import Record
from vsr2.motion.resample import MIN_RECORD_SAMPLES
from vsr2.motion.samples import samples_of
from vsr2.motion.study_motions import build_recorded_motion, warn_of_unusual_pga
from vsr2.motion.units import UNITS, unit_in


def require_acceleration(units: object, name: str) -> None:
    """Refuse units that are not those of an acceleration.

    Args:
        units: as they were given.
        name: of the motion, for the error.

    Raises:
        MotionError: names them, those that serve, and what takes others.
    """
    unit = unit_in(units) if isinstance(units, str) else None
    if unit is not None and UNITS[unit][0] == "acceleration":
        return
    known = ", ".join(one for one, (quantity, _) in UNITS.items() if quantity == "acceleration")
    what = "not known"
    if unit is not None:
        what = f"those of a {UNITS[unit][0]}, which vsr2.motion.from_signal takes"
    raise MotionError(
        f"motion {name!r}: units {shown(units)} are {what}; of an acceleration use one of {known}"
    )


@checked_names(MotionError, {"dt": "interval"})
def from_signal(
    signal: ArrayLike,
    interval: float,
    units: RecordUnits = "g",
    *,
    time_step: float = DEFAULT_TIME_STEP,
    filter: Filter | None = None,
    baseline: int | None = None,
    name: str = "record",
) -> Motion:
    """The motion that a recorded signal asks of the pedestal.

    The units say what it is: an acceleration (`g`, `m/s^2`, ...), a velocity or a displacement.

    Args:
        signal: shape (n,) [`units`].
        interval: between samples [s].
        units: of the samples.
        time_step: of the simulation that follows [s].
        filter: band-pass at the record's own sampling; None: none.
        baseline: degree of a polynomial to take off first; None: none.
        name: of the motion.

    Raises:
        MotionError: unknown units, or what :class:`Record` refuses.

    Warns:
        MotionWarning: a PGA above 3 g.
    """
    unit = unit_in(units) if isinstance(units, str) else None
    if unit is None:
        raise MotionError(
            f"motion {name!r}: units {shown(units)} are not known; use one of {', '.join(UNITS)}"
        )
    quantity, size = UNITS[unit]
    values = samples_of(signal, f"motion {name!r}: {quantity}", fewest=MIN_RECORD_SAMPLES)
    channels: dict[str, Any] = {quantity: size * values}
    record = Record(name, interval, **channels)
    motion = build_recorded_motion(
        record, time_step, channel=quantity, filter=filter, baseline=baseline, name=name
    )
    warn_of_unusual_pga([(motion.name, motion.pga_g)])
    return motion
