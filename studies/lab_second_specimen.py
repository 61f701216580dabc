"""Predictions for the laboratory's second specimen, written before its outcomes are looked at.

    vsr2 campaign import-lab SOURCE --out out/lab_sp2 --specimen SP2
    python studies/lab_several_causes.py --seed N --out OUT
    python studies/lab_second_specimen.py --seed N --cache OUT [--draws N] [--threads N]

Both specimens stood on the table in every test. The posterior of what acts in the campaign of SP1
is drawn from. What acts on the motion, the strength of the motion and the scatter of margins are
the table's and the protocol's: they are kept. Of the specimen's own causes it is kept that they
act, for both specimens were set up by the same hands; their values are drawn from their priors
again, and so are the nuisances. But half a turn mirrors the motion, and whether SP1 was turned or
the record's sign is the other one is not known: in every other draw its turn is kept, too. What
comes in at a session is left out. The margins of SP2 are simulated with what acts in each draw.

The same rule predicts SP1, by its emulator and with posteriors of the other motions, which tells
what to expect. Writes OUT/predictions.csv, one row a trial of SP2 with a motion, and
OUT/expected.csv, the rule's scores on SP1.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab_model import ASKED, HERE, LabModel, add_options, lab_model, simulated_probability
from vsr2.analysis.probability import PROBABILITY_SCORES, probability_intervals
from vsr2.campaign import Campaign, load_campaign
from vsr2.causes.margins.acting_posterior import sample_posterior
from vsr2.causes.margins.held_out_causes import HELD_OUT_CAUSES, fold_posteriors, folds_of
from vsr2.causes.margins.margin_search import scene_margins
from vsr2.causes.margins.outcome_model import Particles
from vsr2.config import load_study
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator
from vsr2.results.atomic import csv_text, write_text

OUT = HERE.parent / "out"
OF_TABLE = "actuation"
"""Stage of the effects that act on the motion."""
TURN = ("registration", "yaw")
"""Effect and parameter that are kept in every other draw."""
PILOT = 8
"""Draws whose margins are sought first; their median is the guess for the others."""
Array = NDArray[np.float64]


def carried_over(lab: LabModel, found: Particles, rng: np.random.Generator) -> Particles:
    """Draws for another specimen on the same table, without what comes in at a session."""
    space = lab.space
    table = np.array([space.library[name].stage == OF_TABLE for name in space.names])
    turn = np.array(
        [(space.names[one.effect], one.parameter.name) == TURN for one in space.coordinates]
    )
    kept = table[space.effect_of] | (turn & (np.arange(len(found)) % 2 == 0)[:, None])
    own = found.points[:, : len(space.coordinates)]
    fresh = np.where(kept, own, space.draw(len(found), rng))
    acts = np.column_stack([found.acts[:, : len(space.names)], found.acts[:, -1]])
    nuisances = rng.standard_normal(found.nuisances.shape)
    return replace(found, points=fresh, acts=acts, nuisances=nuisances)


def expected_of_first(lab: LabModel, options: argparse.Namespace) -> Array:
    """What the rule predicts of SP1, without the motions that are predicted, shape (trials,)."""
    fold = folds_of(lab.outcomes)
    models = dict.fromkeys(np.unique(fold).tolist(), lab.outcomes)
    posteriors = fold_posteriors(
        models, fold, HELD_OUT_CAUSES.everything, options.seed, options.threads
    )
    p, rng = np.full(fold.size, np.nan), np.random.default_rng([options.seed, 1])
    for k, found in posteriors.items():
        rows = np.flatnonzero(fold == k)
        p[rows] = lab.without_steps.probability(carried_over(lab, found, rng), rows)
    return p


def margins_of_second(
    lab: LabModel, campaign: Campaign, drawn: Particles, options: argparse.Namespace
) -> Array:
    """Margins of the trials of SP2 with what acts in each draw, shape (draws, trials)."""
    simulator = SceneSimulator(
        campaign, load_study(options.second_scene), hypotheses=ASKED, threads=options.threads,
        seed=options.seed,
    )  # fmt: skip
    given = [
        (k + 1, lab.space.effects(point, acts[:-1]))
        for k, (point, acts) in enumerate(zip(drawn.points, drawn.acts, strict=True))
    ]
    with SimulationCache(simulator, options.out / SIMULATIONS) as cache:
        shape = (len(given), len(campaign))
        every, guess = np.ones(shape, dtype=bool), np.zeros(shape)
        first = scene_margins(cache, given[:PILOT], guess[:PILOT], every[:PILOT])
        guess[:] = np.nanmedian(first, axis=0)
        rest = scene_margins(cache, given[PILOT:], guess[PILOT:], every[PILOT:])
        print(f"{cache.simulated} simulations of SP2")
    return np.concatenate([first, rest])


def main() -> None:
    """Predict."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--second", type=Path, default=OUT / "lab_sp2")
    parser.add_argument("--second-scene", type=Path, default=HERE / "lab_second_specimen.yaml")
    parser.add_argument("--out", type=Path, default=OUT / "lab_second_specimen")
    parser.add_argument("--draws", type=int, default=48)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with lab_model(options) as lab:
        seen, rng = lab.campaign, np.random.default_rng([options.seed, 0])
        scores = probability_intervals(
            seen.overturned > 0, expected_of_first(lab, options), seen.motion_ids
        )
        expected: list[dict[str, Any]] = [
            {"score": name, "value": scores[name].value, "low": scores[name].low,
             "high": scores[name].high}
            for name in PROBABILITY_SCORES
        ]  # fmt: skip
        write_text(options.out / "expected.csv", csv_text(expected, ".4g"))
        for row in expected:
            print("SP1, out of fold, {score}: {value:.3f} [{low:.3f}, {high:.3f}]".format(**row))
        everything = sample_posterior(
            lab.outcomes, np.arange(len(seen)), rng, particles=HELD_OUT_CAUSES.everything
        ).particles
        chosen = everything.taken(rng.choice(len(everything), options.draws, replace=False))
        drawn = carried_over(lab, chosen, rng)
        second = load_campaign(options.second).with_motion()
        margins = margins_of_second(lab, second, drawn, options)
        margins -= lab.without_steps.log_strength(drawn)[:, None]
        p = simulated_probability(lab.without_steps, drawn, margins)
    rows = [
        {"trial": trial.trial, "probability": f"{q:.4f}", "overturns": int(q > 0.5)}
        for trial, q in zip(second.trials, p, strict=True)
    ]
    text = csv_text(rows)
    write_text(options.out / "predictions.csv", text)
    print(f"{int((p > 0.5).sum())} of {len(p)} trials of SP2 overturn; {p.sum():.1f} expected")
    print(f"SHA-256 of predictions.csv: {hashlib.sha256(text.encode()).hexdigest()}")


if __name__ == "__main__":
    main()
