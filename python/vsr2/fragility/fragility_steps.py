"""The trials by which the time step of a fragility study is chosen."""

from __future__ import annotations

from dataclasses import replace

from vsr2.analysis.time_steps import TrialsOf, drawn_trials
from vsr2.config import Study
from vsr2.fragility.run import with_effects
from vsr2.fragility.settings import FragilityStudy
from vsr2.fragility.trials import fragility_trials
from vsr2.trial import Trial


def fragility_step_trials(study: FragilityStudy) -> TrialsOf:
    """Makes one trial of each motion, of its scalings, azimuths and replicates one drawn by seed.

    For :func:`vsr2.analysis.choose_time_step`; effects act in them.
    """

    def made(changed: Study) -> list[Trial]:
        given = replace(study, study=changed)
        asked, planned = fragility_trials(given)
        trials = with_effects(given, asked, planned)
        return [trials[i] for i in drawn_trials([one.motion for one in planned], changed.seed)]

    return made
