"""What a budget of minutes buys on campaigns of the real engine.

    python studies/diagnosis_budget.py block
    python studies/diagnosis_budget.py SP1
        [--cpu-minutes 10 50] [--threads N] [--out FOLDER]

`block`: that of configs/blind.yaml, shaken 300 times with 20 motions. `SP1`: the laboratory's
specimen under its 299 motions, in the scene of lab_diagnosis.yaml, as `vsr2 campaign import-lab
SOURCE --out out/lab` prepares it. Campaigns are planted with nuisances drawn from another seed, at
tier M. The first is diagnosed with the whole library within the processor time, from an empty
cache. The others get the same simulated campaigns, out of that cache. Each
further number of minutes goes on with the cache: 10 and 50 make an hour. Last comes what the
laboratory observed, at tier B. Writes `table.csv`.
"""

from __future__ import annotations

import argparse
import shutil
import time
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis_planar import write
from planted import shaken_campaign
from vsr2.campaign import Campaign, MeasurementNoise, load_campaign
from vsr2.config import load_study
from vsr2.diagnosis import Budget, Diagnosis, diagnose
from vsr2.ensemble import Execution, ProtocolCache
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.ensemble.simulated.simulator import Effects, Request
from vsr2.report.messages.progress_lines import ProgressLines

ROOT = Path(__file__).resolve().parents[1]
NOISE = 0.002
"""Standard error of the largest tilt [rad]."""


@dataclass(frozen=True)
class Setup:
    """Of the campaigns: trials without outcomes, what is planted, what the laboratory saw."""

    scene: Path
    blank: Campaign
    planted: tuple[Effects, ...]
    observed: Campaign | None = None


def block() -> Setup:
    """Campaigns of the blind check's block."""
    return Setup(
        ROOT / "configs" / "blind.yaml",
        shaken_campaign(20, 15, duration=4.0, pga_g=(0.45, 1.15)),
        (
            (("restitution", (0.7,)),),
            (("restitution", (0.85,)),),
            (("table_gain", (0.08,)),),
            (("time_scale", (0.025,)),),
            (("wear", (0.1,)),),
            (),
        ),
    )


def specimen() -> Setup:
    """Campaigns of SP1 with the laboratory's motions."""
    observed = load_campaign(ROOT / "out" / "lab").with_motion()
    planted: tuple[Effects, ...] = (
        (("table_gain", (0.12,)),),
        (("registration", (60.0, 0.0, 0.0)),),
        (),
    )
    return Setup(ROOT / "studies" / "lab_diagnosis.yaml", observed, planted, observed)


SETUPS = {"block": block, "SP1": specimen}


def shaken(setup: Setup, planted: Effects, draw: int = 1) -> Campaign:
    """The campaign as a laboratory would hand it over, with what is planted.

    `draw` is of the nuisances that the diagnosis does not know.
    """
    blank = setup.blank
    truth = SceneSimulator(blank, load_study(setup.scene), seed=10_001)
    found = truth.run([Request(i, planted, draw, 1) for i in range(len(blank))])
    trials = tuple(
        replace(
            trial,
            overturned=bool(found.overturned[i]),
            # An overturned rock's largest tilt is not known.
            peak_tilt=None if np.isnan(found.peak_tilt[i]) else float(found.peak_tilt[i]),
        )
        for i, trial in enumerate(blank.trials)
    )
    return replace(blank, trials=trials, noise=MeasurementNoise(peak_tilt=NOISE))


def row(planted: str, minutes: float, found: Diagnosis, spent_s: float) -> dict[str, Any]:
    """What a diagnosis came to."""
    content = found.content
    budget = content["provenance"]["budget"]
    first = content["effects"][0]
    value = next(iter(first["parameters"].values()))
    return {
        "cpu_minutes": f"{minutes:g}",
        "planted": planted,
        "tier": content["campaign"]["tier"],
        "spent_minutes": f"{spent_s / 60:.1f}",
        "simulations": budget["simulations"],
        "reused": budget["reused"],
        "campaigns": budget["campaigns"],
        "trials": budget["trials"],
        "verdict": found.kind,
        "named": " ".join(found.effects),
        "probability": f"{content['verdict']['probability']:.3f}",
        "most_probable": first["name"],
        "acts": f"{first['acts']:.3f}",
        "none": f"{content['none_probability']:.3f}",
        "value": f"{value['median']:.3f} [{value['ci90'][0]:.3f}, {value['ci90'][1]:.3f}]",
        "closure": _interval(content["gap"]["closure"]),
        "headline": _interval(content["gap"]["headline"]),
    }


def _interval(share: dict[str, Any]) -> str:
    """A share and its bounds, where it is known."""
    value, bounds = share["value"], share["ci95"]
    if value is None:
        return ""
    return f"{value:.2f}" + ("" if bounds is None else f" [{bounds[0]:.2f}, {bounds[1]:.2f}]")


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("setup", choices=SETUPS)
    parser.add_argument("--cpu-minutes", type=float, nargs="+", default=[10.0, 50.0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "diagnosis_budget")
    options = parser.parse_args()
    setup = SETUPS[options.setup]()
    out = options.out / options.setup
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    campaigns = [
        (" ".join(f"{name} {values[0]:g}" for name, values in planted) or "none",
         shaken(setup, planted))
        for planted in setup.planted
    ]  # fmt: skip
    if setup.observed is not None:
        campaigns.append(("as observed", setup.observed))
    execution = Execution(
        options.threads, cache=ProtocolCache(out / "cache"), report=ProgressLines()
    )
    rows = []
    for minutes, total in zip(options.cpu_minutes, accumulate(options.cpu_minutes), strict=True):
        budget = Budget(cpu_minutes=minutes)
        for planted, campaign in campaigns:
            begun = time.process_time()
            found = diagnose(
                campaign,
                setup.scene,
                budget=budget,
                execution=execution,
            )
            budget = Budget.repeating(found.content["provenance"])
            rows.append(row(planted, total, found, time.process_time() - begun))
            print(rows[-1], flush=True)
            write(out / "table.csv", rows)


if __name__ == "__main__":
    main()
