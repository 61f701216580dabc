"""Effects on what the table does with the motion it is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from vsr2.config.motion_source import Channel, Filter
from vsr2.effects.driven import delayed, delayed_side, driven, half_passed, held_side
from vsr2.effects.effect import Effect
from vsr2.effects.oscillator import (
    Array,
    LazyPath,
    Path,
    base_excited,
    braked,
    held,
    limited,
    low_passed,
    ringing_samples,
)
from vsr2.effects.parameter import Parameter
from vsr2.errors import ConfigError, MotionError
from vsr2.motion import SideMotion, band_pass
from vsr2.motion.processing import differentiate
from vsr2.motion.resample import resample
from vsr2.motion.study_motions import RECORDED, Recorded
from vsr2.trial import Trial


@dataclass(frozen=True)
class ActuationConstants:
    """How a shake table and its input channel answer.

    Attributes:
        low_pass_damping: damping ratio of the actuator's low-pass: Butterworth's, of second order.
        saturated_rest: after the motion of a saturated table, before it brakes [s].
        braking: of a saturated table that has not come back by then [m/s^2]; both chosen by hand.
        over_cap: a motion that exceeds a cap by this share keeps to it: capped ones do by rounding.
        filter_order: of the low-pass that smooths the input, Butterworth's; chosen by hand.
        smooth_rest: rest beside a motion that is smoothed, in periods of the corner.
        gain_rest: likewise beside one whose gain differs by frequency, of the lower corner.
    """

    low_pass_damping: float = math.sqrt(0.5)
    saturated_rest: float = 2.0
    braking: float = 0.1
    over_cap: float = 1e-12
    filter_order: int = 3
    smooth_rest: float = 2.0
    gain_rest: float = 3.0


ACTUATION = ActuationConstants()


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
        return driven(trial, path, f"time times {factor:.12g}", beside)


class InputChannel(Effect):
    """Which record drives the table, and how far its instruments err.

    `crossover` joins the two records by complementary filters without delay, whose sum is one: gain
    1 / (1 + (f / fc)^4) on the displacement, the rest on the acceleration integrated twice.
    Infinity leaves the displacement alone, 0 the acceleration. `channel` builds the motion from one
    record, or from both by their noise (`fused`). Filter and scale are the study's. Both need a
    recorded motion that has the channels, and are refused where it has not. `crossover` has a prior
    of its own, log-uniform over its range, where all trials have both records.

    `low_gain` multiplies what is slower than `low_corner` by 1 + low_gain, `high_gain` what is
    faster than `high_corner` by 1 + high_gain. The gain is 1 + low_gain L(f / low_corner) +
    high_gain (1 - L(f / high_corner)) with L(r) = 1 / (1 + r^4), without delay. Gains act on
    any motion, those of one record or none too. Where one record drives they are its instrument's;
    where two are joined, the low one is mostly the transducer's and the high one the
    accelerometer's. All of this comes before all else that is done to the motion.
    """

    name = "input_channel"
    meaning = (
        "The table's motion is taken from the other record or from both, and the instrument's gain "
        "is wrong where it is slow or fast"
    )
    parameters = (
        Parameter(
            "low_gain", "1", 0.0, -0.4, 0.4, "uniform", "relative change of what is slow",
            limits=(-0.9, 5.0), twice="growth",
        ),
        Parameter(
            "high_gain", "1", 0.0, -0.4, 0.4, "uniform", "relative change of what is fast",
            limits=(-0.9, 5.0), twice="growth",
        ),
        Parameter(
            "crossover", "Hz", math.inf, 0.5, 20.0, "fixed",
            "below it the displacement record drives, above it the acceleration record; none "
            "given: the record that the study has; open where all trials have both records",
            limits=(0.05, 400.0), twice="later",
        ),
        Parameter(
            "channel", "1", 0.0, 0.0, 3.0, "fixed",
            "record that drives: `study`: as the study has it",
            choices=("study", "displacement", "acceleration", "fused"), twice="later",
        ),
        Parameter(
            "low_corner", "Hz", 2.0, 0.5, 4.0, "fixed", "half of `low_gain` is left there",
            limits=(0.05, 100.0), secondary=True,
        ),
        Parameter(
            "high_corner", "Hz", 8.0, 4.0, 20.0, "fixed", "half of `high_gain` is reached there",
            limits=(0.05, 400.0), secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("table_gain", "table_bandwidth", "input_filter")
    source = (
        "complementary filters; transducers and accelerometers err by frequency (Boore & Bommer "
        "2005, Soil Dyn. Earthq. Eng. 25(2)); docs/explanation/motions.md on two channels"
    )
    stage = "actuation"
    rank = 0

    def nominal(self, trial: Trial) -> dict[str, float]:
        recorded, values = trial.motion.recorded, self.null()
        if recorded is not None and recorded.crossover is not None:
            values["crossover"] = recorded.crossover
        elif recorded is not None and recorded.used == "acceleration":
            values["crossover"] = 0.0
        return values

    def opened(self, trials: Iterable[Trial]) -> Self:
        records = [trial.motion.recorded for trial in trials]
        both = all([r is not None and r.record.lacking("fused") is None for r in records])
        found = self.parameter("crossover")
        if not both or found.prior != "fixed":
            return self
        return self.with_prior("crossover", found.lower, found.upper, "loguniform")

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        choice: Any = self.parameter("channel").choices[int(values["channel"])]
        crossover = values["crossover"]
        crossed = 0 < crossover < math.inf
        if crossed and choice != "study":
            raise ConfigError(
                f"{choice} is one way to drive and a crossover of {crossover:g} Hz another; leave "
                "one of them out",
                key="effects.input_channel.channel",
            )
        if crossed:
            trial = _from_record(
                trial, "crossover", "fused", lambda recorded: recorded.crossed(crossover)
            )
        elif choice != "study":
            trial = _from_record(trial, "channel", choice, lambda r: r.through(choice))
        low, high = values["low_gain"], values["high_gain"]
        if low == 0 and high == 0:
            return trial
        motion, step = trial.motion, trial.motion.time_step
        corners = [(low, values["low_corner"]), (high, values["high_corner"])]
        pad = math.ceil(ACTUATION.gain_rest / min(f for gain, f in corners if gain) / step)

        def passed(signals: Array) -> Array:
            # Amid rest, so that the filters ring out on both sides.
            amid = np.pad(np.pad(signals, ((0, 0), (pad, 0))), ((0, 0), (0, pad)), mode="edge")
            slow, below = (_below(amid, corner, step) for _, corner in corners)
            return np.asarray(amid + low * slow + high * (amid - below))

        x, rate = passed(np.stack([motion.displacement, motion.velocity]))
        path = LazyPath(x, rate, lambda: passed(motion.acceleration[None])[0])
        ends = f"below {corners[0][1]:g} Hz, {1 + high:.12g} above {corners[1][1]:g} Hz"
        note = f"gain {1 + low:.12g} {ends}"
        return driven(trial, path, note, lambda side: held_side(delayed_side(side, pad), x.size))


def _below(signal: Array, corner: float, step: float) -> Array:
    """What is slower than a corner [Hz], without delay: gain 1 / (1 + (f / fc)^4)."""
    if corner >= 0.5 / step:
        return signal
    return band_pass(signal, step, Filter(low=0.0, high=corner, order=RECORDED.crossover_order))


def _from_record(
    trial: Trial, parameter: str, channel: Channel, other: Callable[[Recorded], Recorded]
) -> Trial:
    """The trial under the motion that its record gives in another way."""
    motion, recorded = trial.motion, trial.motion.recorded
    key = f"effects.input_channel.{parameter}"
    said = channel if parameter == "channel" else parameter  # What the study writes.
    if recorded is None:
        raise MotionError(
            f"{said} needs a recorded motion that no effect has changed yet, and "
            f"{motion.name!r} is none; leave it out, or apply it together with the other effects",
            key=key,
        )
    missing = recorded.record.lacking(channel)
    if missing:
        raise MotionError(
            f"{said} cannot be built for {motion.name!r}: {recorded.record.label} has no "
            f"{missing} channel; leave it out, or name a channel of the record",
            key=key,
        )
    try:
        built = other(recorded).motion(motion.time_step, name=motion.name)
    except MotionError as error:
        raise MotionError(
            f"{said} cannot be built for {motion.name!r}: {error}", key=key
        ) from error
    return trial.under(built)


class InputFilter(Effect):
    """How the recorded motion is turned into the driven one.

    A Butterworth filter of order 3, run forward and backward: gain 1 / (1 + (f / fc)^6), no delay.
    It comes right after `input_channel`, before all else that is done to the motion, `time_scale`
    included: `corner` is in the record's time.
    """

    name = "input_filter"
    meaning = "The motion is low-passed on its way into the simulation"
    parameters = (
        Parameter(
            "corner", "Hz", math.inf, 5.0, 40.0, "loguniform",
            "of the zero-phase low-pass; none given: no filter", limits=(1.0, 400.0),
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("table_bandwidth",)
    source = "Boore & Bommer (2005), Soil Dyn. Earthq. Eng. 25(2)"
    stage = "actuation"
    rank = 0

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        corner, motion = values["corner"], trial.motion
        # What lies beyond half the sampling rate passes everything.
        if corner >= 0.5 / motion.time_step:
            return trial
        # Amid rest, so that the filter rings out on both sides.
        pad = math.ceil(ACTUATION.smooth_rest / corner / motion.time_step)
        amid = np.pad(delayed(motion.displacement, pad), (0, pad), mode="edge")
        low_pass = Filter(low=0.0, high=corner, order=ACTUATION.filter_order)
        smooth = band_pass(amid, motion.time_step, low_pass)
        path = differentiate(smooth, motion.time_step)

        def beside(side: SideMotion) -> SideMotion:
            return held_side(delayed_side(side, pad), amid.size)

        return driven(trial, path, f"low-pass {corner:g} Hz", beside)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        slope = 2 * ACTUATION.filter_order
        return {"corner": half_passed(first["corner"], second["corner"], slope)}


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
        return trial.under(motion.scaled(1.0 + values["change"], name=motion.name))


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
    source = "servo-hydraulic tables in closed loop; Trombetti & Conte (2002), J. Earthq. Eng."
    stage = "actuation"
    rank = 3

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion, corner = trial.motion, values["corner"]
        step = motion.time_step
        late = round(values["delay"] / step)
        if math.isfinite(corner):
            rings = ringing_samples(corner, ACTUATION.low_pass_damping, step)
            x = np.pad(delayed(motion.displacement, late), (0, rings), mode="edge")
            path = low_passed(x, corner, ACTUATION.low_pass_damping, step)
        else:
            path = LazyPath(
                delayed(motion.displacement, late),
                delayed(motion.velocity, late),
                lambda: delayed(motion.acceleration, late),
            )
        note = f"low-pass {corner:g} Hz, {late} samples late"
        return driven(trial, path, note, lambda side: delayed_side(side, late))

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        corner = half_passed(first["corner"], second["corner"], 4)
        return {"corner": corner, "delay": first["delay"] + second["delay"]}


class TableSaturation(Effect):
    """A table at its limits.

    Where the command exceeds a cap the acceleration is clipped and integrated again. A critically
    damped loop, within the caps, brings the table back to its command: soon where its displacement
    is controlled, late where its acceleration is. Two seconds after the motion it brakes.
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
        Parameter(
            "return_frequency", "Hz", 3.0, 0.03, 5.0, "loguniform",
            "of the loop that brings the table back", limits=(0.01, 50.0), secondary=True,
        ),
    )  # fmt: skip
    channels = ("motion", "tilt")
    confounded_with = ("table_bandwidth",)
    source = "limits of pump and force of servo-hydraulic tables"
    stage = "actuation"
    rank = 4

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        motion, step = trial.motion, trial.motion.time_step
        velocity, acceleration = values["velocity"], values["acceleration"]
        most = 1 + ACTUATION.over_cap
        if motion.pgv_m_s <= most * velocity and motion.peak_acceleration <= most * acceleration:
            return trial
        path: Path = held(motion, round(ACTUATION.saturated_rest / step))
        path = limited(path, velocity, acceleration, step, loop=values["return_frequency"])
        path = braked(path, min(acceleration, ACTUATION.braking), step)
        return driven(trial, path, f"capped at {velocity:g} m/s and {acceleration:g} m/s^2")

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        """The lower caps, and the return of the table that they are of.

        What keeps to the lower caps is left alone by others. Where each has a lower one, the table
        comes back as late as the later.
        """
        caps = ("velocity", "acceleration")
        lower = [
            one
            for one, other in ((first, second), (second, first))
            if any(one[name] < other[name] for name in caps)
        ] or [first]
        frequency = min(one["return_frequency"] for one in lower)
        return {name: min(first[name], second[name]) for name in caps} | {
            "return_frequency": frequency
        }


class TableResonance(Effect):
    """A soft table.

    The table obeys y'' + 2 zeta w (y' - x') + w^2 (y - x) = 0, solved exactly. Its gain at the
    frequency is sqrt(1 + 1 / (4 zeta^2)), which sets zeta; amplification 1 is a rigid table.
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
        rings = 0, ringing_samples(frequency, ratio, step)
        x, rate = np.pad(motion.displacement, rings, mode="edge"), np.pad(motion.velocity, rings)
        path = base_excited(x, rate, frequency, ratio, step)
        return driven(trial, path, f"mode at {frequency:g} Hz, damping {ratio:.4g}")
