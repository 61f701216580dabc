"""From the study's motion section to the motions of its trials."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, assert_never
from weakref import WeakKeyDictionary

from vsr2.config.motion_source import (
    AllRecordings,
    Channel,
    Filter,
    GridCosine,
    MotionSource,
    SingleCosine,
    SingleRecording,
)
from vsr2.errors import MotionError
from vsr2.motion.cosine import (
    cosine_motion,
    cosine_name,
    cosine_parameters,
    grid_parameters,
    grid_values,
)
from vsr2.motion.fusion import ChannelNoise, fuse
from vsr2.motion.measures import channel_signal, kinematics
from vsr2.motion.motion import Array, Motion
from vsr2.motion.processing import band_pass, taper_ends
from vsr2.motion.record import Record
from vsr2.motion.recording import read_record
from vsr2.motion.resample import resample
from vsr2.motion.samples import Deferred
from vsr2.one_line import counted

MAX_MOTIONS = 100_000
"""Most motions of one study."""
MAX_TOTAL_SAMPLES = 50_000_000
"""Most samples of all motions of one study together: 1.2 GB."""


@dataclass(frozen=True)
class RecordedConstants:
    """How records become motions.

    Attributes:
        crossover_order: of the filters that join two records. White noise of the displacement then
            falls with frequency even in the second derivative, and a drift of the integrated
            acceleration with f^4.
        strongest_usual: PGA above which motions are looked at again [g]. One of the strongest on
            record, station IWTH25 in the Iwate-Miyagi earthquake of 2008, has 3.9 g upwards and
            about 1.4 g horizontally (Aoi et al. 2008, Science 322:727).
    """

    crossover_order: int = 2
    strongest_usual: float = 3.0


RECORDED = RecordedConstants()


class MotionWarning(UserWarning):
    """Something about a motion that its maker should look at before it is run."""


def warn_of_unusual_pga(peaks: Sequence[tuple[str, float]]) -> None:
    """Warn, as :class:`MotionWarning`, of motions above `RECORDED.strongest_usual`.

    Args:
        peaks: name and PGA [g] of each motion.
    """
    above = [peak for _, peak in peaks if peak > RECORDED.strongest_usual]
    if above:
        name, strongest = max(peaks, key=lambda one: one[1])
        warnings.warn(
            f"motion {name!r}: PGA {strongest:.4g} g; {len(above)} of "
            f"{counted(len(peaks), 'motion')} above {RECORDED.strongest_usual:g} g. Check "
            "units and scale; a noisy displacement record needs a filter",
            MotionWarning,
            stacklevel=2,
        )


def build_motions(source: MotionSource, time_step: float) -> list[Motion]:
    """The motions of a study, one a trial (the four modes of supplement S1.3).

    Names are unique. A grid runs over PGA, and for each PGA over PGV/PGA; recordings come in the
    order of their file names.

    Args:
        source: paths in it are absolute or relative to the working directory.
        time_step: of the simulation [s].

    Warns:
        MotionWarning: a PGA above `RECORDED.strongest_usual`.

    Raises:
        MotionError: a file cannot be used, no file matches, or there are more than `MAX_MOTIONS`
            motions or `MAX_TOTAL_SAMPLES` samples in all.
    """
    motions = _motions(source, time_step)
    warn_of_unusual_pga([(motion.name, motion.pga_g) for motion in motions])
    return motions


def _motions(source: MotionSource, time_step: float) -> list[Motion]:
    match source:
        case SingleCosine():
            return [_single_cosine(source, time_step)]
        case GridCosine():
            return _grid_cosine(source, time_step)
        case SingleRecording():
            return [_from_file(source.file, source, time_step)]
        case AllRecordings():
            return _all_recordings(source, time_step)
    assert_never(source)


@dataclass(frozen=True, eq=False)
class Recorded:
    """A record and how it drives: the value that a recorded motion is built from.

    The original drives recordings from the displacement channel after a band-pass 0.1-25 Hz of
    order 3; that is `channel="displacement"` (or "auto") with `filter=Filter()`. The displacement
    channel keeps its sign. The chain is that of :mod:`vsr2.motion.processing`.

    Attributes:
        record: at its own sampling interval.
        channel: which one drives; "auto": displacement where there is one, else velocity, else
            acceleration; "fused": displacement and acceleration together
            (:func:`vsr2.motion.fusion.fuse`).
        baseline: degree of a polynomial to take off the channel first; None: none.
        filter: band-pass at the record's own sampling; None: none. A raw displacement channel
            should have one: its noise is small, its second derivative is not.
        scale: factor on the motion; negative mirrors it.
        noise: of the channels, for "fused" alone; None: estimated from the record's rest.
        crossover: for "fused" alone [Hz]: below it the displacement drives, above it the
            acceleration, by complementary filters; None: the smoother of :mod:`vsr2.motion.fusion`
            weighs them.

    Raises:
        MotionError: a scale of 0, NaN or infinity, `noise` or `crossover` with another channel than
            "fused", both of them, or a `crossover` that is not positive and finite.
    """

    record: Record
    channel: Channel = "auto"
    baseline: int | None = None
    filter: Filter | None = None
    scale: float = 1.0
    noise: ChannelNoise | None = None
    crossover: float | None = None

    def __post_init__(self) -> None:
        self._check_scale()
        self._check_crossover()
        if self.noise is not None and self.used != "fused":
            raise MotionError(
                f"{self.record.label}: noise has no effect on the {self.used} channel; leave it out"
            )

    def _check_scale(self) -> None:
        if not math.isfinite(self.scale) or self.scale == 0:
            raise MotionError(f"{self.record.label}: scale {self.scale} must be finite and not 0")

    def _check_crossover(self) -> None:
        if self.crossover is None:
            return
        if self.used != "fused" or self.noise is not None:
            given = "noise" if self.noise is not None else f"the {self.used} channel"
            raise MotionError(f"{self.record.label}: a crossover does not go with {given}")
        if not 0 < self.crossover < math.inf:
            raise MotionError(
                f"{self.record.label}: crossover {self.crossover} Hz is not positive and finite"
            )

    @property
    def used(self) -> Channel:
        """The channel that drives, "auto" resolved."""
        return next(iter(self.record.channels)) if self.channel == "auto" else self.channel

    def times(self, factor: float) -> Recorded:
        """The same record, driving `factor` times as far.

        Raises:
            MotionError: the scale becomes 0, NaN or infinite.
        """
        made = object.__new__(type(self))
        vars(made).update(vars(self), scale=self.scale * factor)
        made._check_scale()
        return made

    def through(self, channel: Channel) -> Recorded:
        """The same record and scale through another channel.

        An acceleration without a filter gets the usual one, without which its integral drifts.
        """
        filter = self.filter or (Filter() if channel == "acceleration" else None)
        return replace(self, channel=channel, filter=filter, noise=None, crossover=None)

    def crossed(self, crossover: float) -> Recorded:
        """The same record and scale, driving by both channels, joined at a frequency [Hz].

        Raises:
            MotionError: the frequency is not positive and finite.
        """
        return replace(self, channel="fused", noise=None, crossover=crossover)

    def motion(self, time_step: float, *, name: str | None = None) -> Motion:
        """The motion that the record asks of the pedestal.

        Args:
            time_step: of the simulation [s].
            name: of the motion; by default the record's.

        Raises:
            MotionError: the channel is missing, the filter does not fit the sampling, the noise of
                the channels cannot be estimated, or the record cannot be resampled at `time_step`.
        """
        record, filter = self.record, self.filter
        interval = record.sample_interval
        displacement, how = self._displacement()
        driven = resample(
            self.scale * taper_ends(displacement, interval), interval, time_step, name=record.label
        )
        for samples in (driven.displacement, driven.velocity):
            samples.setflags(write=False)  # Nobody else has them, and a motion need not copy them.
        acceleration: Any = Deferred(lambda: driven.acceleration, lambda: driven.peak_acceleration)
        treatment = "no filter"
        if filter is not None:
            treatment = f"band-pass {filter.low:g}-{filter.high:g} Hz order {filter.order}"
        if self.baseline is not None:
            treatment = f"baseline of degree {self.baseline}, {treatment}"
        return Motion(
            name=record.name if name is None else name,
            time_step=time_step,
            displacement=driven.displacement,
            velocity=driven.velocity,
            acceleration=acceleration,
            kind="recording",
            source=(
                f"{record.label}, sha256 {record.sha256 or 'none'}, {how}, {treatment}, "
                f"scale {self.scale:.12g}, sampled every {interval:.9g} s"
            ),
            resampling_error=driven.error,
            resampling_error_rms=driven.error_rms,
            recorded=self,
        )

    def _displacement(self) -> tuple[Array, str]:
        """What drives (n,) [m], and how it came about."""
        record, channel, baseline, filter = self.record, self.used, self.baseline, self.filter
        how = f"{channel} channel"
        if self.crossover is not None:
            return self._joined(self.crossover)
        if channel == "fused":
            fused = fuse(record, noise=self.noise, baseline=baseline)
            displacement, seen = fused.displacement, fused.noise
            how = (
                f"displacement and acceleration fused (noise {seen.displacement.deviation:.3g} m "
                f"and {seen.acceleration.deviation:.3g} m/s^2, consistency {fused.consistency:.3g})"
            )
        elif channel == "displacement":
            displacement = channel_signal(record, channel, baseline)
        else:
            return _INTEGRATED.of(self), how
        if filter is not None:
            interval = record.sample_interval
            displacement = band_pass(displacement, interval, filter, name=record.label)
        return displacement, how

    def _joined(self, crossover: float) -> tuple[Array, str]:
        """Both channels by filters of gain 1 / (1 + (f / fc)^4) and one minus it, without delay."""
        record = self.record
        nyquist = 0.5 / record.sample_interval
        if crossover >= nyquist:
            raise MotionError(
                f"{record.label}: crossover {crossover:g} Hz is not below the record's Nyquist "
                f"frequency {nyquist:g} Hz; lower it"
            )
        slow, _ = self.through("displacement")._displacement()
        fast, _ = self.through("acceleration")._displacement()
        low = Filter(low=0.0, high=crossover, order=RECORDED.crossover_order)
        apart = (slow - slow[0]) - fast
        joined = fast + band_pass(apart, record.sample_interval, low, name=record.label)
        how = f"displacement channel below {crossover:.12g} Hz, acceleration channel above"
        return joined, how


class KeptDisplacements:
    """Displacements of accelerations that were integrated, while the records live.

    A record drives many scenes, at many crossovers. What does not fit is made again each time:
    trials come round in the same order, in which keeping the last ones would keep none.

    Args:
        most: of all together [byte].
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: WeakKeyDictionary[Record, dict[tuple[object, ...], Array]] = (
            WeakKeyDictionary()
        )

    @property
    def size(self) -> int:
        """Of all together [byte]."""
        return sum(made.nbytes for known in self._known.values() for made in known.values())

    def of(self, recorded: Recorded) -> Array:
        """What drives, before ends, resampling and scale, shape (n,) [m], read-only."""
        known = self._known.setdefault(recorded.record, {})
        key = recorded.channel, recorded.baseline, recorded.filter
        if key not in known:
            made = kinematics(
                recorded.record,
                channel=recorded.used,
                filter=recorded.filter,
                baseline=recorded.baseline,
            ).displacement
            made.setflags(write=False)
            if self.size + made.nbytes > self._most:
                return made
            known[key] = made
        return known[key]


