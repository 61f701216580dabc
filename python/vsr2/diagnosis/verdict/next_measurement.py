"""The measurement that would split a class of effects which the campaign cannot tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.campaign import Tier
from vsr2.diagnosis.where.scan import Location
from vsr2.effects import Effect
from vsr2.effects.effect import Stage
from vsr2.ensemble.observed.observations import Observations
from vsr2.ensemble.simulated.library import Library
from vsr2.posterior.sets import are_alike
from vsr2.posterior.training import Found, Posterior


class MeasurementKind(StrEnum):
    """What a measurement is for: one effect, members of a class, several that act, no effect."""

    CHECK = "check"
    SPLIT = "split"
    BOTH = "both"
    OUT_OF_LIBRARY = "out_of_library"


class Instrument(StrEnum):
    """What looks directly at an effect."""

    SCAN_AND_TILT = "scan_and_tilt"
    WEIGH_AND_SWING = "weigh_and_swing"
    PUSH_AND_ROCK = "push_and_rock"
    FILM_FREE_ROCKING = "film_free_rocking"
    TABLE_SENSORS = "table_sensors"
    SURVEY_STARTS = "survey_starts"
    REPEAT_FIRST_TRIALS = "repeat_first_trials"
    FILM_OUTCOMES = "film_outcomes"
    SLACK = "slack"
    PULL_OFF = "pull_off"
    EDGE_TORQUE = "edge_torque"
    SPIN_TORQUE = "spin_torque"
    FEELER_GAUGES = "feeler_gauges"
    TABLE_ROTATION = "table_rotation"
    OFF_AXIS_RECORD = "off_axis_record"
    VERTICAL_RECORD = "vertical_record"


BY_STAGE: dict[Stage, Instrument] = {
    "geometry": Instrument.SCAN_AND_TILT,
    "inertia": Instrument.WEIGH_AND_SWING,
    "contact": Instrument.PUSH_AND_ROCK,
    "mechanism": Instrument.FILM_FREE_ROCKING,
    "actuation": Instrument.TABLE_SENSORS,
    "start": Instrument.SURVEY_STARTS,
    "order": Instrument.REPEAT_FIRST_TRIALS,
    "outcome": Instrument.FILM_OUTCOMES,
}
BY_EFFECT: dict[str, Instrument] = {
    "catch": Instrument.SLACK,
    "adhesion": Instrument.PULL_OFF,
    "rolling_resistance": Instrument.EDGE_TORQUE,
    "spin_friction": Instrument.SPIN_TORQUE,
    "base_asperity": Instrument.FEELER_GAUGES,
    "table_pitch": Instrument.TABLE_ROTATION,
    "off_axis_motion": Instrument.OFF_AXIS_RECORD,
    "vertical_motion": Instrument.VERTICAL_RECORD,
    "registration": Instrument.SURVEY_STARTS,
}
"""Of effects for which a stage's instrument says too little."""


@dataclass(frozen=True)
class MeasurementConstants:
    """How repeats are counted; chosen by hand.

    Attributes:
        enough: information at which the better of two effects is picked wrongly one time in ten:
            d^2 / 2 with d = 2 * 1.28 [nat].
        alike: times as much is asked for where two are declared alike.
        negligible: share of `enough` below which no number of repeats is stated.
        members: of a class for which a measurement is stated at most.
    """

    enough: float = 3.28
    alike: float = 5.0
    negligible: float = 1e-3
    members: int = 7


MEASUREMENT = MeasurementConstants()


@dataclass(frozen=True)
class Repetition:
    """The trial whose repetition separates two effects most.

    Attributes:
        trial: id.
        information_per_repeat: expected log likelihood ratio [nat].
        repeats: after which the two no longer count as one class; None: no number of them.
    """

    trial: str
    information_per_repeat: float
    repeats: int | None


@dataclass(frozen=True)
class Rival:
    """A further member of a class, and what separates the leader from it."""

    name: str
    instrument: Instrument
    repetition: Repetition


