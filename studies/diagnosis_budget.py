"""What a budget of minutes buys on campaigns of 300 trials of the real engine.

    python studies/diagnosis_budget.py [--minutes 10 60] [--threads N] [--out FOLDER]

A block of configs/blind.yaml is shaken 300 times with 20 motions, nuisances drawn from another
seed, tier M, once without and five times with a planted effect. The first campaign is diagnosed
with the whole library within the minutes, from a fresh cache. The others get as many simulated
campaigns as the first could afford, out of its cache, so that each of them takes seconds. Writes
`table.csv`.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnosis_planar import write
from planted import shaken_campaign
from vsr2.campaign import Campaign, MeasurementNoise
from vsr2.config import load_study
from vsr2.diagnosis import Budget, Diagnosis, Execution, diagnose
from vsr2.diagnosis.budget import SCHEDULE
from vsr2.diagnosis.simulated.look import LOOK
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulated.simulator import Effects, Request
from vsr2.report.messages.progress_lines import ProgressLines

SCENE = Path(__file__).resolve().parents[1] / "configs" / "blind.yaml"
PLANTED: tuple[Effects, ...] = (
    (("restitution", (0.85,)),),
    (("restitution", (0.7,)),),
    (("table_gain", (0.08,)),),
    (("time_scale", (0.025,)),),
    (("wear", (0.1,)),),
    (),
)
"""The first is weak beside the nuisances."""
MOTIONS, SCALINGS, DURATION = 20, 15, 4.0
NOISE = 0.002
"""Standard error of the largest tilt [rad]."""


def observed(planted: Effects) -> Campaign:
    """The campaign as a laboratory would hand it over."""
    blank = shaken_campaign(MOTIONS, SCALINGS, duration=DURATION, pga_g=(0.45, 1.15))
    truth = SceneSimulator(blank, load_study(SCENE), seed=10_001)
    found = truth.run([Request(i, planted, 1, 1) for i in range(len(blank))])
    trials = tuple(
        replace(trial, overturned=bool(found.overturned[i]), peak_tilt=float(found.peak_tilt[i]))
        for i, trial in enumerate(blank.trials)
    )
    return replace(blank, trials=trials, noise=MeasurementNoise(peak_tilt=NOISE))


def row(planted: Effects, minutes: float, found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis came to."""
    content = found.content
    budget = content["provenance"]["budget"]
    first = content["effects"][0]
    value = next(iter(first["parameters"].values()))
    return {
        "budget_minutes": minutes,
        "planted": " ".join(f"{name} {values[0]:g}" for name, values in planted) or "none",
        "wall_minutes": f"{content['provenance']['wall_time_s'] / 60:.1f}",
        "simulations": budget["simulations"],
        "reused": budget["reused"],
        "campaigns": budget["campaigns"],
        "verdict": found.kind,
        "named": " ".join(found.effects),
        "most_probable": first["name"],
        "acts": f"{first['acts']:.3f}",
        "none": f"{content['none_probability']:.3f}",
        "value": f"{value['median']:.3f} [{value['ci90'][0]:.3f}, {value['ci90'][1]:.3f}]",
    }


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0, 60.0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_budget"))
    options = parser.parse_args()
    rows = []
    for minutes in options.minutes:
        folder = options.out / f"{minutes:g}"
        shutil.rmtree(folder, ignore_errors=True)
        affordable = None
        for planted in PLANTED:
            found = diagnose(
                observed(planted),
                SCENE,
                out=folder,
                budget=Budget(minutes, campaigns=affordable),
                execution=Execution(options.threads, report=ProgressLines()),
            )
            if affordable is None:
                # Those of the look, which all diagnoses have, do not count.
                trained = found.content["posterior"]["campaigns"] - LOOK.plain
                affordable = max(trained, SCHEDULE.fewest)
            rows.append(row(planted, minutes, found))
            print(rows[-1], flush=True)
            write(options.out / "table.csv", rows)


if __name__ == "__main__":
    main()
