"""The measurement that would split a class of effects which the campaign cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.likelihood.equivalence import (
    CONFOUNDED,
    INSEPARABLE,
    expected_campaign,
    takes_for_alike,
)
from vsr2.diagnosis.likelihood.evidence import log_likelihood, mode, posterior
from vsr2.diagnosis.observed.observations import Observations
from vsr2.diagnosis.simulated.library import Entry, Library
from vsr2.diagnosis.where.places import SIGNIFICANT, Place
from vsr2.diagnosis.which.routes import Inference, Prepared

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
"""By stage."""
OWN_INSTRUMENTS = {
    "catch": "measure the slack of all that can hold the specimen, and film whether it is taut",
    "adhesion": "pull the specimen up from its base with a load cell before the first trial",
    "rolling_resistance": "look for soft or loose contact under the edges, and measure the torque "
    "that turns the specimen about one",
    "spin_friction": "turn the specimen slowly about the vertical and measure the torque",
    "base_asperity": "look under the specimen for grains and bumps, with feeler gauges or carbon "
    "paper between the base and the table",
    "table_pitch": "record the rotation of the table beside the specimen under one of the motions",
    "off_axis_motion": "record the table across the shaking and about the vertical",
    "vertical_motion": "record the table's vertical acceleration",
}
"""Of effects for which a stage's instrument says too little."""
MOST_SPLIT = 7
"""Members of a class for which a measurement is told: the most that a verdict names."""


def next_measurement(
    members: list[str],
    prepared: Prepared,
    found: Inference,
    seen: Observations,
    kept: NDArray[np.int64],
) -> dict[str, Any]:
    """What to measure next.

    For a class, the instruments that look directly at its first two members, and the trial of the
    campaign whose repetition separates these two most, each at its own best parameters and
    nuisances (expected log likelihood ratio per repeat, as much of it as counts, and the repeats
    after which the two no longer count as one class: the better one is then picked wrongly less
    than one time in ten, or by five times that separation where theory takes them for the same).
    Under `others` the same for the leader against each further member, up to `MOST_SPLIT`.

    Args:
        members: effects of the class, the leader first; one alone is checked directly.
        prepared: effects and their tables.
        found: inference on the campaign.
        seen: the whole campaign.
        kept: their indices.
    """
    library, tables = prepared.library, prepared.tables
    leader, *rivals = members[:MOST_SPLIT]
    ways = list(dict.fromkeys(_instrument(library[name]) for name in members[:2]))
    out: dict[str, Any] = {"what": "; or ".join(ways), "splits": members[:2]}
    if not rivals:
        return out
    expected, _ = expected_campaign(tables[leader], found.posteriors[leader])

    def likelihood(name: str) -> NDArray[np.float64]:
        node, z = mode(tables[name], posterior(tables[name], expected))
        at = tables[name].fine.at(node)
        values = log_likelihood(tables[name], at, expected, z[None, None])
        return np.asarray(values[0, 0], dtype=np.float64)

    own, alike = likelihood(leader), takes_for_alike()

    def split(rival: str) -> dict[str, Any]:
        gain = own - likelihood(rival)
        best = int(np.argmax(gain))
        information = found.exponent * float(max(gain[best], 0.0))
        enough = INSEPARABLE * (CONFOUNDED if alike(leader, rival) else 1.0)
        few = information < enough / 1000
        return {
            "trial": seen.campaign.trials[int(kept[best])].trial,
            "information_per_repeat": information,
            "repeats": None if few else int(np.ceil(enough / information)),
        }

    out |= split(rivals[0])
    others = [
        {"name": name, "what": _instrument(library[name]), **split(name)} for name in rivals[1:]
    ]
    return out | ({"others": others} if others else {})


def measurement_of_a_pair(names: Sequence[str], library: Library) -> dict[str, Any]:
    """What shows each of two effects that act together: nothing has to be split."""
    ways = dict.fromkeys(_instrument(library[name]) for name in names)
    return {"what": "; and ".join(ways), "splits": []}


def measurement_of_the_unknown(
    seen: Observations,
    excess: NDArray[np.float64],
    places: Sequence[Place],
    *,
    certain: bool = True,
) -> dict[str, Any]:
    """What to measure where no effect of the library explains the gap.

    Args:
        seen: the whole campaign.
        excess: loss of each trial over the floor under the best effect, shape (trials,).
        places: found by the scan, most significant first.
        certain: whether that is the verdict; False: it may be so.
    """
    worst = seen.campaign.trials[int(np.argmax(excess))].trial
    missing = {"B": "largest tilt and series", "M": "series", "T": "contacts and a second table"}
    case = "no effect of the library fits" if certain else "if the cause lies outside the library"
    what = (
        f"{case}: repeat trial {worst}, which the best of them explains "
        f"least, with instruments beyond tier {seen.tier} ({missing[seen.tier]} channel), and film "
        "base and edges"
    )
    if places and places[0].p_familywise <= SIGNIFICANT:
        what += f"; the residuals point to: {places[0].place}"
    return {"what": what, "splits": [], "trial": worst, "repeats": None}


def _instrument(effect: Entry) -> str:
    own = OWN_INSTRUMENTS.get(effect.name)
    return own or INSTRUMENTS.get(effect.stage, f"measure the {effect.stage}")
