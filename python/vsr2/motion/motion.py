"""The ground motion: one type for cosine pulses, recordings, and what a table really did."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsr2.argument_names import checked_names
from vsr2.config.motion_source import Filter, RecordUnits
from vsr2.config.section import DEFAULT_TIME_STEP
from vsr2.errors import MotionError, Renamed
from vsr2.motion.channel_agreement import check_acceleration, check_displacement
from vsr2.motion.motion_fields import check_fields
from vsr2.motion.samples import Deferred, samples_of
from vsr2.motion.units import STANDARD_GRAVITY
from vsr2.one_line import OneLine, counted
from vsr2.read_only import ReadOnlyArrays

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vsr2.motion.study_motions import Recorded

Array = NDArray[np.float64]

START_TOLERANCE = 1e-9
"""Within which a motion starts at 0 [m] or [rad]."""


@dataclass(frozen=True, eq=False)
class SideMotion(ReadOnlyArrays):
    """A motion of the pedestal beside that along x, sample for sample with it; read-only.

    Attributes:
        displacement: shape (n,) [m], or a rotation [rad]; starts at 0.
        velocity: shape (n,) [m/s] or [rad/s].
    """

    displacement: Array
    velocity: Array


SIDES = ("transverse", "vertical", "pitch")
CHANNELS = ("displacement", "velocity", "acceleration")
_OWN = (*CHANNELS, "_deferred", "sha256")
"""What a motion that refers to another's samples does not take over."""