@dataclass(frozen=True)
class OutOfLibrary:
    """What to measure where the cause may lie outside the library.

    Attributes:
        trial: id of the trial that the best effect explains least.
        tier: that the campaign has, beyond which instruments are needed.
        location: the most significant that stands out; None: none.
    """

    trial: str
    tier: Tier
    location: Mapping[str, Any] | None


@dataclass(frozen=True)
class Measurement:
    """What would decide what a verdict leaves open.

    Attributes:
        kind: what for.
        splits: effects that it separates, or the one that it checks.
        instruments: that look directly at these, or at each of the effects that act together.
        repetition: without new instruments, for the first two of `splits`.
        others: the same for the leader against each further member.
        out_of_library: alone, or before all else if the verdict is open.
    """

    kind: MeasurementKind
    splits: tuple[str, ...] = ()
    instruments: tuple[Instrument, ...] = ()
    repetition: Repetition | None = None
    others: tuple[Rival, ...] = ()
    out_of_library: OutOfLibrary | None = None

    def to_json(self) -> dict[str, Any]:
        """As it stands in `diagnosis.json`."""
        return asdict(self)


def next_measurement(
    members: Sequence[str],
    posterior: Posterior,
    found: Found,
    seen: Observations,
    trials: NDArray[np.int64],
) -> Measurement:
    """What to measure next.

    For a class, the instruments that look directly at its first two members, and the trial of the
    campaign whose repetition separates these two most, each as in the simulated campaigns that are
    nearest to the observed one. The same for the leader against each further member.

    Args:
        members: effects of the class, the leader first; one alone is checked directly.
        posterior: trained.
        found: inference on the campaign.
        seen: the whole campaign.
        trials: indices of those simulated.
    """
    library = posterior.parameters.library
    leader, *rivals = members[: MEASUREMENT.members]
    first = tuple(members[:2])
    ways = tuple(dict.fromkeys(instrument(library[name]) for name in first))
    if not rivals:
        return Measurement(MeasurementKind.CHECK, first, ways)
    own = posterior.parameters.expected(leader, found.residuals)

    def split(rival: str) -> Repetition:
        gap = own - posterior.parameters.expected(rival, found.residuals)
        gain = 0.5 * (gap**2).reshape(-1, trials.size).sum(axis=0)
        best = int(np.argmax(gain))
        alike = are_alike(library[leader], library[rival])
        enough = MEASUREMENT.enough * (MEASUREMENT.alike if alike else 1.0)
        information = float(gain[best])
        few = information < enough * MEASUREMENT.negligible
        return Repetition(
            seen.campaign.trials[int(trials[best])].trial,
            information,
            None if few else int(np.ceil(enough / information)),
        )

    return Measurement(
        MeasurementKind.SPLIT,
        first,
        ways,
        split(rivals[0]),
        tuple(Rival(name, instrument(library[name]), split(name)) for name in rivals[1:]),
    )


def measurement_of_several(names: Sequence[str], library: Library) -> Measurement:
    """What shows each of the effects that act together: nothing has to be split."""
    ways = tuple(dict.fromkeys(instrument(library[name]) for name in names))
    return Measurement(MeasurementKind.BOTH, instruments=ways)


def measurement_out_of_library(
    seen: Observations, excess: NDArray[np.float64], locations: Sequence[Location]
) -> OutOfLibrary:
    """What to measure where no effect of the library explains the gap.

    Args:
        seen: the whole campaign.
        excess: loss of each trial over the floor under the best effect, shape (all trials,).
        locations: found by the scan, most significant first.
    """
    found = next((one for one in locations if one.stands_out), None)
    return OutOfLibrary(
        seen.campaign.trials[int(np.argmax(excess))].trial,
        seen.tier,
        None if found is None else found.to_json(),
    )


def instrument(effect: Effect) -> Instrument:
    """That looks directly at an effect: its own, or that of its stage."""
    return BY_EFFECT.get(effect.name) or BY_STAGE[effect.stage]
