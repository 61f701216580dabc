"""What each parameter of the effect `support` does to the laboratory's specimen SP1.

    python studies/lab_support.py [--trials N] [--threads N] [--out FILE]

The scan stands as on the table, turned by -155 degrees about the vertical, and the displacement
drives. Columns: the support polygon (corners, area, distance of its nearest edge from the mass
centre's foot, height of the mass centre); and of N trials, each simulated again with its start
moved by a micrometre along x, along y and up and turned by a microradian: share whose outcome
changes, median and mean change of log10(largest tilt), share that overturns. The committed table is
docs/results/lab_support.csv. The data are taken from the folder VSR2_LAB_DATA, else ../shared/lab
beside the repository; they are not part of it.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab_sp1 import ROOT, lab_folder, lab_study
from vsr2.config import study_from_mapping
from vsr2.effects import apply_effects
from vsr2.effects.standing import downwards
from vsr2.effects.underside import settled_down
from vsr2.scene import Pose
from vsr2.scene.rotation import multiply, yaw_quaternion
from vsr2.scene.shapes import rock_points
from vsr2.simulation import run_batch, study_trials
from vsr2.trial import Trial

OUT = ROOT / "docs" / "results" / "lab_support.csv"
START = {
    "mode": "yaw",
    "yaw": -155.0,
    "base_orientation": [0.008432, 0.012905, -0.000109, 0.999881],
}
VALUES: tuple[dict[str, float], ...] = (
    {}, {"flat": 0.0003}, {"flat": 0.001}, {"flat": 0.003}, {"shrink": 0.005}, {"shrink": -0.005},
    {"rim": 0.005}, {"smoothing": 0.0003}, {"smoothing": 0.001}, {"flat": 0.001, "shrink": 0.01},
    {"flat": 0.001, "rim": 0.01},
)  # fmt: skip
MOVE = 1e-6
"""Of a start [m], [rad]."""
LEVEL = 2e-5
"""Points this little above the face on which the rock rests are of the polygon [m]."""


def moved(trial: Trial, axis: int) -> Trial:
    """The trial with its start moved along x, y or up, or turned about the vertical."""
    position, orientation = list(trial.start_pose.position), trial.start_pose.orientation
    if axis < 3:
        position[axis] += MOVE
    else:
        orientation = multiply(yaw_quaternion(MOVE), orientation)
    x, y, z = position
    return replace(trial, start=Pose((x, y, z), orientation))


def polygon(trial: Trial) -> list[str]:
    """Corners, area [cm^2], distance of the nearest edge [mm], height of the mass centre [mm]."""
    from scipy.spatial import ConvexHull

    points, center = rock_points(trial.scene.rock), trial.scene.rock.mass.mass_center
    down = settled_down(points, center, downwards(trial))
    reach = points @ down
    first = np.cross(down, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    low = points[reach > reach.max() - LEVEL] - center
    base = ConvexHull(low @ np.column_stack([first, np.cross(down, first)]))
    nearest = -float(base.equations[:, 2].max())
    height = float(reach.max() - center @ down)
    area = 1e4 * base.volume
    return [f"{len(base.vertices)}", f"{area:.1f}", f"{1e3 * nearest:.1f}", f"{1e3 * height:.2f}"]


def peaks(trials: list[Trial], threads: int) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each overturned, and log10 of its largest tilt [rad]."""
    found = run_batch(trials, threads=threads)
    assert found.judged.all()
    return found.overturned, np.log10(np.clip(found["peak_tilt"].astype(float), 1e-5, 1.0))


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    lab = lab_folder()
    wanted = lab_study(lab, inertia="mesh", drive="prescribed")
    rock = {**wanted["rock"], "file": str(lab / "models" / "final_sp1.obj"), "start": START}  # type: ignore[dict-item]
    study = study_from_mapping({**wanted, "rock": rock, "engine": {"mode": "fast"}}, base=ROOT)
    trials = study_trials(study)
    trials = [trials[i] for i in np.linspace(0, len(trials) - 1, options.trials).astype(int)]
    columns = [
        "support", "corners", "area_cm2", "nearest_edge_mm", "height_mm", "flipped",
        "median_change", "mean_change", "overturned",
    ]  # fmt: skip
    with options.out.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for values in VALUES:
            own = apply_effects(trials, {"support": values}) if values else trials
            fell, tilt = peaks(own, options.threads)
            others = [peaks([moved(t, k) for t in own], options.threads) for k in range(4)]
            flips = np.mean([other != fell for other, _ in others])
            change = np.abs([other - tilt for _, other in others])
            name = ", ".join(f"{key} {1e3 * value:g} mm" for key, value in values.items())
            row = [name or "none", *polygon(own[0]), f"{flips:.3f}"]
            row += [f"{np.median(change):.5f}", f"{change.mean():.4f}", f"{fell.mean():.2f}"]
            writer.writerow(row)
            file.flush()
            print(*row, sep=", ", flush=True)


if __name__ == "__main__":
    main()
