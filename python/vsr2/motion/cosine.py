"""Cosine pulses: one pulse, and a grid of them over PGA and PGV/PGA (supplement S1.3)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from vsr2.argument_names import checked_names
from vsr2.config.motion_source import MIN_STEPS_A_PERIOD, GridCosine, Range
from vsr2.errors import MotionError
from vsr2.motion.motion import Motion
from vsr2.motion.samples import MAX_SAMPLES
from vsr2.motion.units import STANDARD_GRAVITY


@checked_names(MotionError)
def cosine_parameters(pga_g: float, pgv_pga_s: float) -> tuple[float, float]:
    """Amplitude A [m] and frequency F [Hz] of the pulse with these intensity measures.

    From x(t) = A (1 - cos 2 pi F t): PGA = A (2 pi F)^2 and PGV = A 2 pi F, so that
    F = 1 / (2 pi PGV/PGA) and A = PGA (PGV/PGA)^2.

    Args:
        pga_g: [g], g = 9.80665 m/s^2.
        pgv_pga_s: PGV/PGA [s].

    Raises:
        MotionError: a value is not positive and finite.
    """
    _require_positive(("pga_g [g]", pga_g), ("pgv_pga_s [s]", pgv_pga_s))
    return pga_g * STANDARD_GRAVITY * pgv_pga_s**2, 1 / (2 * math.pi * pgv_pga_s)


def cosine_measures(amplitude: float, frequency: float) -> tuple[float, float]:
    """PGA [g] and PGV/PGA [s] of the pulse; the inverse of :func:`cosine_parameters`.

    Args:
        amplitude: A [m].
        frequency: F [Hz].

    Raises:
        MotionError: a value is not positive and finite.
    """
    _require_positive(("amplitude [m]", amplitude), ("frequency [Hz]", frequency))
    omega = 2 * math.pi * frequency
    return amplitude * omega**2 / STANDARD_GRAVITY, 1 / omega


def cosine_motion(
    amplitude: float, frequency: float, time_step: float, *, name: str | None = None
) -> Motion:
    """One period of x(t) = A (1 - cos 2 pi F t), then rest at 0.

    Every sample is the exact value of displacement, velocity and acceleration at its time; nothing
    is stretched to fit the time step. The pulse lasts 1/F; the last sample is the first at or
    after 1/F (within a billionth of a step) and is at rest: x = v = a = 0. So a period that is no
    multiple of the time step keeps its F, and the motion's `duration` is 1/F rounded up to steps.

    Args:
        amplitude: A [m]; the pulse peaks at 2 A.
        frequency: F [Hz].
        time_step: interval between samples [s].
        name: by default from A and F.

    Raises:
        MotionError: a value is not positive and finite, the period has fewer than 10 steps (then
            samples miss more than 1 - cos(pi / 10) = 5 % of the peak velocity), or the motion more
            than `MAX_SAMPLES` samples.
    """
    _require_positive(
        ("amplitude [m]", amplitude), ("frequency [Hz]", frequency), ("time step [s]", time_step)
    )
    label = f"cosine_A{amplitude:.12g}m_F{frequency:.12g}Hz" if name is None else name
    steps = 1 / frequency / time_step
    period = (
        f"motion {label!r}: the period 1/F = {1 / frequency:g} s has {steps:.3g} time steps of "
        f"{time_step:g} s"
    )
    if steps < MIN_STEPS_A_PERIOD:
        raise MotionError(
            f"{period}; it needs at least {MIN_STEPS_A_PERIOD}: lower the frequency (raise "
            "PGV/PGA) or the time step"
        )
    if steps > MAX_SAMPLES - 2:
        raise MotionError(
            f"{period}; at most {MAX_SAMPLES - 2}: raise the frequency (lower PGV/PGA) or the time "
            "step"
        )
    omega = 2 * math.pi * frequency
    phase = omega * (np.arange(math.ceil(steps - 1e-9) + 1) * time_step)
    with np.errstate(over="ignore", invalid="ignore"):  # Motion refuses these and names the sample
        # 2 sin^2(phase / 2) is 1 - cos(phase) without the cancellation near 0 and near the end
        displacement = 2 * amplitude * np.sin(phase / 2) ** 2
        velocity = amplitude * omega * np.sin(phase)
        acceleration = amplitude * omega**2 * np.cos(phase)
    for signal in (displacement, velocity, acceleration):
        signal[-1] = 0.0
    pga_g, pgv_pga_s = cosine_measures(amplitude, frequency)
    return Motion(
        name=label,
        time_step=time_step,
        displacement=displacement,
        velocity=velocity,
        acceleration=acceleration,
        kind="cosine",
        source=(
            f"cosine pulse, A = {amplitude:.12g} m, F = {frequency:.12g} Hz "
            f"(PGA {pga_g:.6g} g, PGV/PGA {pgv_pga_s:.6g} s)"
        ),
    )


def cosine_name(pga_g: float, pgv_pga_s: float) -> str:
    """Name of the pulse with PGA [g] and PGV/PGA [s], as the grid uses it."""
    return f"cosine_pga{pga_g:.12g}g_pgv_pga{pgv_pga_s:.12g}s"


def grid_values(values: Range) -> list[float]:
    """The values of `values`: `min`, `min + step`, ... up to `max` (within 5e-7 step).

    Rounded to 12 significant digits, so that 0.1 + 2 x 0.1 reads 0.3.
    """
    return [float(f"{values.min + i * values.step:.12g}") for i in range(values.count)]


def grid_parameters(grid: GridCosine) -> Iterator[tuple[float, float]]:
    """PGA [g] and PGV/PGA [s] of every pulse of the grid, PGV/PGA running fastest."""
    ratios = grid_values(grid.pgv_pga_s)
    for pga_g in grid_values(grid.pga_g):
        for ratio in ratios:
            yield pga_g, ratio


def _require_positive(*named: tuple[str, float]) -> None:
    for name, value in named:
        if not (math.isfinite(value) and value > 0):
            raise MotionError(f"cosine pulse: {name} is {value}; it must be positive and finite")
