"""What a pack is made of."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from vsr2.blind.form.reader import Ends, Part, misfit
from vsr2.errors import BlindError

LONGEST_SERIES_INTERVAL = 0.1
"""Greatest that a pack may ask for [s]: beyond it a series does not show the rocking of a rock of
1 m, with periods from about 0.5 s."""


class EngineName(StrEnum):
    """What simulates campaigns."""

    MUJOCO = "mujoco"
    BULLET = "bullet"


ENGINES = tuple(EngineName)


class Kind(StrEnum):
    """What acts in a campaign, and whether the diagnosis may use it."""

    SINGLE = "single"
    NONE = "none"
    PAIR = "pair"
    UNKNOWN = "unknown"
    REFERENCE = "reference"
    """Open: its truth, a known effect or none, is published."""


KINDS = tuple(Kind)

CLASSES: tuple[tuple[str, ...], ...] = (
    ("table_gain", "slenderness", "table_pitch"),
    ("com_offset", "base_slope"),
    ("wear", "change_point"),
)
"""Effects that outcomes cannot tell apart: a planar block feels the table's acceleration only
through a / (g tan alpha); an offset of the mass centre and a slope turn the same angle into both
uplift thresholds; a step is a steep trend. All other effects are classes of their own."""

_Deviation = Annotated[float, Field(ge=0)]


class Tolerances(Part):
    """Standard deviations of the nuisances, published with a pack: short for its `nuisances`.

    Attributes:
        width, depth, height: relative.
        energy_ratio: relative.
        friction: relative.
        yaw: of each trial's start [rad].
        offset: of each trial's start, x and y [m].
        input_gain: least and greatest standard error of the motion that a trial was shaken with
            about the recorded one, relative; one size a campaign, a fresh error each trial.
        displacement_noise: least and greatest standard error of the recorded displacement [m].
        acceleration_noise: the same of the acceleration [m/s^2].
        peak_tilt_noise: standard error of the largest tilt [rad].
        tilt_noise, position_noise, orientation_noise: of the series [rad], [m], [rad].
    """

    model_config = ConfigDict(extra="forbid")

    width: _Deviation = 0.01
    depth: _Deviation = 0.01
    height: _Deviation = 0.01
    energy_ratio: _Deviation = 0.01
    friction: _Deviation = 0.05
    yaw: _Deviation = 0.017
    offset: _Deviation = 0.002
    input_gain: Ends = (0.001, 0.005)
    displacement_noise: Ends = (2e-6, 2e-5)
    acceleration_noise: Ends = (0.005, 0.05)
    peak_tilt_noise: _Deviation = 0.0005
    tilt_noise: _Deviation = 0.0005
    position_noise: _Deviation = 0.0003
    orientation_noise: _Deviation = 0.0005

    @model_validator(mode="after")
    def _check_given(self) -> Tolerances:
        for one, other in (("width", "height"), ("height", "width")):
            if one in self.model_fields_set and other not in self.model_fields_set:
                raise misfit(other, None, f"give it beside {one}: both, or neither")
        for name in ("input_gain", "displacement_noise", "acceleration_noise"):
            if min(getattr(self, name)) < 0:
                raise misfit(name, getattr(self, name), "it should be 0 or more")
        return self


@dataclass(frozen=True)
class PackSettings:
    """How many campaigns of what.

    Attributes:
        engines: that simulate.
        single: campaigns with one effect; for each engine, or one number for all
        none: campaigns without any; likewise
        pair: campaigns with two effects; likewise
        unknown: campaigns whose effect the diagnosis may not use; likewise
        reference: open campaigns without effect; likewise
        leave_one_out: so many campaigns of kind unknown for every effect that reaches its
            detection limit, beside what is asked for of the kinds
        trials: trials a campaign
        motions: ground motions a campaign
        sessions: sessions a campaign
        catalogue: ground motions of the pack
        protocols: of the pack: campaigns of one share amplitudes, order and motions
        series_interval: of the series [s], up to 0.1; 0: none, tiers B and M alone
        effects: that may be drawn; empty: all that the engine has.
        hidden: effect classes that may be left out of the library, at most, each with all that the
            library declares alike to it; at least 3 where there are pairs
        classes: equivalence classes that verdicts are judged by.
        replicates: draws of nuisances with and without an effect that measure its signal
        signal_trials: trials on which signals are measured
        development: an open pack: scored as often as you like
        tolerances: of the nuisances.
    """

    engines: tuple[str, ...] = (EngineName.MUJOCO.value,)
    single: int | tuple[int, ...] = 6
    none: int | tuple[int, ...] = 3
    pair: int | tuple[int, ...] = 1
    unknown: int | tuple[int, ...] = 2
    reference: int | tuple[int, ...] = 0
    leave_one_out: int = 0
    trials: int = 150
    motions: int = 15
    sessions: int = 8
    catalogue: int = 20
    protocols: int = 1
    series_interval: float = 0.02
    effects: tuple[str, ...] = ()
    hidden: int = 8
    classes: tuple[tuple[str, ...], ...] = CLASSES
    replicates: int = 12
    signal_trials: int = 48
    development: bool = False
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        if set(self.engines) - set(ENGINES) or not self.engines:
            raise BlindError(
                f"engines are {', '.join(self.engines) or 'none'}; choose from {', '.join(ENGINES)}"
            )
        for kind in KINDS:
            given = getattr(self, kind)
            numbers = (given,) * len(self.engines) if isinstance(given, int) else given
            if len(numbers) != len(self.engines) or min(numbers) < 0:
                raise BlindError(
                    f"{kind} is {given}; give 0 or more campaigns, one number for each of "
                    f"{', '.join(self.engines)} or one for all"
                )
            object.__setattr__(self, kind, numbers)
        for name, least, most in (
            ("protocols", 1, None),
            ("hidden", 2, None),
            ("leave_one_out", 0, None),
            ("motions", 1, min(self.catalogue, self.trials)),
            ("sessions", 1, self.trials),
            ("replicates", 4, None),
            ("signal_trials", 1, None),
        ):
            value = getattr(self, name)
            if value < least or (most is not None and value > most):
                bound = "" if most is None else f" and at most {most}"
                raise BlindError(f"{name} is {value}; give at least {least}{bound}")
        counts = [self.counts(engine) for engine in self.engines]
        acting = any(count[Kind.SINGLE] + count[Kind.PAIR] for count in counts)
        if max(count[Kind.UNKNOWN] for count in counts) == 1 and acting and not self.leave_one_out:
            raise BlindError(
                f"unknown is {self.unknown}; where effects of one class alone are unknown, all "
                "others lack that class, and one that lacks another has an effect of it: give 0, "
                "or at least 2 of an engine"
            )
        if sum(sum(count.values()) for count in counts) + self.leave_one_out == 0:
            raise BlindError("no campaign asked for; give a kind a number above 0")
        milliseconds = self.series_interval * 1000
        within = 0 <= self.series_interval <= LONGEST_SERIES_INTERVAL
        if not within or abs(milliseconds - round(milliseconds)) > 1e-6:
            raise BlindError(
                f"series_interval is {self.series_interval} s; give a multiple of 0.001 up to "
                f"{LONGEST_SERIES_INTERVAL}, or 0 for no series"
            )

    def counts(self, engine: str) -> dict[Kind, int]:
        """Campaigns of an engine by kind."""
        return {kind: getattr(self, kind)[self.engines.index(engine)] for kind in KINDS}

    def asks(self, engine: str) -> bool:
        """Whether campaigns with effects are asked of an engine."""
        counts = self.counts(engine)
        acting = sum(counts[kind] for kind in (Kind.SINGLE, Kind.PAIR, Kind.UNKNOWN))
        return acting + self.leave_one_out > 0

    def class_of(self, effect: str) -> tuple[str, ...]:
        """The equivalence class that holds an effect."""
        return next((c for c in self.classes if effect in c), (effect,))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self) | {"tolerances": self.tolerances.model_dump()}
