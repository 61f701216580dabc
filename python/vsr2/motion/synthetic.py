"""Earthquake-like motions for users without records.

Seeded Gaussian noise, shaped in time by an envelope and in frequency by the spectrum of Kanai
(1957) and Tajimi (1960) for ground of natural frequency f_g and damping 0.6, high-passed at 0.2 f_g
(at least 0.2 Hz) so that the displacement returns to 0, and low-passed. Such motions stand for no
site and no earthquake; they have the intensity measures asked for, and nothing more is meant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.config.seeds import checked_seed
from vsr2.errors import MotionError
from vsr2.motion.measures import significant_duration
from vsr2.motion.motion import Array, Motion
from vsr2.motion.record import Record
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.study_motions import build_recorded_motion


@dataclass(frozen=True)
class SyntheticConstants:
    """How noise is shaped and tuned; chosen by hand where no source is named.

    Attributes:
        interval: of the samples at which the noise is shaped [s]: that of many records.
        least_samples: of the Fourier transform, zeros after the record included.
        ground_damping: of the ground, as a share of critical; Kanai (1957) and Tajimi (1960) give
            0.6 for firm ground.
        strongest: where the envelope is strongest, as a share of the record.
        envelope_power: of t/t_s exp(1 - t/t_s).
        high_pass: corner over the ground frequency.
        least_high_pass: of that corner [Hz].
        low_pass: corner, unless a high ground frequency raises it [Hz].
        low_pass_ratio: least corner over the ground frequency.
        filter_power: of frequency over corner, twice the order of a Butterworth filter of order 4.
        ramp: over which the record begins and ends at rest [s].
        ground_frequencies: tried, least and greatest [Hz].
        halvings: of their range, in the logarithm: to 1e-4 of the frequency.
        start_length: first length tried, over the significant duration; the envelope has about
            this ratio of record to 5-95 % duration.
        stretch: least and greatest change of the length in one round.
        least_length: of a record, which its two ramps leave room in [s].
        rounds: of tuning length and frequency to one noise.
        attempts: noises tried of one seed.
        pgv_pga_tolerance: relative, of the motion as driven; its PGA is exact.
        duration_tolerance: relative, of the significant duration.
        pgv_pga_range: that a motion can have [s].
        least_cycles: significant duration in periods 2 pi PGV/PGA.
        duration_range: of the significant duration [s].
        greatest_pga_g: [g].
    """

    interval: float = 0.005
    least_samples: int = 8192
    ground_damping: float = 0.6
    strongest: float = 0.3
    envelope_power: int = 3
    high_pass: float = 0.2
    least_high_pass: float = 0.2
    low_pass: float = 20.0
    low_pass_ratio: float = 1.5
    filter_power: int = 8
    ramp: float = 1.0
    ground_frequencies: tuple[float, float] = (0.2, 45.0)
    halvings: int = 16
    start_length: float = 2.2
    stretch: tuple[float, float] = (0.5, 2.0)
    least_length: float = 1.5
    rounds: int = 6
    attempts: int = 40
    pgv_pga_tolerance: float = 0.01
    duration_tolerance: float = 0.03
    pgv_pga_range: tuple[float, float] = (0.012, 0.4)
    least_cycles: float = 2.0
    duration_range: tuple[float, float] = (2.0, 300.0)
    greatest_pga_g: float = 100.0


SYNTHETIC = SyntheticConstants()


def shaped_noise(
    duration: float, ground_frequency: float, seed: int, *, low_pass: float = SYNTHETIC.low_pass
) -> Array:
    """Displacement of arbitrary scale, every `SYNTHETIC.interval`, at rest at 0 at both ends.

    Args:
        duration: from the first to the last sample [s]; the envelope
            (t/t_s exp(1 - t/t_s))^3 is strongest at t_s = 0.3 of it.
        ground_frequency: f_g [Hz].
        seed: of the noise.
        low_pass: corner of the low-pass [Hz].

    Raises:
        MotionError: what is no seed.
    """
    seed = checked_seed(seed, MotionError, "shaped noise: seed")
    return _shaped_noise(duration, ground_frequency, seed, low_pass)


def _shaped_noise(duration: float, ground_frequency: float, seed: int, low_pass: float) -> Array:
    """As :func:`shaped_noise`, for any seed that numpy takes."""
    count = round(duration / SYNTHETIC.interval) + 1
    time = np.arange(count) * SYNTHETIC.interval
    strongest = SYNTHETIC.strongest * duration
    envelope = (time / strongest * np.exp(1 - time / strongest)) ** SYNTHETIC.envelope_power
    noise = np.random.default_rng(seed).standard_normal(count) * envelope

    # zeros after the record, so that the filters do not wrap round
    length = max(SYNTHETIC.least_samples, 2 ** math.ceil(math.log2(2 * count)))
    frequency = np.fft.rfftfreq(length, SYNTHETIC.interval)
    r2 = (frequency / ground_frequency) ** 2
    damping = (2 * SYNTHETIC.ground_damping) ** 2 * r2
    ground = np.sqrt((1 + damping) / ((1 - r2) ** 2 + damping))
    safe = np.maximum(frequency, 1e-9)
    corner = max(SYNTHETIC.least_high_pass, SYNTHETIC.high_pass * ground_frequency)
    power = SYNTHETIC.filter_power
    band = 1 / np.sqrt((1 + (corner / safe) ** power) * (1 + (frequency / low_pass) ** power))
    spectrum = np.fft.rfft(noise, length) * ground * band / -((2 * np.pi * safe) ** 2)
    spectrum[0] = 0
    moved = np.fft.irfft(spectrum, length)[:count]

    ramp = np.minimum(time / SYNTHETIC.ramp, 1.0)
    blend = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    shaped: Array = moved * blend * blend[::-1]
    return shaped


@checked_names(MotionError)
def synthetic_motion(
    pga_g: float,
    pgv_pga_s: float,
    duration: float,
    seed: int,
    time_step: float,
    *,
    name: str | None = None,
) -> Motion:
    """An earthquake-like motion with the intensity measures asked for.

    As driven at `time_step` its PGA is `pga_g` to rounding, its PGV/PGA within 1 % of `pgv_pga_s`,
    and its significant duration (5-95 %) within 3 % of `duration`. The ground frequency and the
    envelope's length are tuned to the noise; noise that cannot be tuned is replaced by the next of
    the same seed, so that a seed gives one motion.

    Args:
        pga_g: [g].
        pgv_pga_s: [s], 0.012 to 0.4.
        duration: significant duration [s]; at least two periods 2 pi PGV/PGA and 2 s, at most 300.
        seed: not negative.
        time_step: of the simulation [s].
        name: by default from the measures and the seed.

    Raises:
        MotionError: a value is out of these ranges, or no noise could be tuned.
    """
    _check(pga_g, pgv_pga_s, duration, seed)
    label = (
        name or f"synthetic_pga{pga_g:.12g}g_pgv_pga{pgv_pga_s:.12g}s_d{duration:.12g}s_seed{seed}"
    )
    for attempt in range(SYNTHETIC.attempts):
        # a sequence of its own for every attempt of every seed
        noise_seed = int(np.random.SeedSequence([seed, attempt]).generate_state(1, np.uint64)[0])
        motion = _tuned(pga_g, pgv_pga_s, duration, noise_seed, time_step, label)
        if motion is not None:
            source = (
                f"synthetic, seed {seed} (noise {attempt + 1}): PGA {pga_g:.12g} g, PGV/PGA "
                f"{pgv_pga_s:.12g} s, significant duration {duration:.12g} s"
            )
            return replace(motion, name=label, source=source, recorded=None)
    raise MotionError(
        f"synthetic motion with PGV/PGA {pgv_pga_s:g} s and a significant duration of {duration:g} "
        f"s: none of {SYNTHETIC.attempts} noises of seed {seed} could be tuned to it; take another "
        "seed, or a longer duration"
    )


def _check(pga_g: float, pgv_pga_s: float, duration: float, seed: int) -> None:
    most = SYNTHETIC.greatest_pga_g
    if not (math.isfinite(pga_g) and 0 < pga_g <= most):
        raise MotionError(
            f"synthetic motion: pga_g is {pga_g} g; it must lie above 0, up to {most:g} g"
        )
    low, high = SYNTHETIC.pgv_pga_range
    if not low <= pgv_pga_s <= high:
        raise MotionError(
            f"synthetic motion: pgv_pga_s is {pgv_pga_s} s; it must lie from {low:g} to {high:g} s"
        )
    shortest, longest = SYNTHETIC.duration_range
    least = max(shortest, SYNTHETIC.least_cycles * 2 * math.pi * pgv_pga_s)
    if not least <= duration <= longest:
        raise MotionError(
            f"synthetic motion: duration is {duration} s; with PGV/PGA {pgv_pga_s:g} s it must lie "
            f"from {least:.3g} to {longest:g} s"
        )
    checked_seed(seed, MotionError, "synthetic motion: seed")


def _tuned(
    pga_g: float, pgv_pga_s: float, duration: float, seed: int, time_step: float, label: str
) -> Motion | None:
    """The motion of this noise, or None where its measures cannot be brought to those asked for."""
    total = SYNTHETIC.start_length * duration + SYNTHETIC.ramp
    for _ in range(SYNTHETIC.rounds):
        if total / min(time_step, SYNTHETIC.interval) > MAX_SAMPLES:
            return None
        frequency = _ground_frequency(total, pgv_pga_s, seed)
        moved = _shaped(total, frequency, seed)
        motion = build_recorded_motion(
            Record(label, SYNTHETIC.interval, displacement=moved / np.abs(moved).max()), time_step
        ).scaled_to_pga_g(pga_g)
        reached = significant_duration(motion.acceleration, time_step)
        long_enough = abs(reached - duration) <= SYNTHETIC.duration_tolerance * duration
        if (
            long_enough
            and abs(motion.pgv_pga_s - pgv_pga_s) <= SYNTHETIC.pgv_pga_tolerance * pgv_pga_s
        ):
            return motion
        # the ramps do not stretch with the envelope
        low, high = SYNTHETIC.stretch
        total = max(SYNTHETIC.least_length, total * min(max(duration / reached, low), high))
    return None


def _shaped(duration: float, ground_frequency: float, seed: int) -> Array:
    low_pass = max(SYNTHETIC.low_pass, SYNTHETIC.low_pass_ratio * ground_frequency)
    return _shaped_noise(duration, ground_frequency, seed, low_pass)


def _ground_frequency(duration: float, pgv_pga_s: float, seed: int) -> float:
    low, high = SYNTHETIC.ground_frequencies
    for _ in range(SYNTHETIC.halvings):
        middle = math.sqrt(low * high)
        # a higher ground frequency means more acceleration for the same velocity
        if _ratio(_shaped(duration, middle, seed)) > pgv_pga_s:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


def _ratio(displacement: Array) -> float:
    """PGV/PGA [s], by differences: near enough to tune by, and cheap."""
    velocity = np.diff(displacement)
    return float(np.abs(velocity).max() / np.abs(np.diff(velocity)).max()) * SYNTHETIC.interval
