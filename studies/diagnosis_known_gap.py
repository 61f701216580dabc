"""The original system's own defects as a gap of known cause, against the correct scene.

    python studies/diagnosis_known_gap.py [--simulated N] [--campaigns N] [--out FOLDER]

The boulder of models/pbr_scan.obj is shaken by the native core with one defect each, and with all
three together, each made as the original makes it and by no effect of the library:

- `time base`: recorded displacements of one sample in 1.25 ms are played one sample a millisecond,
  so that all times are 0.8 times as long and accelerations 1.56 times as large;
- `inertia`: the moments are those of the bounding box, 1.65, 1.63 and 1.82 times too large;
- `motor`: the table is driven by the original's joint motor, a first-order lag of about 9 ms.

The diagnosis has the correct scene, and a library in which `time_scale` and `inertia` reach far
enough. Writes `table.csv`, committed as docs/results/diagnosis_known_gap.csv.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from diagnosis_planar import write
from planted import Rehearsal, shaken_campaign
from vsr2.campaign import TIERS, Campaign
from vsr2.config import study_from_mapping
from vsr2.diagnosis.verdict.rules import verdict_of
from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.effects import Effect
from vsr2.effects import library as known_effects
from vsr2.ensemble import Hypotheses
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.motion import Record
from vsr2.posterior.training import Found, Posterior

NAMES = (
    "time_scale",
    "inertia",
    "table_bandwidth",
    "table_gain",
    "slenderness",
    "restitution",
    "com_offset",
    "rolling_resistance",
    "catch",
)
WANTED = {
    "time base": {"time_scale"},
    "inertia": {"inertia", "time_scale"},
    "motor": {"table_bandwidth"},
    "all three": {"time_scale", "inertia", "table_bandwidth"},
}
PGA = (0.25, 0.8)
"""Range of the schedule [g]."""
SCENE: dict[str, Any] = {
    "name": "boulder",
    "rock": {"shape": "mesh", "file": "pbr_scan.obj", "density": 2650.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "contact": {"rock": {"lateral_friction": 0.9}, "pedestal": {"lateral_friction": 0.9}},
    "outcome": {"tail": 2.0},
}
"""Friction well above the slenderness, so that the boulder rocks and does not slide."""
MODELS = Path(__file__).resolve().parents[1] / "models"
SAMPLED, PLAYED = 0.00125, 0.001
"""Interval between samples, and that at which the original plays them [s]."""


def library() -> Mapping[str, Effect]:
    """Effects that may be the cause."""
    found = {name: known_effects()[name] for name in NAMES}
    found["time_scale"] = found["time_scale"].with_prior("change", -0.3, 0.1)
    found["inertia"] = found["inertia"].with_prior("change", -0.3, 1.2)
    return found


def recorded(motions: int, scalings: int, interval: float) -> Campaign:
    """The schedule with displacements of one sample in 1.25 ms, said to be `interval` apart [s]."""
    plain = shaken_campaign(motions, scalings, duration=3.0, pga_g=PGA)
    records = {}
    for name, record in plain.motions.items():
        assert record.acceleration is not None
        coarse = np.arange(record.acceleration.size) * record.sample_interval
        time = np.arange(0.0, coarse[-1], SAMPLED)
        acceleration = CubicSpline(coarse, record.acceleration)(time)
        velocity = cumulative_trapezoid(acceleration, time, initial=0.0)
        displacement = cumulative_trapezoid(velocity, time, initial=0.0)
        records[name] = Record(name=name, sample_interval=interval, displacement=displacement)
    return replace(plain, motions=records)


def judged(wanted: set[str], found: Found, posterior: Posterior) -> dict[str, Any]:
    """The verdict on a defect, whether it is right, and what leads.

    Args:
        wanted: effects one of which has to be named; none: no gap is to be found.
        found: in the campaign.
        posterior: by which it was found.
    """
    verdict = verdict_of(found, posterior)
    acts = posterior.sets.marginal(found.probability)
    best = posterior.sets.names[int(acts.argmax())]
    values = posterior.parameters.sample(best, found.residuals, np.random.default_rng(0))[:, 0]
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    right = wanted & set(verdict.named) if wanted else verdict.kind == VerdictKind.NONE
    return {
        "verdict": verdict.kind,
        "effects": " ".join(verdict.effects),
        "right": int(bool(right)),
        "leading": best,
        "acts": f"{acts.max():.3f}",
        "value": f"{middle:.3g}",
        "low": f"{low:.3g}",
        "high": f"{high:.3g}",
        "none": f"{found.probability[0]:.3f}",
        "unknown": f"{found.probability[-1]:.3f}",
    }


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulated", type=int, default=500)
    parser.add_argument("--campaigns", type=int, default=3)
    parser.add_argument("--motions", type=int, default=12)
    parser.add_argument("--scalings", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_known_gap"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign = recorded(options.motions, options.scalings, SAMPLED)
    hasty = recorded(options.motions, options.scalings, PLAYED)
    effects = library()

    def simulator(
        seed: int, of: Campaign = campaign, *, inertia: str = "mesh", drive: str = "prescribed"
    ) -> SceneSimulator:
        scene: dict[str, Any] = {
            **SCENE,
            "rock": {**SCENE["rock"], "inertia": inertia},
            "motion": {**SCENE["motion"], "drive": drive},
        }
        study = study_from_mapping(scene, base=MODELS)
        return SceneSimulator(
            of,
            study,
            hypotheses=Hypotheses(effects),
            series=True,
            threads=options.threads,
            seed=seed,
        )

    rehearsal = Rehearsal(
        simulator(1),
        campaign,
        campaigns=options.simulated,
        noise=0.003,
        cache=options.out / "simulations.jsonl",
    )
    other = 10_001
    cases = {
        "none": simulator(other),
        "time base": simulator(other, hasty),
        "inertia": simulator(other, inertia="aabb"),
        "motor": simulator(other, drive="motor"),
        "all three": simulator(other, hasty, inertia="aabb", drive="motor"),
    }
    rows = []
    for tier in TIERS:
        posterior = rehearsal.posterior(tier)
        for defect, truth in cases.items():
            # A bounding box may have moments that no body has: such a draw cannot be simulated.
            observed = ((k, rehearsal.observed(truth, tier=tier, nuisance=k)) for k in count(1))
            known = ((k, seen) for k, seen in observed if np.isfinite(seen.overturned).all())
            for draw, seen in islice(known, options.campaigns):
                found = rehearsal.infer(seen)
                case = {"defect": defect, "tier": tier, "draw": draw}
                rows.append(case | judged(WANTED.get(defect, set()), found, posterior))
                print(rows[-1], flush=True)
                write(options.out / "table.csv", rows)


if __name__ == "__main__":
    main()
