"""By how much two correct engines differ: another engine's gap-free campaigns against our scene.

    python studies/engine_discrepancy.py SCENE CAMPAIGN [CAMPAIGN ...] [--out FOLDER] [--threads N]

Each campaign, a folder, has no effect and comes from another engine (or, to compare, from ours).
Its outcomes and features are compared with the nominal simulation of each trial. What differs in
the logarithm of the largest tilt, and in features of series, is split into what is common to a
campaign, to the trials of a motion, and what is left to single trials. `DISCREPANCY` of
`vsr2.posterior.discrepancy` and `rest_scatter` of `vsr2.ensemble.observed.observations`
are of that kind. Writes `table.csv`, one row a campaign and feature.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis_planar import write
from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.ensemble.observed.features import REST_FEATURES, TILT_FEATURES, noted_tilt_features
from vsr2.ensemble.observed.observations import (
    OBSERVED,
    Observations,
    observe_campaign,
    rest_logarithm,
)
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Request, Responses

Array = NDArray[np.float64]


def nominal_features(seen: Observations, found: Responses) -> Array:
    """What the campaign would have noted of our simulations, without noise, shape (trials, k)."""
    standing = found.overturned < 0.5
    columns = {
        "largest_tilt": np.where(standing, np.log(found.peak_tilt + seen.tilt_offset), np.nan)
    }
    if found.features is not None:
        tilts = len(TILT_FEATURES)
        noted = noted_tilt_features(found.features[:, :tilts], found.overturned)
        columns |= {feature.name: noted[:, k] for k, feature in enumerate(TILT_FEATURES)}
        for k, feature in enumerate(REST_FEATURES):
            known = rest_logarithm(
                np.abs(found.features[:, tilts + k]),
                OBSERVED.rest_resolution[k],
                seen.rest_noise[k],
            )
            columns[feature.name] = np.where(standing, known, np.nan)
    return np.stack([columns[feature.name] for feature in seen.measured], axis=1)


def parts(difference: Array, motion: NDArray[np.int64]) -> tuple[float, float, float]:
    """Mean, deviation common to a motion, of single trials: one-way analysis of variance."""
    known = np.isfinite(difference)
    values, group = difference[known], motion[known]
    groups = [values[group == m] for m in np.unique(group)]
    mean = float(values.mean()) if values.size else np.nan
    freedom = values.size - len(groups)
    if freedom < 1 or len(groups) < 2:
        return mean, np.nan, np.nan
    single = sum(float(((g - g.mean()) ** 2).sum()) for g in groups) / freedom
    between = sum(g.size * (float(g.mean()) - mean) ** 2 for g in groups) / (len(groups) - 1)
    size = (values.size - sum(g.size**2 for g in groups) / values.size) / (len(groups) - 1)
    return mean, float(np.sqrt(max(between - single, 0.0) / size)), float(np.sqrt(single))


def rows_of(scene: Path, folder: Path, threads: int) -> list[dict[str, Any]]:
    """One row a feature."""
    seen = observe_campaign(load_campaign(folder))
    simulator = SceneSimulator(
        seen.campaign, load_study(scene), series=seen.tier == "T", threads=threads
    )
    found = simulator.run([Request(i, (), 0, 0) for i in range(len(seen))])
    judged = np.isfinite(found.overturned)
    differs = float((found.overturned != seen.overturned)[judged].mean())
    ours = nominal_features(seen, found) if seen.measured else np.zeros((len(seen), 0))
    out = []
    for k, feature in enumerate(seen.measured):
        difference = seen.features[:, k] - ours[:, k]
        campaign, motion, single = parts(difference, seen.motion)
        out.append(
            {
                "campaign": folder.name,
                "trials": len(seen),
                "outcomes_differ": f"{differs:.3f}",
                "feature": feature.name,
                "pairs": int(np.isfinite(difference).sum()),
                "mean": f"{campaign:.3f}",
                "mean_absolute": f"{np.nanmean(np.abs(difference)):.3f}",
                "by_motion": f"{motion:.3f}",
                "single": f"{single:.3f}",
            }
        )
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("campaign", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("out/engine_discrepancy"))
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    rows = [
        row
        for folder in options.campaign
        for row in rows_of(options.scene, folder, options.threads)
    ]
    write(options.out / "table.csv", rows)
    print(f"wrote {options.out / 'table.csv'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
