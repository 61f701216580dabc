"""What a budget of minutes buys on a campaign of 300 trials of the real engine.

    python studies/diagnosis_budget.py [--minutes 10 60] [--threads N] [--out FOLDER]

A block of configs/blind.yaml is shaken 300 times with 20 motions under one planted effect (impacts
that leave 0.85 of Housner's energy), nuisances drawn from another seed, tier M. The campaign is
diagnosed with the whole library for each budget, a fresh bank each time. Writes `table.csv`.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

from diagnosis_planar import write

from vsr2.campaign import Campaign, MeasurementNoise
from vsr2.config import load_study
from vsr2.diagnosis import diagnose
from vsr2.diagnosis.planted import shaken_campaign
from vsr2.diagnosis.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulator import Effects, Request

SCENE = Path(__file__).resolve().parents[1] / "configs" / "blind.yaml"
PLANTED: Effects = (("restitution", (0.85,)),)
MOTIONS, SCALINGS, DURATION = 20, 15, 4.0
NOISE = 0.002
"""Standard error of the largest tilt [rad]."""


def observed() -> Campaign:
    """The campaign as a laboratory would hand it over."""
    blank = shaken_campaign(MOTIONS, SCALINGS, duration=DURATION, pga=(0.45, 1.15))
    truth = SceneSimulator(blank, load_study(SCENE), seed=10_001)
    found = truth.run([Request(i, PLANTED, 1, 1) for i in range(len(blank))])
    trials = tuple(
        replace(trial, overturned=bool(found.overturned[i]), peak_tilt=float(found.peak_tilt[i]))
        for i, trial in enumerate(blank.trials)
    )
    return replace(blank, trials=trials, noise=MeasurementNoise(peak_tilt=NOISE))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0, 60.0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_budget"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign = observed()
    rows = []
    for minutes in options.minutes:
        started = time.monotonic()
        found = diagnose(
            campaign, SCENE, budget_minutes=minutes, threads=options.threads, progress=True
        )
        content = found.content
        budget = content["provenance"]["budget"]
        first = content["effects"][0]
        value = next(iter(first["parameters"].values()))
        rows.append(
            {
                "budget_minutes": minutes,
                "wall_minutes": f"{(time.monotonic() - started) / 60:.1f}",
                "trials": len(campaign),
                "effects": len(content["effects"]),
                "simulations": budget["simulated"],
                "rounds": budget["rounds"],
                "most_draws": max(budget["draws"].values()),
                "verdict": found.kind,
                "named": " ".join(found.effects),
                "most_probable": first["name"],
                "probability": f"{first['probability']:.3f}",
                "value": f"{value['mean']:.3f} [{value['ci95'][0]:.3f}, {value['ci95'][1]:.3f}]",
            }
        )
        print(rows[-1], flush=True)
        write(options.out / "table.csv", rows)


if __name__ == "__main__":
    main()
