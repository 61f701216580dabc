"""Where the laboratory's outcomes on specimen SP1 differ from what is predicted of them.

    python studies/lab_several_causes.py
    python studies/lab_residuals.py [--causes FOLDER] [--out FILE]

Takes each trial's probability of overturning on motions that were not seen, from the held-out
predictions of the search for causes: without a cause and with all. Trials are put into classes by
PGA, PGV/PGA, month, order within a day, and motion. Columns: trials of the class, how many
overturned, how many were expected, and z, the difference over its standard error. That of a class
of many motions is taken over the motions (their sums of residuals). That of one motion is the
binomial one times the factor by which motions scatter more than that: trials of a motion fall and
stand together. Of motions the five with the largest z without a cause are listed. The committed
table is docs/results/lab_residuals.csv. The data record no direction of fall.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import load_campaign

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "docs" / "results" / "lab_residuals.csv"
Array = NDArray[np.float64]


def quarters(values: Array, unit: str) -> list[str]:
    """Name of each value's quarter of all, by its ends."""
    ends = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
    place = np.clip(np.searchsorted(ends, values, side="right") - 1, 0, 3)
    return [f"{k + 1}: {ends[k]:.3g} to {ends[k + 1]:.3g} {unit}" for k in place]


def motion_sums(values: Array, motions: NDArray[np.str_]) -> Array:
    """Sum over the trials of each motion, shape (motions,)."""
    return np.array([values[motions == name].sum() for name in np.unique(motions)])


def difference(
    residuals: Array, variances: Array, motions: NDArray[np.str_], overdispersion: float
) -> float:
    """Sum of residuals over its standard error.

    Args:
        residuals: outcome less probability, shape (trials,).
        variances: binomial ones, shape (trials,).
        motions: of the trials.
        overdispersion: variance of a motion's sum over the binomial one.
    """
    sums = motion_sums(residuals, motions)
    if sums.size == 1:
        return float(residuals.sum() / np.sqrt(overdispersion * variances.sum()))
    return float(sums.sum() / np.sqrt((sums**2).sum()))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--causes", type=Path, default=HERE.parent / "out" / "lab_several_causes")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    campaign = load_campaign(options.campaign)
    with (options.causes / "held_out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    trials = {trial.trial: trial for trial in campaign.trials}
    asked = [trials[row["trial"]] for row in rows]
    fell = np.array([bool(trial.overturned) for trial in asked], dtype=float)
    motions = np.array([trial.motion for trial in asked])
    expected = {
        name: np.array([float(row[column]) for row in rows])
        for name, column in (("without", "none"), ("with", "all"))
    }
    days = [trial.session for trial in asked]
    place = {
        id(trial): k / max(1, days.count(day) - 1)
        for day in set(days)
        for k, trial in enumerate(
            sorted((t for t in asked if t.session == day), key=lambda t: t.order)
        )
    }
    looks = {
        "PGA": quarters(np.array([trial.pga_g for trial in asked]), "g"),
        "PGV/PGA": quarters(np.array([trial.pgv_pga_s for trial in asked]), "s"),
        "month": [day[:7] for day in days],
        "half of a day": ["1" if place[id(trial)] < 0.5 else "2" for trial in asked],
        "motion": motions.tolist(),
    }
    overdispersion = {
        key: float((motion_sums(fell - p, motions) ** 2).sum() / (p * (1 - p)).sum())
        for key, p in expected.items()
    }
    print("overdispersion of motions", overdispersion)
    table = []
    for look, names in looks.items():
        found = []
        for name in sorted(set(names)):
            rows_in = np.array([one == name for one in names])
            line: dict[str, object] = {
                "look": look,
                "class": name,
                "trials": int(rows_in.sum()),
                "overturned": int(fell[rows_in].sum()),
            }
            for key, p in expected.items():
                own = p[rows_in]
                residuals, variances = fell[rows_in] - own, own * (1 - own)
                z = difference(residuals, variances, motions[rows_in], overdispersion[key])
                line[f"expected_{key}_causes"] = round(float(own.sum()), 2)
                line[f"z_{key}_causes"] = round(z, 2)
            found.append(line)
        if look == "motion":
            found = sorted(found, key=lambda one: -abs(float(str(one["z_without_causes"]))))[:5]
        table += found
    with options.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    for line in table:
        print(*line.values(), sep="\t")


if __name__ == "__main__":
    main()
