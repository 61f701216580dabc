"""Figures of the library of effects: docs/results/effects/NAME.png, one an effect.

Left: the tilt of a block with and without the effect under one pulse. Right: the overturning
diagram: where in the plane of PGV/PGA and PGA a cosine pulse overturns the block, for both. Run
from the repository's root (about two minutes on one core):

    python studies/figure_effects.py [NAME ...]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2 import run_batch
from vsr2.config.study import Output
from vsr2.effects import Effect, effect, in_order, library, with_effects
from vsr2.motion import STANDARD_GRAVITY
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.simulation.bench import EffectBench, with_tail
from vsr2.trial import Trial

Array = NDArray[np.float64]

OUT = Path("docs/results/effects")
RATIOS = np.geomspace(0.06, 0.3, 14)
"""PGV/PGA [s]."""
PGAS = np.linspace(0.3, 2.2, 39)
"""[g]."""
PULSE = (5.5, 1.6)
"""PGA [m/s^2] and frequency [Hz] of the response on the left."""
OWN_PULSE = {
    "friction": (9.0, 3.0), "friction_rate": (16.0, 4.0), "spin_friction": (16.0, 4.0),
    "catch": (6.5, 1.6),
}  # fmt: skip
"""Of effects that show elsewhere only: where the rock slides, or is about to overturn."""
TURNED = ("spin_friction", "placement", "off_axis_motion")
"""Effects shown on a block that stands at 30 degrees, in both panels."""
MILD = {
    "friction": {"factor": 0.75},
    "adhesion": {"strength": 15.0},
    "catch": {"slack": 15.0},
    "table_saturation": {"velocity": 0.45, "acceleration": 20.0},
    "table_pitch": {"compliance": 0.005},
    "outcome_rule": {"tilt": 0.2, "flips": 0.0},
    "registration": {"yaw": 40.0, "lean": 1.0},
    "session": {"registration_yaw": 20.0, "table_gain_change": -0.1},
}
"""Values of effects at whose far end nothing rocks or all does; the others are shown at that."""


def values_of(one: Effect) -> dict[str, float]:
    """Values at which an effect is shown."""
    return one.complete(MILD.get(one.name, one.extreme()))


def with_it(trials: list[Trial], one: Effect) -> list[Trial]:
    """Trials with the effect, late in the campaign."""
    return with_effects(trials, [(one, values_of(one))], relative_order=[1.0] * len(trials))


def response(bench: EffectBench, one: Effect) -> tuple[Array, ...]:
    """Times [s] and tilts [degree] without and with the effect."""
    standing = turned(bench) if one.name in TURNED else bench.block()
    pga, frequency = OWN_PULSE.get(one.name, PULSE)
    trial = with_tail(replace(standing, motion=bench.pulse(pga, frequency)), 2.0)
    result = run_batch([trial, *with_it([trial], one)], threads=1)
    out = []
    for log in result.logs:
        assert log is not None
        shaken = log.time >= 0
        out += [log.time[shaken], np.degrees(log.tilt[shaken])]
    return tuple(out)


def turned(bench: EffectBench) -> Trial:
    """The block at 30 degrees."""
    block = bench.block()
    start = block.start_pose
    turn = multiply(yaw_quaternion(math.radians(30)), start.orientation)
    return replace(block, start=Pose(start.position, turn))


def overturned(bench: EffectBench, standing: Trial, one: Effect | None) -> NDArray[np.bool_]:
    """Whether each pulse overturns the block, shape (PGA, PGV/PGA)."""
    base = replace(with_tail(standing, 3.0), output=Output(log_every=0))
    trials = [
        replace(base, motion=bench.pulse(pga * STANDARD_GRAVITY, 1 / (2 * math.pi * ratio)))
        for pga in PGAS
        for ratio in RATIOS
    ]
    result = run_batch(trials if one is None else with_it(trials, one), threads=1)
    fell = result.overturned.reshape(PGAS.size, RATIOS.size)
    return fell


def least(fell: NDArray[np.bool_]) -> Array:
    """Least PGA that overturns, for each PGV/PGA; NaN: none [g]."""
    return np.where(fell.any(axis=0), PGAS[np.argmax(fell, axis=0)], np.nan)


def title(one: Effect) -> str:
    """Name and values of an effect."""
    parts = []
    given = values_of(one)
    for parameter in one.parameters:
        value = given[parameter.name]
        if parameter.secondary or parameter.choices or parameter.is_null(value):
            continue
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        parts.append(f"{parameter.name} {value:.3g}{unit}")
    return f"{one.name}: {', '.join(parts)}"


def draw(
    one: Effect, series: tuple[Array, ...], plain: NDArray[np.bool_], own: NDArray[np.bool_]
) -> None:
    """Write the figure of an effect."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.4, 2.3), layout="constrained")
    left.plot(series[0], series[1], color="0.55", lw=1.8, label="without")
    left.plot(series[2], series[3], color="C3", lw=1.0, label="with")
    left.set(xlabel="time [s]", ylabel="tilt [degree]")
    top = min(90.0, 1.35 * max(series[1].max(), series[3].max()))
    left.set_ylim(0, top)
    if one.name == "outcome_rule":
        threshold = math.degrees(values_of(one)["tilt"])
        left.axhline(threshold, color="C3", ls="--", lw=0.8)
        left.text(1.2, threshold, "overturned from here", fontsize=6, va="bottom", color="C3")
    left.legend(frameon=False, fontsize=7, ncols=2, loc="upper right")
    # Each trial is a cell of its own; nothing is smoothed.
    right.pcolormesh(
        RATIOS, PGAS, np.where(plain, 1.0, np.nan), cmap="Greys", vmin=0, vmax=3, shading="nearest"
    )
    x, y = np.meshgrid(RATIOS, PGAS)
    right.scatter(x[own], y[own], s=3.0, color="C3", linewidths=0)
    right.set(xlabel="PGV/PGA [s]", ylabel="PGA [g]", ylim=(PGAS[0], PGAS[-1]), xscale="log")
    right.set_xticks([0.06, 0.1, 0.2, 0.3], ["0.06", "0.1", "0.2", "0.3"])
    right.minorticks_off()
    right.set_title("overturns: grey without, dots with", fontsize=7)
    figure.suptitle(title(one), fontsize=8)
    OUT.mkdir(parents=True, exist_ok=True)
    figure.savefig(OUT / f"{one.name}.png", dpi=80)
    pyplot.close(figure)


def main() -> None:
    """Write the figures of the effects named, or of all; and the table of thresholds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    names = parser.parse_args().names
    bench = EffectBench(mode="auto")
    effects = [effect(name) for name in names] or in_order(library())
    standing = {False: bench.block(), True: turned(bench)}
    plain = {at: overturned(bench, trial, None) for at, trial in standing.items()}
    rows = ["effect," + ",".join(f"{ratio:.3f}" for ratio in RATIOS)]
    for at, name in ((False, "none"), (True, "none at 30 degrees")):
        rows.append(f"{name}," + ",".join(f"{value:.2f}" for value in least(plain[at])))
    for one in effects:
        at = one.name in TURNED
        own = overturned(bench, standing[at], one)
        draw(one, response(bench, one), plain[at], own)
        rows.append(f"{one.name}," + ",".join(f"{value:.2f}" for value in least(own)))
        print(rows[-1], flush=True)
    if not names:
        text = (
            "# least PGA [g] that overturns the block, over PGV/PGA [s]; nan: none up to 2.2 g; "
            f"{', '.join(TURNED)}: on the block at 30 degrees\n"
        )
        (OUT / "thresholds.csv").write_text(text + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