_INTEGRATED = KeptDisplacements(2**28)
"""Room for some 500 records of a minute at 1 kHz."""


def build_recorded_motion(
    record: Record,
    time_step: float,
    *,
    channel: Channel = "auto",
    baseline: int | None = None,
    filter: Filter | None = None,
    scale: float = 1.0,
    noise: ChannelNoise | None = None,
    name: str | None = None,
) -> Motion:
    """The motion that a record asks of the pedestal: :class:`Recorded` in one call.

    Raises:
        MotionError: as :class:`Recorded` and its `motion`.
    """
    return Recorded(record, channel, baseline, filter, scale, noise).motion(time_step, name=name)


def _single_cosine(source: SingleCosine, time_step: float) -> Motion:
    if source.amplitude is not None and source.frequency is not None:
        return cosine_motion(source.amplitude, source.frequency, time_step)
    assert source.pga_g is not None
    assert source.pgv_pga_s is not None
    return _cosine(source.pga_g, source.pgv_pga_s, time_step)


def _cosine(pga_g: float, pgv_pga_s: float, time_step: float) -> Motion:
    amplitude, frequency = cosine_parameters(pga_g, pgv_pga_s)
    return cosine_motion(amplitude, frequency, time_step, name=cosine_name(pga_g, pgv_pga_s))


