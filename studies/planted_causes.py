"""Whether causes act as often as is stated: simulated campaigns of the laboratory's as truth.

    python studies/lab_several_causes.py        # simulates the scenes of the emulator
    python studies/planted_causes.py [--campaigns N] [--scenes N] [--seed N]

What acts in a planted campaign is drawn from the prior of the outcome model: about two effects, a
strength of the motion and scatter. All its trials are simulated; the emulator has not seen them.
Writes to OUT, for bins of the stated probability, how often effects acted.
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
from vsr2.diagnosis.margins.cause_space import cause_space
from vsr2.diagnosis.margins.margin_search import scene_margins
from vsr2.diagnosis.margins.outcome_model import OutcomeModel
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
    parser.add_argument("--campaigns", type=int, default=20)
    parser.add_argument("--scenes", type=int, default=SCENES.usual)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    campaign = load_campaign(options.campaign).with_motion()
    asked = Hypotheses(exclude=["base_slope"], contact_family=())
    simulator = SceneSimulator(
        campaign, load_study(options.scene), hypotheses=asked, threads=options.threads
    )
    space = cause_space(simulator.library, simulator.excluded)
    motions = np.asarray(campaign.motion_ids)
    overturned, rng = campaign.overturned > 0, np.random.default_rng(options.seed)
    stated, true = [], []
    with SimulationCache(simulator, options.cache / SIMULATIONS) as cache:
        scenes = simulate_scenes(cache, space, overturned, motions, options.scenes)
        emulator = scenes.known().emulator(space)
        nuisances = len(simulator.nuisance_names)
        model = OutcomeModel(space, emulator, overturned, motions, nuisances)
        drawn = model.draw(options.campaigns, rng)
        guess = model.margins(drawn)[0] + model.log_strength(drawn)[:, None]
        planted = [
            (options.scenes + k + 1, space.effects(drawn.points[k], drawn.acts[k, :-1]))
            for k in range(options.campaigns)
        ]
        margins = scene_margins(cache, planted, guess, np.ones_like(guess, dtype=bool))
    _, motion = np.unique(motions, return_inverse=True)
    by_motion, by_trial = model.scatter(drawn)
    for k, own in enumerate(margins):
        own = np.where(np.isnan(own), guess[k], own) - model.log_strength(drawn)[k]
        own = own + by_motion[k] * rng.standard_normal(motion.max() + 1)[motion]
        outcomes = own + by_trial[k] * rng.standard_normal(own.size) < 0
        if outcomes.all() or not outcomes.any():
            continue
        found = sample_posterior(replace(model, overturned=outcomes), np.arange(outcomes.size), rng)
        stated.append(found.particles.acts.mean(axis=0))
        true.append(drawn.acts[k])
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
