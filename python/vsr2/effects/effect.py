"""The effect: what every entry of the library is, and what a user's own effect derives from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from types import ModuleType
from typing import ClassVar, Literal, Protocol, Self, get_args

import numpy as np
from numpy.typing import NDArray

from vsr2.effects.own_code import own_code
from vsr2.effects.parameter import Parameter, Prior
from vsr2.errors import ConfigError
from vsr2.motion import Motion
from vsr2.near_words import offer
from vsr2.trial import Observation, Trial

Array = NDArray[np.float64]
Stage = Literal[
    "geometry", "order", "inertia", "contact", "mechanism", "actuation", "start", "outcome"
]
STAGES: tuple[Stage, ...] = get_args(Stage)
"""In the order of application."""
Channel = Literal["motion", "tilt", "yaw", "slip", "rest pose", "label"]


@dataclass(frozen=True, eq=False)
class Response:
    """What a bench measures in a trial; rows in time, from the start of the motion.

    Attributes:
        time: shape (n,) [s].
        tilt: away from the settled pose, relative to the pedestal, shape (n,) [rad].
        position: mass centre p_WB, shape (n, 3) [m].
        velocity: of the mass centre, shape (n, 3) [m/s].
        angular_velocity: in the world, shape (n, 3) [rad/s].
        pedestal: its displacement along x, shape (n,) [m].
        pitch: turn of the pedestal about y, shape (n,) [rad].
        observation: what is written down, after effects on the outcome.
    """

    time: Array
    tilt: Array
    position: Array
    velocity: Array
    angular_velocity: Array
    pedestal: Array
    pitch: Array
    observation: Observation


class Bench(Protocol):
    """Where effects are checked: a nominal block and a scan-like rock, and a way to run them."""

    def block(self) -> Trial:
        """A homogeneous block, 0.4 m x 0.6 m x 1.2 m, on an even pedestal, at rest."""

    def scan(self) -> Trial:
        """A rock with the irregular hull of a scan."""

    def push(self, acceleration: float, *, duration: float = ...) -> Motion:
        """A motion that reaches a constant acceleration [m/s^2] smoothly and holds it [s]."""

    def pulse(self, peak_acceleration: float, frequency: float) -> Motion:
        """A cosine pulse x = A (1 - cos 2 pi F t) of a peak acceleration [m/s^2] and F [Hz]."""

    def run(
        self,
        trial: Trial,
        effect: Effect | None = None,
        values: Mapping[str, float] | None = None,
        *,
        tail: float = 0.0,
    ) -> Response:
        """One trial of `trial` with the effect, settled first; `tail` [s] after the motion."""

    def release(self, trial: Trial, tilt: float, duration: float, *, spin: float = 0.0) -> Response:
        """Free motion for a time [s]: let go tilted about its edge towards +x [rad] and spinning.

        The spin is about the vertical [rad/s]; tilts count from upright.
        """


@dataclass(frozen=True)
class Circumstances:
    """Of one trial in its campaign.

    Attributes:
        order: 0 at the first trial, 1 at the last.
        session: of the trial.
        sessions: all of the campaign, in order of execution.
        rng: for this trial and effect, from seeds alone: common random numbers.
    """

    order: float
    session: str
    sessions: tuple[str, ...]
    rng: np.random.Generator


@dataclass(frozen=True)
class Check:
    """A number that an effect gives against what theory says.

    Attributes:
        what: in words, with its source.
        measured, expected, tolerance: of the same unit.
    """

    what: str
    measured: float
    expected: float
    tolerance: float

    @property
    def good(self) -> bool:
        """Whether they agree within the tolerance."""
        return abs(self.measured - self.expected) <= self.tolerance


class Effect:
    """An effect that a simulation may lack.

    Derive a class, fill in the attributes and write `change` (or `observe`). The values that a hook
    gets hold every parameter. The same instance serves all trials: keep no state in it.

    Attributes:
        name: as a study writes it.
        meaning: one sentence.
        parameters: see :class:`Parameter`.
        channels: of the response that it touches.
        confounded_with: names of effects that look alike.
        source: where it is described.
        stage: what it changes; fixes the order of application (`STAGES`).
        rank: order within the stage, smallest first; then by name.
        jump: why responses jump beside the null value, where they do; empty: they do not.
        once: why it cannot act in a trial in which it acts already; empty: it can.
        parts: effects that it brings in, each at its own place in the order, instead of a `change`
            of its own; its parameters have the names of part and parameter, such as
            `table_gain_change`.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    channels: ClassVar[tuple[Channel, ...]] = ("tilt",)
    confounded_with: ClassVar[tuple[str, ...]] = ()
    source: ClassVar[str] = ""
    stage: ClassVar[Stage]
    rank: ClassVar[int] = 0
    jump: ClassVar[str] = ""
    once: ClassVar[str] = ""
    parts: ClassVar[tuple[Effect, ...]] = ()

    @property
    def code(self) -> str:
        """What tells a user's effect from another of its name; empty for those of the library."""
        return own_code(type(self))

    def change(self, trial: Trial, values: Mapping[str, float]) -> Trial:
        """The trial with the effect. Called only where `values` are not null.

        A function of its arguments alone, which may change scene, motion, drive, start, outcome and
        settling, and looks at nothing else. In the stages before "actuation" it neither looks at
        nor changes motion and drive, so that trials share what it makes. By default that of the
        `parts`, one after the other.
        """
        for part, own in self.acting_parts(values):
            trial = part.change(trial, own)
        return trial

    def change_each(self, trial: Trial, values: Sequence[Mapping[str, float]]) -> list[Trial]:
        """As `change`, of one trial with each of several values.

        For an effect that draws values for each trial and can do them together at less cost. It may
        change anything but motion and drive, and looks at neither of them.
        """
        return [self.change(trial, own) for own in values]

    def acting_parts(
        self, values: Mapping[str, float]
    ) -> Iterator[tuple[Effect, dict[str, float]]]:
        """The `parts` that are not null, each with its own values."""
        if not self.parts:
            return
        null = {p.name: p.is_null(values[p.name]) for p in self.parameters}
        for part in self.parts:
            names = {p.name: f"{part.name}_{p.name}" for p in part.parameters}
            if not all(null[names[p.name]] for p in part.parameters if not p.secondary):
                yield part, {name: values[long] for name, long in names.items()}

    def acting_once(self, values: Mapping[str, float]) -> list[Effect]:
        """What acts and cannot act twice: the effect itself, or parts of it."""
        own = [self] if self.once and not self.is_null(values) else []
        return own + [part for part, _ in self.acting_parts(values) if part.once]

    def at(self, values: Mapping[str, float], circumstances: Circumstances) -> Mapping[str, float]:
        """The values in force in one trial: where order, session or chance come in."""
        return values

    def observe(self, observation: Observation, values: Mapping[str, float]) -> Observation:
        """What is written down instead, with the values of `at`; for the stage "outcome".

        Called only where `values` are not null.
        """
        return observation

    def verify(self, bench: Bench) -> Sequence[Check]:
        """Closed forms, conservation laws or independent computations that it must meet.

        For effects of one's own. Those of the library stand in `studies/effect_closed_forms`,
        outside the package: only VSR2's own tests run them.
        """
        return ()

    def parameter(self, name: str) -> Parameter:
        """One of its parameters.

        Raises:
            ConfigError: there is none of this name; names the nearest.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        known = [parameter.name for parameter in self.parameters]
        raise ConfigError(
            f"has no parameter {name!r}; {offer(name, known)}", key=f"effects.{self.name}"
        )

    def with_prior(self, name: str, lower: float, upper: float, shape: Prior | None = None) -> Self:
        """The same effect with other ends, and maybe another shape, of a parameter's prior.

        A fixed parameter gets a uniform prior, where no shape is given.

        Raises:
            ConfigError: there is no such parameter, it cannot be simulated that far, or the prior
                has no width.
        """
        old = self.parameter(name)
        low, high = old.limits or (old.lower, old.upper)
        if lower > upper:
            raise ConfigError(
                f"a prior from {lower:g} to {upper:g}; give the lower end first",
                key=f"effects.{self.name}.{name}",
            )
        if not low <= lower <= upper <= high:
            raise ConfigError(
                f"a prior from {lower:g} to {upper:g}; it can be simulated from {low:g} to "
                f"{high:g}",
                key=f"effects.{self.name}.{name}",
            )
        if lower == upper:
            raise ConfigError(
                f"a prior from {lower:g} to {upper:g} has no width; widen it, or leave it out",
                key=f"effects.{self.name}.{name}",
            )
        try:
            wide = replace(
                old, lower=lower, upper=upper, limits=(low, high),
                prior=shape or ("uniform" if old.prior == "fixed" else old.prior),
            )  # fmt: skip
        except ConfigError as error:
            raise ConfigError(error.message, key=f"effects.{self.name}.{name}") from None
        made = copy(self)
        vars(made)["parameters"] = tuple(wide if p.name == name else p for p in self.parameters)
        return made

    def null(self) -> dict[str, float]:
        """Null values of all parameters."""
        return {parameter.name: parameter.null for parameter in self.parameters}

    def nominal(self, trial: Trial) -> dict[str, float]:
        """Values that leave a trial as it is: the null values; the trial's own where one is NaN."""
        return self.null()

    def opened(self, trials: Iterable[Trial]) -> Self:
        """The same effect with priors for what is fixed but in trials of a certain kind.

        Args:
            trials: all of a campaign, without the effect. They are made as they are asked for.
        """
        return self

    def with_null(self, values: Mapping[str, float]) -> Self:
        """The same effect with other null values."""
        made = copy(self)
        vars(made)["parameters"] = tuple(
            replace(p, null=values[p.name]) if p.name in values else p for p in self.parameters
        )
        return made

    def extreme(self) -> dict[str, float]:
        """Parameters at their prior's end farther from null; secondary ones at null."""
        return {
            parameter.name: parameter.null if parameter.secondary else parameter.extreme
            for parameter in self.parameters
        }

    def complete(self, values: Mapping[str, float]) -> dict[str, float]:
        """All parameters, null where `values` has none."""
        return self.null() | dict(values)

    def is_null(self, values: Mapping[str, float]) -> bool:
        """Whether values leave everything as it is."""
        return all(
            parameter.is_null(values[parameter.name])
            for parameter in self.parameters
            if not parameter.secondary and parameter.name in values
        )

    def twice(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        """Values that alone do what values do and others on top of them.

        The rules are those by which an effect acts on top of itself
        (docs/reference/effects.md#rules). Two low-passes are taken for one that passes as much as
        both at the frequency where they halve, two slopes for one in the direction of both.

        Args:
            first: of all parameters.
            second: of all parameters, acting on top.

        Raises:
            ConfigError: the effect cannot act twice, or no values do what both do.
        """
        if self.is_null(first):
            return dict(second)
        if self.is_null(second):
            return dict(first)
        if self.once:
            raise ConfigError(f"cannot act twice: {self.once}", key=f"effects.{self.name}")
        return self._joined(first, second)

    def _joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        """As :meth:`twice`, of values that both act."""
        return {
            p.name: p.joined(first[p.name], second[p.name], f"effects.{self.name}.{p.name}")
            for p in self.parameters
        }

    def _acting_alone(self) -> str:
        """Parameters of which a study needs one; of many those with a prior."""
        primary = [p for p in self.parameters if not p.secondary]
        drawn = [p for p in primary if p.prior != "fixed"]
        names = [f"`{p.name}`" for p in drawn or primary]
        others = ["another of its parameters"] if drawn and len(drawn) < len(primary) else []
        return " or ".join(names + others)

    def accept(self, given: Mapping[str, float | str]) -> dict[str, float]:
        """Values as a study writes them, checked and completed.

        Raises:
            ConfigError: an unknown parameter, a value that cannot be used, or none but parameters
                that do nothing on their own.
        """
        if all([self.parameter(name).secondary for name in given]):
            key = f"effects.{self.name}" + (f".{next(iter(given))}" if given else "")
            own = self._acting_alone()
            what = "does nothing on its own" if given else "without parameters does nothing"
            raise ConfigError(f"{what}; give {own} too, or leave the effect out", key=key)
        return {
            parameter.name: parameter.accept(
                given.get(parameter.name, parameter.null), f"effects.{self.name}.{parameter.name}"
            )
            for parameter in self.parameters
        }


def acts_already(one: Effect) -> str:
    """That an effect cannot act where it acts already, and what to do."""
    return f"{one.name} acts already, and cannot act twice: {one.once}; leave one of them out"


def effects_in(module: ModuleType) -> list[Effect]:
    """One instance of each effect that a module defines, in their order.

    A class without a `name` of its own serves others as base.
    """
    return [
        found()
        for found in vars(module).values()
        if isinstance(found, type)
        and issubclass(found, Effect)
        and found.__module__ == module.__name__
        and "name" in vars(found)
    ]