def _grid_cosine(grid: GridCosine, time_step: float) -> list[Motion]:
    pgas, ratios = grid_values(grid.pga_g), grid_values(grid.pgv_pga_s)
    count = len(pgas) * len(ratios)
    if count > MAX_MOTIONS:
        raise MotionError(
            f"grid_cosine: {len(pgas)} values of pga_g times {len(ratios)} of pgv_pga_s give "
            f"{count} motions; at most {MAX_MOTIONS}: raise a `step`"
        )
    _check_total(
        len(pgas) * sum(2 * math.pi * ratio / time_step + 2 for ratio in ratios), "grid_cosine"
    )
    return [_cosine(pga_g, ratio, time_step) for pga_g, ratio in grid_parameters(grid)]


def _all_recordings(source: AllRecordings, time_step: float) -> list[Motion]:
    files = _matching_files(source.folder, source.pattern)
    motions: list[Motion] = []
    total = 0
    for file, name in zip(files, _unique_names(files), strict=True):
        motions.append(_from_file(file, source, time_step, name=name))
        total += motions[-1].displacement.size
        _check_total(total, str(source.folder))
    return motions


def _from_file(
    file: Path,
    source: SingleRecording | AllRecordings,
    time_step: float,
    *,
    name: str | None = None,
) -> Motion:
    return build_recorded_motion(
        read_record(file, units=source.units),
        time_step,
        channel=source.channel,
        filter=source.filter,
        scale=source.scale,
        name=name,
    )


