"""What a pack is made of."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

from vsr2.errors import BlindError

Kind = Literal["single", "none", "pair", "unknown"]
ENGINES = ("mujoco", "bullet")
LONGEST_SERIES_INTERVAL = 0.1
"""[s]; a rock of 1 m rocks with periods from about 0.5 s."""
KINDS: tuple[Kind, ...] = ("single", "none", "pair", "unknown")

CLASSES: tuple[tuple[str, ...], ...] = (
    ("table_gain", "slenderness", "table_pitch"),
    ("com_offset", "base_slope"),
    ("wear", "change_point"),
)
"""Effects that outcomes cannot tell apart: a planar block feels the table's acceleration only
through a / (g tan alpha); an offset of the mass centre and a slope turn the same angle into both
uplift thresholds; a step is a steep trend. All other effects are classes of their own."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of the nuisances, published with a pack.

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

    width: float = 0.01
    depth: float = 0.01
    height: float = 0.01
    energy_ratio: float = 0.01
    friction: float = 0.05
    yaw: float = 0.017
    offset: float = 0.002
    input_gain: tuple[float, float] = (0.001, 0.005)
    displacement_noise: tuple[float, float] = (2e-6, 2e-5)
    acceleration_noise: tuple[float, float] = (0.005, 0.05)
    peak_tilt_noise: float = 0.0005
    tilt_noise: float = 0.0005
    position_noise: float = 0.0003
    orientation_noise: float = 0.0005


@dataclass(frozen=True)
class PackSettings:
    """How many campaigns of what.

    Attributes:
        engines: that simulate.
        single, none, pair, unknown: numbers of campaigns by kind: one for each engine, or one that
            holds for all of them.
        leave_one_out: campaigns of kind unknown for each effect that reaches its floor, beside the
            numbers above.
        trials, motions, sessions: of each campaign.
        catalogue: ground motions of the pack, of which a protocol draws its own.
        protocols: of the pack; campaigns of one protocol share amplitudes, order, sessions and
            recorded motions, so that simulations for one serve all of them.
        series_interval: [s], up to 0.1; 0: no series, so that the pack ends at tier M.
        effects: that may be drawn; empty: all that the engine has.
        hidden: number of classes that may be left out of the library, of unknown effects and of
            decoys alike; each costs the diagnosis fits of its own. At least 3 where there are
            pairs; with `leave_one_out` all classes.
        classes: equivalence classes that verdicts are judged by.
        replicates: twins, draws of nuisances and starts with the effect and without, with which
            the signal of each drawn effect is measured.
        floor_trials: trials of the design on which it is measured.
        development: the pack is open: it may be scored any number of times, campaign by campaign.
        tolerances: of the nuisances.
    """

    engines: tuple[str, ...] = ("mujoco",)
    single: int | tuple[int, ...] = 6
    none: int | tuple[int, ...] = 3
    pair: int | tuple[int, ...] = 1
    unknown: int | tuple[int, ...] = 2
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
    floor_trials: int = 48
    development: bool = False
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        strange = set(self.engines) - set(ENGINES)
        if strange or not self.engines:
            raise BlindError(
                f"engines are {', '.join(self.engines) or 'none'}; choose from {', '.join(ENGINES)}"
            )
        for name in KINDS:
            given = getattr(self, name)
            numbers = (given,) * len(self.engines) if isinstance(given, int) else given
            if len(numbers) != len(self.engines) or min(numbers) < 0:
                raise BlindError(
                    f"{name} is {given}; give 0 or more campaigns, one number for each of "
                    f"{', '.join(self.engines)} or one for all"
                )
            object.__setattr__(self, name, numbers)
        if self.protocols < 1 or self.hidden < 2:
            raise BlindError(
                f"protocols is {self.protocols} and hidden {self.hidden}; give at least 1 and 2"
            )
        if self.leave_one_out < 0:
            raise BlindError(f"leave_one_out is {self.leave_one_out}; give 0 or more campaigns")
        counts = [self.counts(engine) for engine in self.engines]
        most = max(count["unknown"] for count in counts)
        acting = any(count["single"] + count["pair"] for count in counts)
        if most == 1 and acting and not self.leave_one_out:
            raise BlindError(
                f"unknown is {self.unknown}; where effects of one class alone are unknown, all "
                "others lack that class, and one that lacks another has an effect of it: give 0, "
                "or at least 2 of an engine"
            )
        asked = sum(n for engine in self.engines for n in self.counts(engine).values())
        if asked + self.leave_one_out == 0:
            raise BlindError("no campaign asked for; give a kind a number above 0")
        if not 1 <= self.motions <= min(self.catalogue, self.trials):
            raise BlindError(
                f"motions is {self.motions}; it must lie from 1 to the catalogue's "
                f"{self.catalogue} and the campaign's {self.trials} trials"
            )
        if not 1 <= self.sessions <= self.trials:
            raise BlindError(
                f"sessions is {self.sessions}; it must lie from 1 to the {self.trials} trials"
            )
        if self.replicates < 4 or self.floor_trials < 1:
            raise BlindError(
                f"replicates is {self.replicates} and floor_trials {self.floor_trials}; the floor "
                "needs at least 4 and 1"
            )
        if (
            not 0 <= self.series_interval <= LONGEST_SERIES_INTERVAL
            or abs(self.series_interval * 1000 - round(self.series_interval * 1000)) > 1e-6
        ):
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
        return sum(counts.values()) - counts["none"] + self.leave_one_out > 0

    def class_of(self, effect: str) -> tuple[str, ...]:
        """The equivalence class that holds an effect."""
        return next((c for c in self.classes if effect in c), (effect,))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> PackSettings:
        """What :meth:`to_json` gave."""
        known = {f.name for f in fields(cls)}
        values = {key: value for key, value in data.items() if key in known}
        tolerances: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in values.pop("tolerances").items()
        }
        for name in ("engines", *KINDS):
            values[name] = tuple(values[name])
        values["effects"] = tuple(values["effects"])
        values["classes"] = tuple(tuple(c) for c in values["classes"])
        return cls(**values, tolerances=Tolerances(**tolerances))