@checked_names(MotionError, {"dt": "time_step"})
@dataclass(frozen=True, eq=False, repr=False)
class Motion(OneLine, ReadOnlyArrays):
    """A pedestal motion along x, sampled at the simulation's time step.

    Attributes:
        name: unique name within a study.
        time_step: interval between samples [s].
        displacement: shape (n,) [m]; starts at 0.
        velocity: shape (n,) [m/s].
        acceleration: shape (n,) [m/s^2]; a :class:`Deferred` of it is checked when it is made,
            but not against the velocity, of whose curve it is the derivative.
        kind: "cosine" (motor drive follows position and velocity) or "recording" (position only),
            supplement S1.3.
        source: how it came about (parameters or file), for the provenance.
        resampling_error: stated error of the displacement from resampling in time, the greatest
            magnitude [m] (:func:`vsr2.motion.resample.resample`); 0 for analytic motions.
        resampling_error_rms: the same, root mean square [m].
        transverse: along y, or None.
        vertical: along z, or None.
        pitch: rotation about y on the pedestal's pitch axis, or None.
        recorded: the record and the choices it was built from; None where the samples no longer
            follow from a record.

    The arrays are read-only. Motions are equal where name, kind and samples are. A scaled motion
    refers to the samples that were scaled; its own are made whenever they are asked for.

    Raises:
        MotionError: fewer than 2 or more than `MAX_SAMPLES` samples, lengths differ, NaN or
            infinity, no start at zero, channels that contradict each other, or a field of another
            type.
    """

    name: str
    time_step: float
    displacement: Array
    velocity: Array
    acceleration: Array
    kind: Literal["cosine", "recording"]
    source: str = ""
    resampling_error: float = 0.0
    resampling_error_rms: float = 0.0
    transverse: SideMotion | None = None
    vertical: SideMotion | None = None
    pitch: SideMotion | None = None
    recorded: Recorded | None = None

    pga = Renamed("pga_g", " [g] or peak_acceleration [m/s^2]")
    pgv = Renamed("pgv_m_s", " [m/s]")
    pgv_pga = Renamed("pgv_pga_s", " [s]")
    scaled_to_pga = Renamed("scaled_to_pga_g", ", which takes g")

    def __post_init__(self) -> None:
        check_fields(self)
        given = vars(self)
        if isinstance(given["acceleration"], Deferred):
            given["_deferred"] = given.pop("acceleration")
        kept = [field for field in CHANNELS if field in given]
        for field in kept:
            object.__setattr__(self, field, self._checked(field, given[field]))
        sizes = [given[field].size for field in kept]
        if min(sizes) != max(sizes):
            raise MotionError(
                f"motion {self.name!r}: {_listed(kept)} have {_listed(sizes)} samples; they must "
                "have the same number"
            )
        check_displacement(self.name, self.time_step, self.displacement, self.velocity)
        if "_deferred" not in vars(self):
            check_acceleration(self.name, self.time_step, self.velocity, self.acceleration)
        self._check_start_and_sides()

    if not TYPE_CHECKING:  # For which channels are fields and nothing else.

        def __getattr__(self, name: str) -> Array:
            """A channel of a scaled motion, or an acceleration that is not kept."""
            gone = vars(Motion).get(name)
            if isinstance(gone, Renamed):  # Whose error led here.
                gone.__get__(self, Motion)
            if name == "acceleration" and "_deferred" in vars(self):
                return self._made_acceleration()
            scaled = "_scaling" in vars(self)
            if name == "acceleration" and not scaled and vars(self).get("recorded") is not None:
                return self.recorded.motion(self.time_step).acceleration
            if name not in CHANNELS or not scaled:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            samples = self._samples(name)
            samples.setflags(write=False)
            return samples

    def __getstate__(self) -> dict[str, Any]:
        if "_deferred" in vars(self):
            self._made_acceleration()
        return vars(self).copy()

    def _made_acceleration(self) -> Array:
        """The deferred acceleration, which from now on is kept."""
        deferred: Deferred | None = vars(self).get("_deferred")
        if deferred is None:  # Another thread has made it.
            kept: Array = vars(self)["acceleration"]
            return kept
        made = self._checked("acceleration", deferred.make())
        if made.size != self.size:
            raise MotionError(
                f"motion {self.name!r}: its acceleration has {counted(made.size, 'sample')}, the "
                f"others {self.size}; they must have the same number"
            )
        vars(self)["acceleration"] = made
        vars(self).pop("_deferred", None)
        return made

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Motion):
            return NotImplemented
        return (self.sha256, self.name, self.kind) == (other.sha256, other.name, other.kind)

    def __hash__(self) -> int:
        return hash(self.sha256)

    @property
    def facts(self) -> Mapping[str, object]:
        """Its name and kind, length and time step [s], PGA [g] and PGV [m/s]."""
        names = ("name", "kind", "duration", "time_step", "pga_g", "pgv_m_s")
        return {name: getattr(self, name) for name in names}

    @classmethod
    @checked_names(MotionError, {"dt": "interval"})
    def from_acceleration(
        cls,
        acceleration: ArrayLike,
        interval: float,
        units: RecordUnits = "g",
        *,
        time_step: float = DEFAULT_TIME_STEP,
        filter: Filter | None = None,
        baseline: int | None = None,
        name: str = "record",
    ) -> Motion:
        """The motion of a recorded acceleration.

        Args:
            acceleration: shape (n,) [`units`].
            interval: between samples [s].
            units: of the samples, those of an acceleration: `g`, `m/s^2`, `cm/s^2`, `gal`, ...
            time_step: of the simulation that follows [s].
            filter: band-pass at the record's own sampling; None: none.
            baseline: degree of a polynomial to take off first; None: none.
            name: of the motion.

        Raises:
            MotionError: units of no acceleration; :func:`vsr2.motion.from_signal` takes velocities
                and displacements. What :class:`vsr2.motion.Record` refuses.

        Warns:
            MotionWarning: a PGA above 3 g.
        """
        from vsr2.motion.signal_motion import from_signal, require_acceleration

        require_acceleration(units, name)
        return from_signal(
            acceleration,
            interval,
            units,
            time_step=time_step,
            filter=filter,
            baseline=baseline,
            name=name,
        )

    @classmethod
    @checked_names(MotionError)
    def from_obspy(
        cls,
        stream: Any,
        units: RecordUnits,
        *,
        time_step: float = DEFAULT_TIME_STEP,
        filter: Filter | None = None,
        baseline: int | None = None,
    ) -> Motion:
        """The motion of an obspy Trace, or of a Stream of one channel, named by its id.

        Args:
            stream: the instrument's response is not removed.
            units: of its samples.
            time_step: as :func:`vsr2.motion.from_signal`.
            filter: likewise.
            baseline: likewise.

        Raises:
            MotionError: several channels, a gap, an overlap, or what :class:`Record` refuses.
        """
        from vsr2.motion.seismology import one_trace
        from vsr2.motion.signal_motion import from_signal

        trace = one_trace(stream)
        return from_signal(
            trace.data,
            trace.interval,
            units,
            time_step=time_step,
            filter=filter,
            baseline=baseline,
            name=trace.name,
        )

    def plot(self) -> Figure:
        """Displacement, velocity and acceleration over time, as a matplotlib figure."""
        from vsr2.motion.plot import history_figure

        return history_figure(self)

    @property
    def _origin(self) -> tuple[Motion, tuple[float, ...]]:
        """The motion that holds the samples, and the factors on them in their order."""
        found: tuple[Motion, tuple[float, ...]] = vars(self).get("_scaling", (self, ()))
        return found

    @property
    def _origin_defers(self) -> bool:
        return "_deferred" in vars(self._origin[0])

    def _samples(self, channel: str) -> Array:
        held, factors = self._origin
        samples: Array = getattr(held, channel)
        for k, factor in enumerate(factors):
            samples = np.multiply(samples, factor, out=samples if k else None)
        return samples

    def _check_start_and_sides(self) -> None:
        held, factors = self._origin
        first = float(held.displacement[0])
        for factor in factors:
            first *= factor
        if abs(first) > START_TOLERANCE:
            raise MotionError(
                f"motion {self.name!r}: starts at {first:g} m; the pedestal starts at 0, so "
                "subtract the first value"
            )
        for side in SIDES:
            object.__setattr__(self, side, self._checked_side(side))

    def _checked_side(self, side: str) -> SideMotion | None:
        given: SideMotion | None = getattr(self, side)
        if given is None:
            return None
        if not isinstance(given, SideMotion):
            raise MotionError(
                f"motion {self.name!r}: {side} must be a vsr2.motion.SideMotion or None (is of "
                f"type {type(given).__name__})"
            )
        displacement = self._checked(f"{side} displacement", given.displacement)
        velocity = self._checked(f"{side} velocity", given.velocity)
        if not (displacement.size == velocity.size == self.size):
            raise MotionError(
                f"motion {self.name!r}: {side} has {displacement.size} and "
                f"{counted(velocity.size, 'sample')}, the motion along x {self.size}; they must be "
                "equal"
            )
        if abs(displacement[0]) > START_TOLERANCE:
            raise MotionError(
                f"motion {self.name!r}: {side} starts at {displacement[0]:g}, not at 0; subtract "
                "the first value"
            )
        return SideMotion(displacement, velocity)

    def _checked(self, field: str, given: Array) -> Array:
        value = samples_of(given, f"motion {self.name!r}: {field}", fewest=2)
        bad = np.flatnonzero(~np.isfinite(value))
        if bad.size:
            raise MotionError(
                f"motion {self.name!r}: {field} is {value[bad[0]]} at sample {bad[0]} "
                f"(t = {bad[0] * self.time_step:g} s); {counted(bad.size, 'such sample')}; "
                "repair or cut the record"
            )
        return value

    @property
    def sides(self) -> dict[str, SideMotion | None]:
        """The motions beside x by their names."""
        return {name: getattr(self, name) for name in SIDES}

    @property
    def is_spatial(self) -> bool:
        """Whether there is any motion beside x."""
        return not (self.transverse is None and self.vertical is None and self.pitch is None)

    @property
    def size(self) -> int:
        """Number of samples."""
        return self._origin[0].displacement.size

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return (self.size - 1) * self.time_step

    @property
    def times(self) -> Array:
        """Sample times from 0, shape (n,) [s]."""
        return np.arange(self.size, dtype=np.float64) * self.time_step

    @cached_property
    def _peak_displacement(self) -> float:
        return float(np.abs(self.displacement).max())

    @cached_property
    def peak_acceleration(self) -> float:
        """Greatest magnitude of the acceleration as driven [m/s^2]; `pga_g` gives it in g."""
        held, factors = self._origin
        if held is not self:
            return math.prod(map(abs, factors), start=held.peak_acceleration)
        deferred: Deferred | None = vars(self).get("_deferred")
        if deferred is not None and deferred.peak is not None:
            peak = deferred.peak()
            if math.isfinite(peak):  # Or the acceleration says where it is not.
                return peak
        return float(np.abs(self.acceleration).max())

    @property
    def pga_g(self) -> float:
        """Peak ground acceleration of the motion as driven [g], g = 9.80665 m/s^2."""
        return self.peak_acceleration / STANDARD_GRAVITY

    @cached_property
    def pgv_m_s(self) -> float:
        """Peak ground velocity of the motion as driven [m/s]."""
        return float(np.abs(self.velocity).max())

    @property
    def pgv_pga_s(self) -> float:
        """PGV/PGA [s]; 0 for a motion at rest."""
        peak = self.peak_acceleration
        return self.pgv_m_s / peak if peak > 0 else 0.0

    @cached_property
    def sha256(self) -> str:
        """Hash of time step, displacement, velocity and side motions: what is driven."""
        digest = hashlib.sha256(np.float64(self.time_step).tobytes())
        digest.update(self.displacement.tobytes())
        digest.update(self.velocity.tobytes())
        for name, side in self.sides.items():
            if side is not None:
                digest.update(name.encode() + side.displacement.tobytes())
                digest.update(side.velocity.tobytes())
        return digest.hexdigest()

    def scaled_to_pga_g(self, pga_g: float, *, name: str | None = None) -> Motion:
        """The same motion scaled so that its PGA as driven is `pga_g` [g], its sign kept.

        Raises:
            MotionError: `pga_g` is not positive and finite, or the motion is at rest.
        """
        if not (math.isfinite(pga_g) and pga_g > 0):
            raise MotionError(
                f"motion {self.name!r}: target PGA {pga_g} g must be positive and finite"
            )
        peak = self.peak_acceleration
        if peak == 0:
            raise MotionError(f"motion {self.name!r}: is at rest, so no factor gives it a PGA")
        return self.scaled(pga_g * STANDARD_GRAVITY / peak, name=name)

    def without_acceleration(self) -> Motion:
        """The same motion in two thirds of the memory, itself where it is of no record.

        The acceleration, which drives nothing, is made from the record whenever it is asked for.
        """
        own = ("acceleration", "_deferred")
        if self.recorded is None or not any(name in vars(self) for name in own):
            return self
        peak = self.peak_acceleration
        made = object.__new__(type(self))
        kept = {name: value for name, value in vars(self).items() if name not in own}
        vars(made).update(kept, peak_acceleration=peak)
        return made

    def scaled(self, factor: float, *, name: str | None = None) -> Motion:
        """The same motion, every sample of every direction times `factor`; negative mirrors it.

        Args:
            factor: not 0, finite.
            name: of the new motion; by default the old one with ` x factor`.

        Raises:
            MotionError: `factor` is 0, NaN or infinite, or the product overflows.
        """
        if not math.isfinite(factor) or factor == 0:
            raise MotionError(
                f"motion {self.name!r}: scale factor {factor} must be finite and not 0"
            )
        peaks = {
            name: getattr(self, name) * abs(factor)
            for name in ("_peak_displacement", "peak_acceleration", "pgv_m_s")
            # That of an acceleration which nobody has asked for yet stays unknown.
            if name != "peak_acceleration" or name in vars(self) or not self._origin_defers
        }
        if not all(map(math.isfinite, peaks.values())):
            raise MotionError(f"motion {self.name!r}: times {factor:g} it is not finite")
        held, factors = self._origin
        return self._derived(
            (held, (*factors, factor)),
            name=f"{self.name} x {factor:.12g}" if name is None else name,
            source=f"{self.source}; scaled by {factor:.12g}",
            resampling_error=self.resampling_error * abs(factor),
            resampling_error_rms=self.resampling_error_rms * abs(factor),
            recorded=self.recorded and self.recorded.times(factor),
            **{name: _scaled(side, factor) for name, side in self.sides.items()},
            **peaks,
        )

    def with_sides(self, source: str, **sides: SideMotion) -> Motion:
        """The same motion along x with others beside it, which no record tells any more.

        Its samples along x are those of this motion, as they are of a scaled one.

        Args:
            source: how it came about.
            sides: by their names; the others stay.

        Raises:
            MotionError: a side has another number of samples, or does not start at 0.
        """
        return self._derived(self._origin, source=source, recorded=None, **sides)

    def _derived(self, scaling: tuple[Motion, tuple[float, ...]], **changes: Any) -> Motion:
        """A motion whose samples along x are those of another times factors."""
        made = object.__new__(type(self))
        kept = vars(self).copy()
        for name in _OWN:
            kept.pop(name, None)
        vars(made).update(kept, _scaling=scaling, **changes)
        made._check_start_and_sides()
        return made


def _scaled(side: SideMotion | None, factor: float) -> SideMotion | None:
    if side is None:
        return None
    with np.errstate(over="ignore"):
        return SideMotion(side.displacement * factor, side.velocity * factor)


def _listed(values: Sequence[object]) -> str:
    *first, last = map(str, values)
    return f"{', '.join(first)} and {last}"
