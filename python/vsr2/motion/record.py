"""One recording, whatever the file it came from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.errors import MotionError
from vsr2.motion.motion import Array
from vsr2.motion.resample import MIN_RECORD_SAMPLES
from vsr2.motion.samples import samples_of
from vsr2.motion.units import Quantity
from vsr2.one_line import OneLine, counted
from vsr2.read_only import ReadOnlyArrays

MAX_DISPLACEMENT = 1000.0
"""[m]; more is a mistaken unit."""
MAX_VELOCITY = 1.0e4
"""[m/s]; more is a mistaken unit."""
MAX_ACCELERATION = 1.0e5
"""[m/s^2]; more is a mistaken unit."""
MIN_INTERVAL, MAX_INTERVAL = 1.0e-6, 1.0
"""Bounds of the sampling interval [s]."""


@checked_names(MotionError)
@dataclass(frozen=True, eq=False, repr=False)
class Record(ReadOnlyArrays, OneLine):
    """A recorded horizontal motion at its own sampling interval.

    Attributes:
        name: the file's name without its suffix, or any other.
        sample_interval: [s].
        displacement: shape (n,) [m], or None; as recorded, offset included.
        velocity: shape (n,) [m/s], or None.
        acceleration: shape (n,) [m/s^2], or None; positive along the displacement.
        source: the file it came from.
        sha256: hash of that file's bytes.

    The arrays are copies and read-only.

    Raises:
        MotionError: no channel; lengths differ; fewer than 16 or more than `MAX_SAMPLES` samples;
            NaN, infinity or an absurd value; a sampling interval outside 1e-6 to 1 s.
    """

    name: str
    sample_interval: float
    displacement: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    source: str = ""
    sha256: str = ""

    @property
    def facts(self) -> Mapping[str, object]:
        """What the notation in one line shows."""
        channels = ("displacement", "velocity", "acceleration")
        given = [name for name in channels if getattr(self, name) is not None]
        return {
            "name": self.name,
            "channels": given,
            "samples": getattr(self, given[0]).size,
            "sample_interval_s": self.sample_interval,
        }

    def __post_init__(self) -> None:
        if not MIN_INTERVAL <= self.sample_interval <= MAX_INTERVAL:
            raise MotionError(
                f"sampling interval {self.sample_interval:g} s lies outside "
                f"{MIN_INTERVAL:g} to {MAX_INTERVAL:g} s; check the unit of time",
                file=self.label,
            )
        sizes = {}
        for field, unit, limit in (
            ("displacement", "m", MAX_DISPLACEMENT),
            ("velocity", "m/s", MAX_VELOCITY),
            ("acceleration", "m/s^2", MAX_ACCELERATION),
        ):
            if getattr(self, field) is not None:
                value = self._checked(field, unit, limit)
                object.__setattr__(self, field, value)
                sizes[field] = value.size
        if not sizes:
            raise MotionError(
                "has neither displacement nor acceleration nor velocity", file=self.label
            )
        if len(set(sizes.values())) > 1:
            counts = ", ".join(f"{field} has {size} samples" for field, size in sizes.items())
            raise MotionError(f"{counts}; they must have the same number", file=self.label)

    def _checked(self, field: str, unit: str, limit: float) -> Array:
        value = samples_of(getattr(self, field), field, fewest=MIN_RECORD_SAMPLES, file=self.label)
        bad = np.flatnonzero(~(np.abs(value) <= limit))
        if bad.size:
            beyond, remedy = "", "repair or cut the record"
            if np.isfinite(value[bad[0]]):
                beyond, remedy = f", beyond {limit:g} {unit}", "check the unit"
            raise MotionError(
                f"{field} is {value[bad[0]]:g} {unit} at sample {bad[0]} "
                f"(t = {bad[0] * self.sample_interval:g} s){beyond}; "
                f"{counted(bad.size, 'such sample')}; {remedy}",
                file=self.label,
            )
        return value

    @property
    def label(self) -> str:
        """The file, or the name where there is none; for messages."""
        return self.source or f"record {self.name!r}"

    def lacking(self, channel: str) -> str | None:
        """A channel that driving by `channel` needs and the record lacks; None: it has all."""
        needed = ("displacement", "acceleration") if channel == "fused" else (channel,)
        return next((name for name in needed if getattr(self, name) is None), None)

    @property
    def channels(self) -> dict[Quantity, Array]:
        """Those that were recorded, displacement first, acceleration last."""
        names: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def size(self) -> int:
        """Number of samples."""
        return next(iter(self.channels.values())).size

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return (self.size - 1) * self.sample_interval


def file_record(
    path: Path, content: bytes, sample_interval: float, channels: Mapping[str, Array | None]
) -> Record:
    """The record of a file.

    Args:
        path: the file.
        content: its bytes.
        sample_interval: [s].
        channels: "displacement" (n,) [m], "velocity" (n,) [m/s], "acceleration" (n,) [m/s^2], or
            some of them.

    Raises:
        MotionError: as :class:`Record`.
    """
    return Record(
        path.stem,
        sample_interval,
        **channels,
        source=str(path),
        sha256=hashlib.sha256(content).hexdigest(),
    )
