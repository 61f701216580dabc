"""Figures of the library of effects: docs/results/effects/NAME.png, one an effect.

Left: the tilt of a block with and without the effect, at the far end of its prior, under one pulse.
Right: the overturning diagram: the least PGA of a cosine pulse that overturns the block, over
PGV/PGA, for both. Run from the repository's root (about five minutes on one core):

    python studies/figure_effects.py [NAME ...]
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2 import run_batch
from vsr2.config.study import Output
from vsr2.effects import Effect, effect, in_order, library
from vsr2.motion import STANDARD_GRAVITY
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation import Trial
from vsr2.simulation.bench import EffectBench, trial_of
from vsr2.simulation.effects import with_effects

OUT = Path("docs/results/effects")
RATIOS = np.array([0.08, 0.10, 0.13, 0.17, 0.22])
"""PGV/PGA [s]."""
LOWEST, HIGHEST, STEPS = 0.3, 2.2, 7
"""PGA between which the least is looked for [g], and halvings."""
PULSE = (6.5, 1.6)
"""PGA [m/s^2] and frequency [Hz] of the response on the left."""
OWN_PULSE = {"friction_rate": (16.0, 4.0), "spin_friction": (16.0, 4.0)}
"""Of effects that show only where the rock slides."""
TURNED = ("spin_friction", "placement", "off_axis_motion")
"""Effects shown on a block that stands at 30 degrees."""


def with_it(trials: list[Trial], one: Effect) -> list[Trial]:
    """Trials with the effect at the far end of its prior, late in the campaign."""
    values = one.extreme()
    if one.name == "outcome_rule":
        values["tilt"], values["flips"] = 0.3, 0.0
    return with_effects(trials, [(one, values)], orders=[1.0] * len(trials))


def response(bench: EffectBench, one: Effect) -> tuple[NDArray[np.float64], ...]:
    """Times [s] and tilts [degree] without and with the effect."""
    setup = bench.block()
    if one.name in TURNED:
        turn = multiply(yaw_quaternion(math.radians(30)), setup.start.orientation)
        setup = replace(setup, start=Pose(setup.start.position, turn))
    pga, frequency = OWN_PULSE.get(one.name, PULSE)
    trial = trial_of(replace(setup, motion=bench.pulse(pga, frequency)), tail=2.0)
    result = run_batch([trial, *with_it([trial], one)], threads=1)
    out = []
    for log in result.logs:
        assert log is not None
        shaken = log.time >= 0
        out += [log.time[shaken], np.degrees(log.tilt[shaken])]
    return tuple(out)


def least_pga(bench: EffectBench, one: Effect | None) -> NDArray[np.float64]:
    """Least PGA that overturns the block, for each PGV/PGA, by bisection [g]."""
    base = replace(trial_of(bench.block(), tail=4.0), output=Output(log_every=0))
    low, high = np.full(RATIOS.size, LOWEST), np.full(RATIOS.size, HIGHEST)
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        trials = [
            replace(base, motion=bench.pulse(a * STANDARD_GRAVITY, 1 / (2 * math.pi * ratio)))
            for a, ratio in zip(middle, RATIOS, strict=True)
        ]
        result = run_batch(trials if one is None else with_it(trials, one), threads=1)
        fell = result["outcome"] == "overturned"
        high, low = np.where(fell, middle, high), np.where(fell, low, middle)
    least = 0.5 * (low + high)
    return np.where(least > 0.98 * HIGHEST, np.nan, least)


def draw(one: Effect, series: tuple[NDArray[np.float64], ...], plain: object, own: object) -> None:
    """Write the figure of an effect."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.4, 2.2), layout="constrained")
    left.plot(series[0], series[1], color="0.6", label="without")
    left.plot(series[2], series[3], color="C3", lw=1.0, label="with")
    left.set(xlabel="time [s]", ylabel="tilt [degree]")
    left.set_ylim(0, min(90.0, 1.15 * max(series[1].max(), series[3].max())))
    left.legend(frameon=False, fontsize=7)
    right.plot(RATIOS, plain, "o-", color="0.6", ms=3)
    right.plot(RATIOS, own, "s-", color="C3", ms=3, lw=1.0)
    right.set(xlabel="PGV/PGA [s]", ylabel="least PGA [g]", ylim=(0, HIGHEST))
    figure.suptitle(one.name, fontsize=9)
    OUT.mkdir(parents=True, exist_ok=True)
    figure.savefig(OUT / f"{one.name}.png", dpi=80)
    pyplot.close(figure)


def main() -> None:
    """Write the figures of the effects named, or of all; and the table of thresholds."""
    bench = EffectBench()
    effects = [effect(name) for name in sys.argv[1:]] or in_order(library())
    plain = least_pga(bench, None)
    rows = ["effect," + ",".join(f"{ratio:g}" for ratio in RATIOS)]
    rows.append("none," + ",".join(f"{value:.3f}" for value in plain))
    for one in effects:
        own = least_pga(bench, one)
        draw(one, response(bench, one), plain, own)
        rows.append(f"{one.name}," + ",".join(f"{value:.3f}" for value in own))
        print(rows[-1], flush=True)
    if len(sys.argv) == 1:
        text = "# least PGA [g] that overturns the block, over PGV/PGA [s]; nan: none up to 2.2 g\n"
        (OUT / "thresholds.csv").write_text(text + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