def _matching_files(folder: Path, pattern: str) -> list[Path]:
    hidden = pattern.startswith(".")
    try:
        if not folder.is_dir():
            raise MotionError(f"{folder}: no such folder; check motion.folder")
        files = sorted(
            (
                path
                for path in folder.iterdir()
                if fnmatchcase(path.name, pattern)
                and (hidden or not path.name.startswith("."))
                and path.is_file()
            ),
            key=lambda path: path.name,
        )
    except (OSError, ValueError) as error:
        raise MotionError(f"{folder}: cannot be listed ({error})") from None
    if not files:
        raise MotionError(
            f"{folder}: no file matches the pattern {pattern!r}; check motion.folder and "
            "motion.pattern"
        )
    if len(files) > MAX_MOTIONS:
        raise MotionError(
            f"{folder}: {counted(len(files), 'file')} match {pattern!r}; at most {MAX_MOTIONS}: "
            "narrow motion.pattern"
        )
    return files


def _unique_names(files: Iterable[Path]) -> list[str]:
    """The stems; where two files share one, their full names."""
    files = list(files)
    stems = Counter(file.stem for file in files)
    return [file.stem if stems[file.stem] == 1 else file.name for file in files]


def _check_total(samples: float, where: str) -> None:
    if samples > MAX_TOTAL_SAMPLES:
        raise MotionError(
            f"{where}: {samples:.3g} samples in all motions; at most {MAX_TOTAL_SAMPLES}: use "
            "fewer or shorter motions, or a greater time step"
        )
