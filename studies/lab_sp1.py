"""Specimen SP1 of the laboratory campaign: all trials that have a motion, against the observations.

    python studies/lab_sp1.py [--threads N] [--out FOLDER]

The data are taken from the folder VSR2_LAB_DATA, else ../shared/lab beside the repository; they are
not part of it. Two settings are run, both in `parity` with the supplement's best contact values,
the correct time base and a settled start:

- `original`: inertia of Bullet's bounding box about the mesh's origin, joint motor;
- `correct`: mass centre and inertia of the mesh, prescribed motion.

Writes `table.csv` (one row a setting), `outcomes.csv` (observed and simulated outcome of every
trial) and one result folder a setting. The committed table is
docs/results/lab_sp1.csv.
"""

from __future__ import annotations

import argparse
import csv
import os
from pathlib import Path

import numpy as np

from vsr2.analysis import classification_metrics
from vsr2.config import study_from_mapping
from vsr2.errors import Vsr2Error
from vsr2.results import save_result
from vsr2.simulation import run_batch

ROOT = Path(__file__).resolve().parent.parent
MASS = 353.8
"""Of SP1 [kg]."""
START = {
    "mode": "pose",
    "position": [0.0, 0.0, 2.78],
    "orientation": [0.86766, 0.06594, 0.47910, 0.11521],
}
"""The original's start of `final_sp1_pca.obj`."""
SETTINGS = {
    "original": {"inertia": "aabb", "drive": "motor"},
    "correct": {"inertia": "mesh", "drive": "prescribed"},
}


def lab_folder() -> Path:
    """The campaign's folder.

    Raises:
        SystemExit: there is none.
    """
    folder = Path(os.environ.get("VSR2_LAB_DATA", ROOT.parent / "shared" / "lab"))
    if not (folder / "trials.csv").is_file():
        raise SystemExit(f"{folder} holds no trials.csv; set VSR2_LAB_DATA to the laboratory data")
    return folder


def lab_study(lab: Path, *, inertia: str, drive: str) -> dict[str, object]:
    """The study of one setting, as a YAML file would hold it."""
    return {
        "name": "lab_sp1",
        "engine": {"mode": "parity"},
        "rock": {
            "shape": "mesh",
            "file": str(lab / "models" / "final_sp1_pca.obj"),
            "mass": MASS,
            "inertia": inertia,
            "start": START,
        },
        "motion": {
            "mode": "all_recordings",
            "folder": str(lab / "motions"),
            "pattern": "*.npz",
            "channel": "displacement",
            "filter": {"low": 0.1, "high": 25.0, "order": 3},
            "drive": drive,
        },
        "output": {"log_every": 0},
    }


def main() -> int:
    """Run both settings and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=Path("out") / "lab_sp1")
    options = parser.parse_args()
    lab = lab_folder()
    with open(lab / "trials.csv", newline="") as file:
        observed = {
            f"Test{int(row['test']):03d}": row["sp1_overturned"] == "1"
            for row in csv.DictReader(file)
        }
    rows = []
    outcomes: dict[str, dict[str, object]] = {}
    for name, setting in SETTINGS.items():
        study = study_from_mapping(lab_study(lab, **setting), base=ROOT)
        result = run_batch(study, threads=options.threads, progress=True)
        options.out.mkdir(parents=True, exist_ok=True)
        save_result(result, options.out / name, overwrite=True)
        for motion, outcome, status in zip(
            result["motion"], result["outcome"], result["status"], strict=True
        ):
            row = outcomes.setdefault(motion, {"test": motion, "observed": int(observed[motion])})
            row |= {f"{name}_outcome": outcome, f"{name}_status": status}
        judged = result.judged
        truth = np.array([observed[motion] for motion in result["motion"]])
        metrics = classification_metrics(truth[judged], result.overturned[judged])
        rows.append(
            {
                "setting": name,
                "trials": int(judged.sum()),
                "failed": int((~judged).sum()),
                "overturned_observed": int(truth[judged].sum()),
                "overturned_simulated": metrics.true_positives + metrics.false_positives,
                "accuracy": f"{metrics.accuracy:.3f}",
                "precision": f"{metrics.precision:.3f}",
                "recall": f"{metrics.recall:.3f}",
                "f1": f"{metrics.f1:.3f}",
                "mean": f"{metrics.objective:.3f}",
                "wall_time_s": f"{result.provenance['wall_time_s']:.0f}",
            }
        )
    with open(options.out / "outcomes.csv", "w", newline="") as file:
        listing = csv.DictWriter(file, fieldnames=list(next(iter(outcomes.values()))))
        listing.writeheader()
        listing.writerows(outcomes.values())
    table = options.out / "table.csv"
    with open(table, "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    print(table.read_text(), end="")
    print(f"wrote {table}")
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except Vsr2Error as error:
        raise SystemExit(f"lab_sp1: {error}") from None
