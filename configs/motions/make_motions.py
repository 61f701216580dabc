"""Make the synthetic records of this folder: `python configs/motions/make_motions.py`.

Each is noise shaped by `vsr2.motion.shaped_noise`, low-passed at 20 Hz. Its ground frequency f_g is
bisected until PGV/PGA is the one asked for, and the amplitude scaled to PGA; both are measured on
the motion that is driven at a time step of 1 ms.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.motion import (
    STANDARD_GRAVITY,
    Motion,
    Record,
    build_recorded_motion,
    shaped_noise,
)
from vsr2.motion.synthetic import SYNTHETIC

Array = NDArray[np.float64]

INTERVAL = SYNTHETIC.interval
"""Sampling interval [s]."""
DECIMALS = 7
"""Of the displacement: 0.1 micrometre, which moves the acceleration by less than 0.01 m/s^2."""


@dataclass(frozen=True)
class Recipe:
    """What a record is made from: PGA [g], PGV/PGA [s], duration [s], the noise's seed."""

    name: str
    pga: float
    pgv_pga_s: float
    duration: float
    seed: int


RECIPES = (
    Recipe("synthetic_01", 0.10, 0.06, 12.0, 101),
    Recipe("synthetic_02", 0.20, 0.03, 10.0, 102),
    Recipe("synthetic_03", 0.20, 0.10, 14.0, 103),
    Recipe("synthetic_04", 0.30, 0.05, 12.0, 104),
    Recipe("synthetic_05", 0.30, 0.15, 16.0, 105),
    Recipe("synthetic_06", 0.40, 0.04, 10.0, 106),
    Recipe("synthetic_07", 0.40, 0.08, 14.0, 107),
    Recipe("synthetic_08", 0.50, 0.12, 16.0, 108),
    Recipe("synthetic_09", 0.60, 0.03, 10.0, 109),
    Recipe("synthetic_10", 0.60, 0.07, 12.0, 110),
    Recipe("synthetic_11", 0.80, 0.05, 12.0, 111),
    Recipe("synthetic_12", 0.80, 0.10, 16.0, 112),
)


def displacement(recipe: Recipe) -> Array:
    """Displacement of a recipe at `INTERVAL`, shape (n,) [m], rounded as in its file."""
    low, high = 0.3, 20.0
    for _ in range(40):
        middle = (low * high) ** 0.5
        # a higher ground frequency means more acceleration for the same velocity
        if driven(recipe, noise(recipe, middle)).pgv_pga_s > recipe.pgv_pga_s:
            low = middle
        else:
            high = middle
    raw = noise(recipe, (low * high) ** 0.5)
    scale = recipe.pga * STANDARD_GRAVITY / driven(recipe, raw).peak_acceleration
    return np.round(scale * raw, DECIMALS)


def noise(recipe: Recipe, ground_frequency: float) -> Array:
    """Displacement of arbitrary scale for a ground frequency [Hz], at rest at both ends."""
    return shaped_noise(recipe.duration, ground_frequency, recipe.seed)


def driven(recipe: Recipe, moved: Array) -> Motion:
    """The motion a study makes of `moved` at a time step of 1 ms."""
    return build_recorded_motion(Record(recipe.name, INTERVAL, displacement=moved), 0.001)


def text(recipe: Recipe) -> str:
    """The record as a file in the neutral form."""
    rows = [
        f"# synthetic, seed {recipe.seed}: PGA {recipe.pga:.2f} g, "
        f"PGV/PGA {recipe.pgv_pga_s:.2f} s",
        "time_s,displacement_m",
    ]
    rows += [
        f"{index * INTERVAL:.3f},{value + 0.0:.{DECIMALS}f}"  # + 0.0 takes the sign off -0
        for index, value in enumerate(displacement(recipe))
    ]
    return "\n".join(rows) + "\n"


def main() -> None:
    """Write every record into a folder."""
    parser = argparse.ArgumentParser(description="Make the synthetic records of this folder.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder")
    folder = parser.parse_args().out
    for recipe in RECIPES:
        path = folder / f"{recipe.name}.csv"
        path.write_text(text(recipe), encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
