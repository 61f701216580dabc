"""Effects that theory says are one: docs/results/effects/equivalences.csv and .png.

With phi = tilt / alpha the planar equation of rocking holds the motion as a / (g tan alpha) only
(Housner 1963). So a gain of 1 + k, a slenderness of 1 / (1 + k), and a stiff pitch of c rad/g under
a sine of frequency w, which acts like k = c (1 + w^2 / p^2), must give the same tilt relative to
alpha. That is of a table that does not feel the rock; the last column is of the default table, 1000
kg m, which the block of 778 kg swings along with. Run from the repository's root (under a minute):

    python studies/effect_equivalences.py
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsr2.effects import effect
from vsr2.motion import Motion
from vsr2.simulation.bench import EffectBench

OUT = Path("docs/results/effects")
BURSTS = ((4.5, 1.5), (4.5, 2.0), (6.0, 2.0), (5.5, 2.5))
"""Greatest acceleration [m/s^2] and frequency [Hz] of sines that swell and fade in four periods."""
GAINS = (-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06, 0.08)
NAMES = ("table_gain", "slenderness", "table_pitch", "table_pitch_default")
MOMENTS = (1e12, 1000.0)
"""Of the two tables that pitch [kg m]."""


def burst(bench: EffectBench, amplitude: float, frequency: float, periods: int = 4) -> Motion:
    """A sine that swells and fades: no jumps, so an oscillator above it follows statically."""
    step = bench.block().scene.engine.time_step
    time = np.arange(round(periods / frequency / step) + 1) * step
    envelope = np.sin(np.pi * time / time[-1]) ** 2
    a = amplitude * np.sin(2 * np.pi * frequency * time) * envelope
    v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * step)])
    v -= v[-1] * time / time[-1]
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * step)])
    return Motion("burst", step, x, np.append(v[:-1], 0.0), a, "recording")


def relative_tilts(bench: EffectBench, amplitude: float, frequency: float, k: float) -> list[float]:
    """Largest tilt over the block's slenderness angle, for effects of the same `k`, as `NAMES`."""
    trial = replace(bench.block(), motion=burst(bench, amplitude, frequency))
    alpha = math.atan2(0.2, 0.6)
    p_squared = 0.75 * trial.scene.engine.gravity / math.hypot(0.2, 0.6)
    compliance = k / (1 + (2 * math.pi * frequency) ** 2 / p_squared)
    pitch = {"compliance": compliance, "frequency": 20.0, "damping": 0.7, "depth": 0.0}

    def peak(name: str, values: dict[str, float]) -> float:
        return bench.run(trial, effect(name), values).observation.peak_tilt

    slender = math.atan2(0.2, 0.6 * (1 + k))
    return [
        peak("table_gain", {"change": k}) / alpha,
        peak("slenderness", {"change": 1 / (1 + k) - 1}) / slender,
        *(peak("table_pitch", pitch | {"moment": moment}) / alpha for moment in MOMENTS),
    ]


def main() -> None:
    """Write table and figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    bench = EffectBench("auto")
    figure, axes = pyplot.subplots(
        1, len(BURSTS), figsize=(8.0, 2.3), layout="constrained", sharey=True
    )
    rows = ["amplitude,frequency,k," + ",".join(NAMES)]
    for axis, (amplitude, frequency) in zip(axes, BURSTS, strict=True):
        table = np.array([relative_tilts(bench, amplitude, frequency, k) for k in GAINS])
        for k, tilts in zip(GAINS, table, strict=True):
            cells = ",".join(f"{tilt:.4f}" for tilt in tilts)
            rows.append(f"{amplitude},{frequency},{k},{cells}")
        for name, style, column in zip(NAMES, ("k-", "C0o", "C3x", "C3:"), table.T, strict=True):
            axis.plot(100 * np.array(GAINS), column, style, ms=4, lw=1.0, label=name)
        axis.set_title(f"{amplitude:g} m/s^2, {frequency:g} Hz", fontsize=8)
        axis.set_xlabel("k [%]")
    axes[0].set_ylabel("largest tilt / alpha")
    axes[0].legend(frameon=False, fontsize=7)
    figure.savefig(OUT / "equivalences.png", dpi=80)
    (OUT / "equivalences.csv").write_text("\n".join(rows) + "\n")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
