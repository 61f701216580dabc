"""Effects on what the table does with the motion it is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vsr2.config.motion_source import Filter
from vsr2.effects.effect import Effect
from vsr2.effects.oscillator import (
    Array,
    Path,
    base_excited,
    limited,
    low_passed,
    ringing_samples,
)
from vsr2.effects.parameter import Parameter
from vsr2.errors import MotionError
from vsr2.motion import Motion, SideMotion, band_pass
from vsr2.motion.processing import differentiate
from vsr2.motion.resample import Resampled, resample
from vsr2.trial import Trial

LOW_PASS_DAMPING = math.sqrt(0.5)
"""Of the actuator's low-pass: Butterworth's."""
LOOP_FREQUENCY = 3.0
"""At which a saturated table comes back to its command [Hz]."""
FILTER_ORDER = 3
_INPUT = "effects.input_filter.input"


def _path(motion: Motion) -> Path:
    return Path(motion.displacement, motion.velocity, motion.acceleration)


def _driven(
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
    samples = [path.displacement - path.displacement[0], path.velocity, path.acceleration]
    sides = {name: beside(side) for name, side in motion.sides.items() if side is not None}
    moving = any(signal[-1] != 0 for signal in samples[1:])
    moving |= any(side.velocity[-1] != 0 for side in sides.values())
    size = samples[0].size + moving
    kept: dict[str, Any] = {
        name: SideMotion(_held(side.displacement, size), _held(side.velocity, size, 0.0))
        for name, side in sides.items()
    }
    return replace(
        trial,
        motion=replace(
            motion,
            displacement=_held(samples[0], size),
            velocity=_held(samples[1], size, 0.0),
            acceleration=_held(samples[2], size, 0.0),
            source=f"{motion.source}; {note}",
            # From here on the record no longer tells the motion.
            recorded=None,
            **kept,
        ),
    )


def _held(signal: Array, size: int, value: float | None = None) -> Array:
    """The signal continued to `size` samples by a value, by default its last."""
    rest = np.full(size - signal.size, signal[-1] if value is None else value)
    return np.concatenate([signal, rest])


def _late(signal: Array, count: int) -> Array:
    """The signal after `count` samples of rest at 0."""
    return np.concatenate([np.zeros(count), signal])


class TimeScale(Effect):
    """Time runs slower or faster.

    The displacement is resampled through its quintic spline; speeds change by 1 / (1 + change),
    accelerations by its square.
    """

    name = "time_scale"
    meaning = "The motion is played slower (change > 0) or faster than recorded"
    parameters = (
        Parameter(
            "change", "1", 0.0, -0.03, 0.03, "uniform", "relative change of all times",
            limits=(-0.3, 0.5),
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("inertia",)
    source = "sampling interval misread; accelerations change by 1 / (1 + change)^2"
    stage = "actuation"
    rank = 1

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion, factor = trial.motion, 1.0 + values["change"]
        step = motion.time_step

        def stretched(signal: Array) -> Resampled:
            return resample(signal, step * factor, step, name=motion.name)

        def beside(side: SideMotion) -> SideMotion:
            slow = stretched(side.displacement)
            return SideMotion(slow.displacement, slow.velocity)

        slow = stretched(motion.displacement)
        path = Path(slow.displacement, slow.velocity, slow.acceleration)
        return _driven(trial, path, f"time times {factor:.12g}", beside)


class InputFilter(Effect):
    """How the recorded motion is turned into the driven one.

    `corner` is a Butterworth filter of order 3, run forward and backward: gain 1 / (1 + (f /
    fc)^6), no delay. `input` builds the motion again from another channel of the record, with the
    study's own filter and scale; it needs a recorded motion that has the channel. Both come before
    all else that is done to the motion, `time_scale` included: `corner` is in the record's time.
    """

    name = "input_filter"
    meaning = (
        "The motion is low-passed on its way into the simulation, or comes from another channel"
    )
    parameters = (
        Parameter(
            "corner", "Hz", math.inf, 5.0, 40.0, "loguniform",
            "of the zero-phase low-pass; none given: no filter", limits=(1.0, 400.0),
        ),
        Parameter(
            "input", "1", 0.0, 0.0, 3.0, "fixed",
            "channel of the record: `study`: as the study has it",
            choices=("study", "displacement", "acceleration", "fused"),
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("table_bandwidth",)
    source = (
        "Boore & Bommer (2005), Soil Dyn. Earthq. Eng. 25(2); docs/reference/motions.md on fusion"
    )
    stage = "actuation"
    rank = 0

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        if values["input"] != 0:
            trial = self._from_channel(trial, int(values["input"]))
        corner, motion = values["corner"], trial.motion
        # What lies beyond half the sampling rate passes everything.
        if corner >= 0.5 / motion.time_step:
            return trial
        # Amid rest, so that the filter rings out on both sides.
        pad = math.ceil(2.0 / corner / motion.time_step)
        size = motion.displacement.size + 2 * pad

        def beside(side: SideMotion) -> SideMotion:
            return SideMotion(
                _held(_late(side.displacement, pad), size),
                _held(_late(side.velocity, pad), size, 0.0),
            )

        amid = _held(_late(motion.displacement, pad), size)
        smooth = band_pass(amid, motion.time_step, Filter(low=0.0, high=corner, order=FILTER_ORDER))
        found = differentiate(smooth, motion.time_step)
        path = Path(found.displacement, found.velocity, found.acceleration)
        return _driven(trial, path, f"low-pass {corner:g} Hz", beside)

    def _from_channel(self, trial: Trial, choice: int) -> Trial:
        motion, recorded = trial.motion, trial.motion.recorded
        channel: Any = self.parameter("input").choices[choice]
        if recorded is None:
            raise MotionError(
                f"{channel} needs a recorded motion that no effect has changed yet, and "
                f"{motion.name!r} is none; leave it at `study`, or apply it together with the "
                "other effects",
                key=_INPUT,
            )
        missing = recorded.record.lacking(channel)
        if missing:
            raise MotionError(
                f"{channel} cannot be built for {motion.name!r}: {recorded.record.label} has no "
                f"{missing} channel; set it to a channel of the record, or to `study`",
                key=_INPUT,
            )
        try:
            built = recorded.through(channel).motion(motion.time_step, name=motion.name)
        except MotionError as error:
            raise MotionError(
                f"{channel} cannot be built for {motion.name!r}: {error}", key=_INPUT
            ) from error
        return replace(trial, motion=built)


class TableGain(Effect):
    """A table that does more or less than its command.

    Every sample of every direction is multiplied.
    """

    name = "table_gain"
    meaning = "The table moves by 1 + change times what was recorded"
    parameters = (
        Parameter(
            "change", "1", 0.0, -0.15, 0.15, "uniform", "relative change of the motion",
            limits=(-0.9, 5.0),
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("slenderness", "edge_rounding", "table_pitch")
    source = "calibration of transducers; rocking depends on a / (g alpha) only"
    stage = "actuation"
    rank = 2

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion = trial.motion
        return replace(trial, motion=motion.scaled(1.0 + values["change"], name=motion.name))


class TableBandwidth(Effect):
    """An actuator too slow for the motion.

    y'' + 2 zeta w y' + w^2 y = w^2 x with zeta = 0.707, solved exactly; causal, so it delays too.
    The delay is rounded to time steps; alone it changes when, not what.
    """

    name = "table_bandwidth"
    meaning = "The table follows through a low-pass of second order, and late"
    parameters = (
        Parameter(
            "corner", "Hz", math.inf, 3.0, 25.0, "loguniform",
            "of the low-pass (damping 0.707); none given: no low-pass", limits=(0.5, 400.0),
        ),
        Parameter("delay", "s", 0.0, 0.0, 0.020, "uniform", "of the table", limits=(0.0, 1.0)),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("input_filter",)
    source = (
        "closed-loop model of servo-hydraulic tables; Trombetti & Conte (2002), J. Earthq. Eng."
    )
    stage = "actuation"
    rank = 3

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion, corner = trial.motion, values["corner"]
        step = motion.time_step
        path = _path(motion)
        late = round(values["delay"] / step)

        def beside(side: SideMotion) -> SideMotion:
            return SideMotion(_late(side.displacement, late), _late(side.velocity, late))

        path = Path(
            _late(path.displacement, late),
            _late(path.velocity, late),
            _late(path.acceleration, late),
        )
        if math.isfinite(corner):
            path = low_passed(
                path.held(ringing_samples(corner, LOW_PASS_DAMPING, step)),
                corner, LOW_PASS_DAMPING, step,
            )  # fmt: skip
        return _driven(trial, path, f"low-pass {corner:g} Hz, {late} samples late", beside)


class TableSaturation(Effect):
    """A table at its limits.

    Where the command exceeds a cap the acceleration is clipped and integrated again; a critically
    damped loop of 3 Hz, itself within the caps, brings the table back to its command.
    """

    name = "table_saturation"
    meaning = "Speed and acceleration of the table are capped; it comes back to its command later"
    parameters = (
        Parameter(
            "velocity", "m/s", math.inf, 0.15, 1.5, "loguniform",
            "greatest speed; none given: no cap", limits=(1e-3, 100.0),
        ),
        Parameter(
            "acceleration", "m/s^2", math.inf, 2.0, 20.0, "loguniform",
            "greatest acceleration; none given: no cap", limits=(1e-2, 1e4),
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("table_bandwidth",)
    source = "limits of pump and force of servo-hydraulic tables"
    stage = "actuation"
    rank = 4

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion = trial.motion
        velocity, acceleration = values["velocity"], values["acceleration"]
        if motion.pgv <= velocity and motion.pga <= acceleration:
            return trial
        rest = round(2.0 / motion.time_step)
        path = limited(
            _path(motion).held(rest), velocity, acceleration, motion.time_step, loop=LOOP_FREQUENCY
        )
        return _driven(trial, path, f"capped at {velocity:g} m/s and {acceleration:g} m/s^2")


class TableResonance(Effect):
    """A soft table.

    y'' + 2 zeta w (y' - x') + w^2 (y - x) = 0, solved exactly. Its gain at the frequency is sqrt(1
    + 1 / (4 zeta^2)), which sets zeta; amplification 1 is a rigid table.
    """

    name = "table_resonance"
    meaning = (
        "Between actuator and rock the table is a mass on a spring and a dashpot: a filter of the "
        "motion, which the rock does not push back"
    )
    parameters = (
        Parameter(
            "amplification", "1", 1.0, 1.0, 2.0, "uniform", "of a sine at the frequency",
            limits=(1.0, 50.0),
        ),
        Parameter(
            "frequency", "Hz", 12.0, 8.0, 20.0, "uniform", "without damping", limits=(1.0, 200.0),
            secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt", "slip")
    confounded_with = ("table_pitch",)
    source = "transmissibility sqrt(1 + 1 / (4 zeta^2)) at the frequency; den Hartog (1956)"
    stage = "actuation"
    rank = 5

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion, frequency = trial.motion, values["frequency"]
        ratio = 0.5 / math.sqrt(values["amplification"] ** 2 - 1)
        step = motion.time_step
        path = _path(motion).held(ringing_samples(frequency, ratio, step))
        path = base_excited(path, frequency, ratio, step)
        return _driven(trial, path, f"mode at {frequency:g} Hz, damping {ratio:.4g}")


ACTUATION: tuple[Effect, ...] = (
    TimeScale(), InputFilter(), TableGain(), TableBandwidth(), TableSaturation(), TableResonance(),
)  # fmt: skip
