"""The outcome model of `lab_several_causes.py`, made again from what it simulated."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vsr2.analysis.overturning_margin import MARGIN
from vsr2.campaign import Campaign, load_campaign
from vsr2.causes.margins.cause_space import CauseSpace, cause_space
from vsr2.causes.margins.outcome_model import OutcomeModel, Particles
from vsr2.causes.margins.session_steps import session_steps
from vsr2.causes.margins.simulated_scenes import SCENES, simulate_scenes
from vsr2.config import load_study
from vsr2.ensemble import Hypotheses
from vsr2.ensemble.protocol_cache import SIMULATIONS
from vsr2.ensemble.simulated.cache import SimulationCache
from vsr2.ensemble.simulated.scene_simulator import SceneSimulator

HERE = Path(__file__).resolve().parent
ASKED = Hypotheses(exclude=["base_slope"], contact_family=())
"""As `lab_several_causes.py` asks."""
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LabModel:
    """Of the laboratory's trials with a motion.

    Attributes:
        campaign: these trials.
        simulator: of the scene.
        space: of the effects whose margins are simulated.
        outcomes: model of outcomes, with these and what comes in at a session.
        without_steps: the same without what comes in at a session.
        cache: of simulations.
    """

    campaign: Campaign
    simulator: SceneSimulator
    space: CauseSpace
    outcomes: OutcomeModel
    without_steps: OutcomeModel
    cache: SimulationCache


def add_options(parser: argparse.ArgumentParser) -> None:
    """What says which search is meant."""
    parser.add_argument("--campaign", type=Path, default=HERE.parent / "out" / "lab")
    parser.add_argument("--scene", type=Path, default=HERE / "lab_diagnosis.yaml")
    parser.add_argument("--cache", type=Path, default=HERE.parent / "out" / "lab_several_causes")
    parser.add_argument("--scenes", type=int, default=SCENES.usual)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)


@contextmanager
def lab_model(options: argparse.Namespace) -> Iterator[LabModel]:
    """The model of a search; nothing is simulated that it simulated."""
    campaign = load_campaign(options.campaign).with_motion()
    simulator = SceneSimulator(
        campaign, load_study(options.scene), hypotheses=ASKED, threads=options.threads,
        seed=options.seed,
    )  # fmt: skip
    space = cause_space(simulator.library, simulator.excluded)
    motions, overturned = np.asarray(campaign.motion_ids), campaign.overturned > 0
    sessions = [trial.session for trial in campaign.trials]
    steps = session_steps(space, campaign.relative_order, sessions, simulator.excluded)
    count = len(simulator.nuisance_names)
    with SimulationCache(simulator, options.cache / SIMULATIONS) as cache:
        scenes = simulate_scenes(
            cache, space, overturned, motions, options.scenes, seed=options.seed
        )
        emulator = scenes.known().emulator(space)
        yield LabModel(
            campaign,
            simulator,
            space,
            OutcomeModel(steps.together, emulator, overturned, motions, count, steps=steps),
            OutcomeModel(space, emulator, overturned, motions, count),
            cache,
        )


def simulated_probability(model: OutcomeModel, drawn: Particles, margins: Array) -> Array:
    """Of overturning in each trial, the mean over draws, shape (trials,).

    As :meth:`OutcomeModel.probability`, with margins that are simulated and not emulated.

    Args:
        model: of outcomes, for scatter.
        drawn: of its posterior.
        margins: with the motion's strength, NaN where a simulation failed, shape (draws, trials).
    """
    reach = np.hypot(*model.scatter(drawn))[:, None]
    falls = np.nanmean(ndtr(-margins / reach), axis=0)
    return np.asarray((1 - MARGIN.lapse) * falls + 0.5 * MARGIN.lapse)
