"""The trials by which the time step of a campaign's simulations is chosen."""

from __future__ import annotations

from vsr2.analysis.time_steps import TrialsOf, drawn_trials
from vsr2.campaign import Campaign
from vsr2.config import Study
from vsr2.effects import apply_effects
from vsr2.ensemble.simulated.scene_simulator import base_trials
from vsr2.trial import Trial


def campaign_step_trials(campaign: Campaign) -> TrialsOf:
    """Makes one trial of each motion of a campaign, drawn by the study's seed.

    For :func:`vsr2.analysis.choose_time_step`. The motions are driven as a simulation of the
    campaign drives them, and the study's effects act; nuisances are not drawn.
    """

    def made(study: Study) -> list[Trial]:
        moved = campaign.with_motion()
        kept = drawn_trials(moved.motion_ids.tolist(), study.seed)
        base = base_trials(moved, study, None, kept)
        return apply_effects(
            [base[i] for i in kept],
            study.effects,
            relative_order=[float(moved.relative_order[i]) for i in kept],
            sessions=[moved.trials[i].session for i in kept],
            seed=study.seed,
        )

    return made
