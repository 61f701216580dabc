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
    held,
    limited,
    low_passed,
    ringing_samples,
)
from vsr2.effects.parameter import Parameter
from vsr2.errors import MotionError
from vsr2.motion import SideMotion, band_pass
from vsr2.motion.processing import Kinematics, differentiate
from vsr2.motion.resample import resample
from vsr2.trial import Trial

LOW_PASS_DAMPING = math.sqrt(0.5)
"""Of the actuator's low-pass: Butterworth's."""
LOOP_FREQUENCY = 3.0
"""At which a saturated table comes back to its command [Hz]."""
FILTER_ORDER = 3
_INPUT = "effects.input_filter.input"


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
    sides = {name: beside(side) for name, side in motion.sides.items() if side is not None}
    ends = (path.velocity, path.acceleration, *(side.velocity for side in sides.values()))
    size = path.displacement.size + any(signal[-1] != 0 for signal in ends)
    kept: dict[str, Any] = {name: _held(side, size) for name, side in sides.items()}
    more = held(path, size - path.displacement.size)
    return replace(
        trial,
        motion=replace(
            motion,
            displacement=more.displacement - more.displacement[0],
            velocity=more.velocity,
            acceleration=more.acceleration,
            source=f"{motion.source}; {note}",
            # From here on the record no longer tells the motion.
            recorded=None,
            **kept,
        ),
    )


def _held(side: SideMotion, size: int) -> SideMotion:
    """The motion continued to `size` samples, at rest at its last displacement."""
    more = (0, size - side.displacement.size)
    return SideMotion(np.pad(side.displacement, more, mode="edge"), np.pad(side.velocity, more))


def _late(signal: Array, count: int) -> Array:
    """The signal after `count` samples of rest at 0."""
    return np.pad(signal, (count, 0))


def _late_side(side: SideMotion, count: int) -> SideMotion:
    return SideMotion(_late(side.displacement, count), _late(side.velocity, count))


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
    b = 1 + ratio
    x = 2 / (b + math.sqrt(b * b + 4 * ratio))
    return float(one * x ** (1 / power))


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
            limits=(-0.3, 0.5), twice="growth",
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

        def beside(side: SideMotion) -> SideMotion:
            slow = resample(side.displacement, step * factor, step, name=motion.name)
            return SideMotion(slow.displacement, slow.velocity)

        path = resample(motion.displacement, step * factor, step, name=motion.name)
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
        amid = np.pad(_late(motion.displacement, pad), (0, pad), mode="edge")
        smooth = band_pass(amid, motion.time_step, Filter(low=0.0, high=corner, order=FILTER_ORDER))
        path = differentiate(smooth, motion.time_step)

        def beside(side: SideMotion) -> SideMotion:
            return _held(_late_side(side, pad), amid.size)

        return _driven(trial, path, f"low-pass {corner:g} Hz", beside)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        # A channel takes the place of what was built and filtered before.
        if second["input"] != 0:
            return dict(second)
        corner = half_passed(first["corner"], second["corner"], 2 * FILTER_ORDER)
        return {"corner": corner, "input": first["input"]}

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
            limits=(-0.9, 5.0), twice="growth",
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
        Parameter(
            "delay", "s", 0.0, 0.0, 0.020, "uniform", "of the table", limits=(0.0, 1.0),
            twice="sum",
        ),
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
        late = round(values["delay"] / step)
        signals = (motion.displacement, motion.velocity, motion.acceleration)
        path = Kinematics(*(_late(signal, late) for signal in signals))
        if math.isfinite(corner):
            path = held(path, ringing_samples(corner, LOW_PASS_DAMPING, step))
            path = low_passed(path, corner, LOW_PASS_DAMPING, step)
        note = f"low-pass {corner:g} Hz, {late} samples late"
        return _driven(trial, path, note, lambda side: _late_side(side, late))

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        corner = half_passed(first["corner"], second["corner"], 4)
        return {"corner": corner, "delay": first["delay"] + second["delay"]}


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
            "greatest speed; none given: no cap", limits=(1e-3, 100.0), twice="least",
        ),
        Parameter(
            "acceleration", "m/s^2", math.inf, 2.0, 20.0, "loguniform",
            "greatest acceleration; none given: no cap", limits=(1e-2, 1e4), twice="least",
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
        path: Path = held(motion, round(2.0 / motion.time_step))
        path = limited(path, velocity, acceleration, motion.time_step, loop=LOOP_FREQUENCY)
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
        path = held(motion, ringing_samples(frequency, ratio, step))
        path = base_excited(path, frequency, ratio, step)
        return _driven(trial, path, f"mode at {frequency:g} Hz, damping {ratio:.4g}")
