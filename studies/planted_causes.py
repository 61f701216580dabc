"""Whether causes act as often as is stated: drawn scenes of the laboratory's campaign as truth.

    python studies/lab_several_causes.py        # simulates the scenes
    python studies/planted_causes.py [--scenes N] [--seed N]

Each scene of the prior stands for a laboratory once: its margins, shifted by a motion that is
stronger or weaker in a quarter of them, give the outcomes. The emulator knows all scenes but that
one. The prior of what acts is the scenes' own: each effect in a quarter of them. Writes to OUT, for
bins of the stated probability, how often effects acted.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from vsr2.campaign import load_campaign
from vsr2.config import load_study
from vsr2.diagnosis import Hypotheses
from vsr2.diagnosis.margins.acting_posterior import sample_posterior
from vsr2.diagnosis.margins.cause_space import CAUSES, cause_space
from vsr2.diagnosis.margins.outcome_model import OUTCOME_MODEL, OutcomeModel
from vsr2.diagnosis.margins.simulated_scenes import SCENES, simulate_scenes
from vsr2.diagnosis.protocol_cache import SIMULATIONS
from vsr2.diagnosis.simulated.cache import SimulationCache
from vsr2.diagnosis.simulated.scene_simulator import SceneSimulator
from vsr2.results.atomic import csv_text, write_text

HERE = Path(__file__).resolve().parent
BINS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)


def main() -> None:
    """Judge what is stated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--cache", type=Path, default=HERE.parent / "out" / "lab_several_causes")
    parser.add_argument("--out", type=Path, default=HERE.parent / "out" / "planted_causes.csv")
    parser.add_argument("--scenes", type=int, default=SCENES.usual)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    campaign = load_campaign(options.campaign).with_motion()
    asked = Hypotheses(exclude=["base_slope"], contact_family=())
    simulator = SceneSimulator(campaign, load_study(options.scene), hypotheses=asked)
    space = cause_space(simulator.library, simulator.excluded)
    motions = np.asarray(campaign.motion_ids)
    with SimulationCache(simulator, options.cache / SIMULATIONS) as cache:
        scenes = simulate_scenes(cache, space, campaign.overturned > 0, motions, options.scenes)
    usable = np.isfinite(scenes.margins).mean(axis=1) >= 0.5
    from_prior = (np.arange(len(scenes)) < SCENES.at_random(options.scenes))[usable]
    known = scenes.known()
    emulator = known.emulator(space)
    covariance = np.linalg.inv(emulator.inverse)
    expected = CAUSES.acting * len(space.all_names)
    rng = np.random.default_rng(options.seed)
    stated, true = [], []
    for k in np.flatnonzero(from_prior):
        rest = np.arange(len(known)) != k
        without = replace(
            emulator,
            scenes=emulator.scenes[rest],
            inverse=np.linalg.inv(covariance[np.ix_(rest, rest)]),
            deviations=emulator.deviations[rest],
        )
        strong = rng.random() < CAUSES.acting
        factor = OUTCOME_MODEL.strength * rng.standard_normal() if strong else 0.0
        margins = np.where(np.isnan(known.margins[k]), emulator.centre, known.margins[k])
        outcomes = margins < factor
        if outcomes.all() or not outcomes.any():
            continue
        nuisances = known.nuisances.shape[1]
        model = OutcomeModel(space, without, outcomes, motions, nuisances, expected=expected)
        found = sample_posterior(model, np.arange(outcomes.size), rng)
        stated.append(found.particles.acts.mean(axis=0))
        true.append(np.append(known.acts[k], strong))
        print(f"{len(true)} campaigns", flush=True)
    said, acted = np.array(stated), np.array(true)
    rows = []
    for low, high in pairwise(BINS):
        inside = (said >= low) & ((said < high) | (high == 1.0))
        if inside.any():
            rows.append(
                {"from": low, "to": high, "effects": int(inside.sum()),
                 "stated": said[inside].mean(), "acted": acted[inside].mean()}
            )  # fmt: skip
    write_text(options.out, csv_text(rows, ".3g"))
    print(csv_text(rows, ".3g"))


if __name__ == "__main__":
    main()
