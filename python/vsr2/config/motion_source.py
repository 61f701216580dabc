"""The study's ground motion: its four modes (supplement S1.3)."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self, get_args

from pydantic import AfterValidator, Field, Strict, model_validator

from vsr2.config.section import FilePath, NonNegative, Positive, Scale, Section
from vsr2.config.sources import BAND_PASS, NEUTRAL

RecordUnits = Literal[
    "g", "m/s^2", "cm/s^2", "mm/s^2", "m/s", "cm/s", "mm/s", "m", "cm", "mm", "in"
]

DriveMode = Literal["motor", "prescribed"]
DRIVE_MODES: tuple[DriveMode, ...] = get_args(DriveMode)
"""How the pedestal follows its set-points, in studies and trials."""

MAX_VALUES = 100_000
"""Most values of one axis of a grid."""
MAX_GRID_TRIALS = 1_000_000
"""Of a grid of cosines."""
MIN_STEPS_A_PERIOD = 10
"""Time steps a period of a cosine has at least, so that its samples show it."""


class Range(Section):
    """`min`, `min + step`, ... up to and including `max` (within half a millionth of a step)."""

    min: Positive
    """First value."""
    max: Positive
    """Last value, where the steps reach it."""
    step: Positive
    """Spacing."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max < self.min:
            raise ValueError(f"max ({self.max}) is below min ({self.min})")
        if (self.max - self.min) / self.step > MAX_VALUES:
            raise ValueError(f"more than {MAX_VALUES} values; raise `step`")
        return self

    @property
    def count(self) -> int:
        """Number of values."""
        return math.floor((self.max - self.min) / self.step + 5e-7) + 1


class _Driven(Section):
    drive: DriveMode = "prescribed"
    """`motor`: Bullet's joint motor follows the set-points (the original; lags); `prescribed`: the
    pedestal moves exactly as commanded."""


class SingleCosine(_Driven):
    """x(t) = A (1 - cos 2 pi F t), one period (S1.3). Give A and F, or PGA and PGV/PGA."""

    mode: Literal["single_cosine"]
    amplitude: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """A, half the peak displacement [m]."""
    frequency: Annotated[float, Strict(), Field(ge=1e-3, le=1e3)] | None = None
    """F [Hz]."""
    pga_g: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """Peak ground acceleration [g]."""
    pgv_pga_s: Annotated[float, Strict(), Field(gt=0, le=100)] | None = None
    """PGV/PGA, which is 1 / (2 pi F) [s]."""

    @model_validator(mode="after")
    def _one_parametrisation(self) -> Self:
        by_af = self.amplitude is not None and self.frequency is not None
        by_im = self.pga_g is not None and self.pgv_pga_s is not None
        given = sum(
            v is not None for v in (self.amplitude, self.frequency, self.pga_g, self.pgv_pga_s)
        )
        if given != 2 or by_af == by_im:
            raise ValueError("give `amplitude` and `frequency`, or `pga_g` and `pgv_pga_s`")
        return self


class GridCosine(_Driven):
    """Single cosines over a grid of PGA and PGV/PGA (S1.3)."""

    mode: Literal["grid_cosine"]
    pga_g: Range
    """Peak ground accelerations [g]; at most 100."""
    pgv_pga_s: Range
    """Ratios PGV/PGA [s]; at most 100."""

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        for key in ("pga_g", "pgv_pga_s"):
            if getattr(self, key).max > 100:
                raise ValueError(f"{key}.max is above 100; check its unit")
        if self.pga_g.count * self.pgv_pga_s.count > MAX_GRID_TRIALS:
            raise ValueError(
                f"{self.pga_g.count} x {self.pgv_pga_s.count} trials are more than "
                f"{MAX_GRID_TRIALS}; raise `step`"
            )
        return self


Channel = Literal["auto", "displacement", "velocity", "acceleration", "fused"]
"""What of a recording drives the pedestal."""


class Filter(Section):
    """Zero-phase Butterworth band-pass applied to the recording at its own sampling."""

    low: Annotated[NonNegative, BAND_PASS] = 0.1
    """Lower corner [Hz]; 0: none."""
    high: Annotated[Positive, BAND_PASS] = 25.0
    """Upper corner [Hz]."""
    order: Annotated[int, Strict(), Field(ge=1, le=10), BAND_PASS] = 3
    """Order of the filter, run forward and backward."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise ValueError(f"low ({self.low} Hz) must be below high ({self.high} Hz)")
        return self


class _Recorded(_Driven):
    channel: Channel = "auto"
    """Which recorded channel drives the pedestal; `auto`: displacement where there is one, else
    velocity, else acceleration; `fused`: displacement and acceleration together, each weighted by
    its noise."""
    units: RecordUnits | None = None
    """Of recordings in a format that carries none (text in columns, the original's `.tab`,
    miniSEED, SAC); for other formats it is refused."""
    filter: Filter | None = None
    """Band-pass before use; none given: the recording as it is."""
    scale: Annotated[Scale, NEUTRAL] = 1.0
    """Factor on the motion."""


class SingleRecording(_Recorded):
    """One recording."""

    mode: Literal["single_recording"]
    file: FilePath
    """The recording."""


def _file_name_pattern(value: str) -> str:
    if "/" in value or "\\" in value or "\0" in value:
        raise ValueError("is matched against file names; name the folder in `folder`")
    return value


class AllRecordings(_Recorded):
    """Every recording of a folder."""

    mode: Literal["all_recordings"]
    folder: FilePath
    """Folder with the recordings; its subfolders are not searched."""
    pattern: Annotated[
        str, Field(min_length=1, max_length=200), AfterValidator(_file_name_pattern)
    ] = "*"
    """Glob over the file names; all matches in order of name."""


MotionSource = Annotated[
    SingleCosine | GridCosine | SingleRecording | AllRecordings, Field(discriminator="mode")
]


def shortest_period(
    motion: SingleCosine | GridCosine | SingleRecording | AllRecordings,
) -> float | None:
    """Shortest period of a cosine motion [s], from PGV/PGA = 1 / (2 pi F); none for recordings."""
    if isinstance(motion, GridCosine):
        return 2 * math.pi * motion.pgv_pga_s.min
    if isinstance(motion, SingleCosine):
        if motion.frequency is not None:
            return 1 / motion.frequency
        if motion.pgv_pga_s is not None:
            return 2 * math.pi * motion.pgv_pga_s
    return None
