"""The measurement that would split a class of effects which the campaign cannot tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.equivalence import INSEPARABLE, expected_campaign
from vsr2.diagnosis.evidence import Data, Posterior, log_likelihood, mode, posterior
from vsr2.diagnosis.inference import Prepared
from vsr2.diagnosis.observations import Observations

INSTRUMENTS = {
    "geometry": "scan the specimen and its base, and tilt the base slowly until it overturns: the "
    "static angle gives the slenderness without any motion",
    "inertia": "weigh the specimen and swing it as a pendulum: mass centre and inertia",
    "contact": "push the specimen slowly and let it rock freely on the table at rest: friction and "
    "decay of rocking",
    "mechanism": "let the specimen rock freely on the table at rest and film it: energy lost per "
    "impact",
    "actuation": "record the table beside the specimen with an independent accelerometer (and a "
    "rotation sensor), and compare with the channel that drives the simulation",
    "measurement": "record the table with a second instrument",
    "start": "survey the specimen's position and yaw before every trial",
    "order": "repeat the first trials at the end of the campaign, and inspect the edges between "
    "sessions",
    "outcome": "film every trial and judge all of them anew by one rule",
}


def next_measurement(
    members: list[str],
    prepared: Prepared,
    posteriors: Mapping[str, Posterior],
    observed: Data,
    seen: Observations,
    kept: NDArray[np.int64],
) -> dict[str, Any]:
    """What to measure next.

    For a class, both sides of its most different stages: the instrument that looks at a stage
    directly, and the trial of the campaign whose repetition separates the first two members most,
    each at its own best parameters and nuisances (expected log likelihood ratio per repeat, and the
    repeats after which the better one is picked wrongly less than one time in ten).

    Args:
        members: effects of the class, the leader first; one alone is checked directly.
        prepared: effects and their tables.
        posteriors: of each.
        observed: kept trials.
        seen: the whole campaign.
        kept: their indices.
    """
    library, tables = prepared.library, prepared.tables
    leader = members[0]
    stages = list(dict.fromkeys(library[name].stage for name in members))
    direct = "; or ".join(INSTRUMENTS.get(stage, f"measure the {stage}") for stage in stages[:2])
    out: dict[str, Any] = {"what": direct, "splits": members[:2] if len(members) > 1 else members}
    if len(members) == 1:
        return out
    expected, _ = expected_campaign(tables[leader], posteriors[leader])
    rival = members[1]
    matched = posterior(tables[rival], expected)
    own = posterior(tables[leader], expected)

    def likelihood(name: str, found: Posterior) -> NDArray[np.float64]:
        node, z = mode(tables[name], found)
        at = tables[name].fine.at(node)
        values = log_likelihood(tables[name], at, expected, z[None, None])
        return np.asarray(values[0, 0], dtype=np.float64)

    gain = likelihood(leader, own) - likelihood(rival, matched)
    best = int(np.argmax(gain))
    trial = seen.campaign.trials[int(kept[best])]
    information = float(max(gain[best], 0.0))
    out |= {
        "trial": trial.trial,
        "information_per_repeat": information,
        "repeats": None
        if information < INSEPARABLE / 1000
        else int(np.ceil(INSEPARABLE / information)),
    }
    return out
