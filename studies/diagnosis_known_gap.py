"""The original system's own defects as a gap of known cause, against the correct scene.

    python studies/diagnosis_known_gap.py [--draws N] [--campaigns N] [--out FOLDER]

A block is shaken by the native core with one defect each, and with all three together:

- `time base`: samples taken every 1.25 ms are played one per millisecond, so that all times are
  0.8 times as long and accelerations 1.56 times as large;
- `inertia`: moments 1.9 times too large, as the original's bounding-box estimate makes SP1's (of a
  block, whose bounding box is itself, the estimate would be right);
- `motor`: the table is driven by the original's joint motor, a first-order lag of about 9 ms.

The diagnosis has the correct scene, and a library in which `time_scale` and `inertia` reach far
enough. Writes `table.csv`, committed as docs/results/diagnosis_known_gap.csv.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from diagnosis_planar import write

from vsr2.campaign import Tier
from vsr2.config import study_from_mapping
from vsr2.diagnosis.planted import Rehearsal, shaken_campaign
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.diagnosis.simulated.simulator import Effects
from vsr2.effects import Effect
from vsr2.effects import library as known_effects

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
TIERS: tuple[Tier, ...] = ("B", "M", "T")
WANTED = {
    "time base": {"time_scale"},
    "inertia": {"inertia", "time_scale"},
    "motor": {"table_bandwidth"},
    "all three": {"time_scale", "inertia", "table_bandwidth"},
}
SCENE = {
    "name": "block",
    "rock": {"shape": "box", "size": [0.4, 0.55, 0.95], "density": 2700.0},
    "motion": {"mode": "all_recordings", "folder": "."},
    "contact": {"rock": {"lateral_friction": 0.9}, "pedestal": {"lateral_friction": 0.9}},
    "outcome": {"tail": 2.0},
}
"""Friction well above the slenderness: near it a draw of friction decides whether the block rocks
or slides, which no emulator that is linear in the nuisances can follow."""


def library() -> Mapping[str, Effect]:
    """Effects that may be the cause."""
    found = {name: known_effects()[name] for name in NAMES}
    found["time_scale"] = found["time_scale"].with_prior("change", -0.3, 0.1)
    found["inertia"] = found["inertia"].with_prior("change", -0.3, 1.2)
    return found


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--campaigns", type=int, default=3)
    parser.add_argument("--motions", type=int, default=12)
    parser.add_argument("--scalings", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/diagnosis_known_gap"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    campaign = shaken_campaign(options.motions, options.scalings, duration=3.0, pga=(0.45, 1.15))
    effects = library()

    def simulator(drive: str, seed: int) -> SceneSimulator:
        scene = SCENE | {"motion": {**SCENE["motion"], "drive": drive}}  # type: ignore[dict-item]
        study = study_from_mapping(scene, base=Path())
        return SceneSimulator(
            campaign, study, library=effects, series=True, threads=options.threads, seed=seed
        )

    rehearsal = Rehearsal(
        simulator("prescribed", 1),
        campaign,
        draws=options.draws,
        screening_runs=10,
        noise=0.003,
        series=True,
        bank=options.out / "bank.sqlite",
    )
    exact, motor = simulator("prescribed", 10_001), simulator("motor", 10_001)
    fast: Effects = (("time_scale", (-0.2,)),)
    heavy: Effects = (("inertia", (0.9, 0.0)),)
    cases = {
        "none": (exact, ()),
        "time base": (exact, fast),
        "inertia": (exact, heavy),
        "motor": (motor, ()),
        "all three": (motor, (*heavy, *fast)),
    }
    rows = []
    for tier in TIERS:
        prepared = rehearsal.prepared(tier)
        for defect, (truth, planted) in cases.items():
            for draw in range(1, options.campaigns + 1):
                seen = rehearsal.observed(truth, planted, nuisance=draw)
                judged = rehearsal.judge(prepared, seen, tier)
                content = judged.diagnosis.content
                verdict = content["verdict"]
                wanted = WANTED.get(defect, set())
                best = content["effects"][0]
                value = next(iter(best["parameters"].values()))
                rows.append(
                    {
                        "defect": defect,
                        "tier": tier,
                        "draw": draw,
                        "verdict": verdict["kind"],
                        "effects": " ".join(verdict["effects"]),
                        "right": int(
                            bool(wanted & set(verdict["effects"]))
                            if wanted
                            else verdict["kind"] == "none"
                        ),
                        "leading": best["name"],
                        "probability": f"{best['probability']:.3f}",
                        "value": f"{value['mean']:.3g}",
                        "low": f"{value['ci95'][0]:.3g}",
                        "high": f"{value['ci95'][1]:.3g}",
                        "novelty_p": f"{content['unknown']['novelty_p']:.3f}",
                    }
                )
                print(rows[-1], flush=True)
                write(options.out / "table.csv", rows)


if __name__ == "__main__":
    main()
