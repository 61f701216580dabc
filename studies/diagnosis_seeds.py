"""Verdicts on small campaigns with a small budget, over seeds, and on outcomes dealt at random.

    python studies/diagnosis_seeds.py [--seeds N] [--campaigns N] [--threads N] [--out FOLDER]

A block of configs/blind.yaml is shaken 60 times with 10 motions, nuisances drawn from another
seed, tier M: without effect, with a planted one, and without, its outcomes and largest tilts dealt
at random over the trials. Every campaign is diagnosed with seven effects and each seed; a seed's
diagnoses share simulations and the trained posterior. Writes `table.csv`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis_planar import write
from planted import shaken_campaign
from vsr2.campaign import Campaign, MeasurementNoise
from vsr2.config import load_study
from vsr2.diagnosis import Budget, diagnose
from vsr2.effects import library
from vsr2.ensemble import Execution, Hypotheses, ProtocolCache
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Effects, Request

SCENE = Path(__file__).resolve().parents[1] / "configs" / "blind.yaml"
NAMES = (
    "table_gain",
    "slenderness",
    "restitution",
    "com_offset",
    "wear",
    "catch",
    "edge_rounding",
)
PLANTED: dict[str, Effects] = {
    "none": (),
    "table_gain -0.06": (("table_gain", (-0.06,)),),
    "table_gain 0.12": (("table_gain", (0.12,)),),
    "edge_rounding 12 mm": (("edge_rounding", (0.012,)),),
    "catch 9 degrees": (("catch", (9.0,)),),
}
SHUFFLED = 5
"""Campaigns without effect whose outcomes are dealt at random."""
NOISE = 0.002
"""Standard error of the largest tilt [rad]."""


def main() -> None:
    """Diagnose every campaign with every seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--campaigns", type=int, default=600)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out") / "diagnosis_seeds")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaigns = {label: observed(i, effects) for i, (label, effects) in enumerate(PLANTED.items())}
    for i in range(SHUFFLED):
        campaigns[f"dealt at random {i + 1}"] = dealt(observed(20 + i, ()), i)
    offered = {name: library()[name] for name in NAMES}
    rows = []
    for seed in range(options.seeds):
        for label, campaign in campaigns.items():
            found = diagnose(
                campaign,
                SCENE,
                budget=Budget(campaigns=options.campaigns),
                hypotheses=Hypotheses(offered),
                execution=Execution(options.threads, cache=ProtocolCache(options.out / "cache")),
                seed=seed,
            )
            rows.append({"campaign": label, "seed": seed} | row(found.content))
            print(rows[-1], flush=True)
            write(options.out / "table.csv", rows)


def observed(nuisance: int, planted: Effects) -> Campaign:
    """The campaign as a laboratory would hand it over, with one draw of the nuisances."""
    blank = shaken_campaign(10, 6, duration=3.0, pga_g=(0.45, 1.15), session_size=12)
    truth = SceneSimulator(blank, load_study(SCENE), seed=10_001)
    found = truth.run([Request(i, planted, 1 + nuisance, 1) for i in range(len(blank))])
    trials = tuple(
        replace(trial, overturned=bool(found.overturned[i]), peak_tilt=float(found.peak_tilt[i]))
        for i, trial in enumerate(blank.trials)
    )
    return replace(blank, trials=trials, noise=MeasurementNoise(peak_tilt=NOISE))


def dealt(campaign: Campaign, seed: int) -> Campaign:
    """What was measured in each trial given to another one."""
    order = np.random.default_rng([seed, 100]).permutation(len(campaign))
    trials = tuple(
        replace(
            trial,
            overturned=campaign.trials[j].overturned,
            peak_tilt=campaign.trials[j].peak_tilt,
        )
        for trial, j in zip(campaign.trials, order, strict=True)
    )
    return replace(campaign, trials=trials)


def row(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a diagnosis came to."""
    verdict, first = content["verdict"], content["effects"][0]
    return {
        "verdict": verdict["kind"],
        "effects": " ".join(verdict["effects"]),
        "probability": f"{verdict['probability']:.3f}",
        "first": first["name"],
        "first_acts": f"{first['acts']:.3f}",
        "none": f"{content['none_probability']:.3f}",
        "unknown": f"{content['unknown']['probability']:.3f}",
        "set": " ".join(content["conformal_set_90"]),
        "simulations": content["provenance"]["budget"]["simulations"],
    }


if __name__ == "__main__":
    main()
