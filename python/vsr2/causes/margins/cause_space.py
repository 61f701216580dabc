"""Causes as coordinates: which effects act, how strongly, and what an emulator tells them by."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.margin_streams import MarginStream
from vsr2.effects import Circumstances, Effect, Parameter
from vsr2.effects.order import StepEffect
from vsr2.ensemble.simulated.library import (
    GAIN,
    Library,
    free_parameters,
    is_angle,
    null_quantile,
    sides,
    two_sided,
    value_at,
)
from vsr2.ensemble.simulated.simulator import Effects

Array = NDArray[np.float64]
Acts = NDArray[np.bool_]


class NotJudged(StrEnum):
    """Why no margin of a scene shows an effect."""

    DIFFERS_BY_TRIAL = "differs_by_trial"
    """As scatter does."""
    PART_NOT_JUDGED = "part_not_judged"
    """It brings in an effect that is not looked for."""
    NOTED_ALONE = "noted_alone"
    """It changes what is noted, not what happens."""


def not_judged(effect: Effect) -> NotJudged | None:
    """Why margins do not show an effect; None: they do."""
    if effect.stage == "outcome":
        return NotJudged.NOTED_ALONE
    if _draws(effect):
        return NotJudged.DIFFERS_BY_TRIAL
    return None


def _draws(effect: Effect) -> bool:
    """Whether chance has a part in what an effect does in the first or the last trial."""
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    for order in (0.0, 1.0):
        effect.at(effect.extreme(), Circumstances(order, "1", ("1",), rng))
    return bool(rng.bit_generator.state != before)


@dataclass(frozen=True)
class CauseConstants:
    """How causes are drawn; chosen by hand.

    Attributes:
        acting: probability that an effect acts in a scene whose margins are sought: some six of
            25, so that each acts in a quarter of the scenes and meets each other one.
        alone: share of a parameter's range, next to its null, in which it stays there where another
            of the effect is farther from its own.
    """

    acting: float = 0.25
    alone: float = 0.35


CAUSES = CauseConstants()


@dataclass(frozen=True)
class _Coordinate:
    """A free parameter: in [low, 1], the null at 0; of a secondary one its quantile in [0, 1]."""

    parameter: Parameter
    effect: int
    low: float
    first: int
    """Column of the effect's first coordinate."""


def _turn_share(one: _Coordinate, value: Array) -> Array:
    """Share of the turn that lies between the null and the end of the range, shape as given.

    All of it, but where the null lies within.
    """
    if one.low == 0:
        return np.ones_like(value)
    # In single precision, as its null is found by bisection: in the middle it is exactly a half.
    below = float(np.float32(null_quantile(one.parameter) or 0.0))
    return np.where(value < 0, below, 1 - below)


@dataclass(frozen=True, eq=False)
class CauseSpace:
    """Effects of a library that margins can show.

    A scene is a point: one coordinate for each free parameter, and which effects act.

    Attributes:
        library: of effects.
        names: of those that may act, in the library's order, the strength of the motion left out.
    """

    library: Library
    names: tuple[str, ...]

    @property
    def all_names(self) -> tuple[str, ...]:
        """The effects, then the strength of the motion.

        That needs no simulation: a motion that is stronger by a factor takes its logarithm off the
        margin.
        """
        return (*self.names, GAIN)

    @cached_property
    def coordinates(self) -> tuple[_Coordinate, ...]:
        """Of all effects, one after another."""
        out: list[_Coordinate] = []
        for k, name in enumerate(self.names):
            effect, first = self.library[name], len(out)
            for p in free_parameters(effect):
                low = -1.0 if not p.secondary and two_sided(p) else 0.0
                out.append(_Coordinate(p, k, low, first))
        return tuple(out)

    @cached_property
    def lows(self) -> Array:
        """Lower ends of the coordinates, shape (coordinates,); the upper ends are 1."""
        return np.array([one.low for one in self.coordinates])

    @cached_property
    def effect_of(self) -> NDArray[np.int64]:
        """Position of the effect that each coordinate belongs to, shape (coordinates,)."""
        return np.array([one.effect for one in self.coordinates], dtype=np.int64)

    @cached_property
    def turns(self) -> Acts:
        """Which coordinates are full turns, that go on from one end to the other."""
        return np.array([is_angle(one.parameter) for one in self.coordinates], dtype=bool)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Coordinates from their prior, shape (count, coordinates)."""
        low = self.lows
        return np.asarray(low + (1 - low) * rng.random((count, low.size)))

    def shares(self, points: Array) -> Array:
        """Shares of the range from the null, of secondary ones the coordinate, shape as given.

        Where an effect has several primary parameters, one that is near its null stays there
        unless it is the farthest (:class:`CauseConstants`).
        """
        out = points.copy()
        effect, alone = self.effect_of, CAUSES.alone
        primary = np.array([not one.parameter.secondary for one in self.coordinates])
        for k in range(len(self.names)):
            own = np.flatnonzero((effect == k) & primary)
            if own.size < 2:
                continue
            size = np.abs(points[:, own])
            rest = np.maximum(size - alone, 0.0) / (1 - alone)
            farthest = size == size.max(axis=1, keepdims=True)
            out[:, own] = np.sign(points[:, own]) * np.where(farthest, size, rest)
        return out

    @cached_property
    def feature_names(self) -> tuple[str, ...]:
        """Names of the numbers by which an emulator tells scenes apart."""
        out: list[str] = []
        for one in self.coordinates:
            label = f"{self.names[one.effect]}.{one.parameter.name}"
            if is_angle(one.parameter):
                out += [f"{label}.cos", f"{label}.sin"]
            else:
                out.append(label)
        return tuple(out)

    def features(self, points: Array, acts: Acts) -> Array:
        """Numbers that are 0 where an effect does not act, shape (n, features).

        A primary parameter gives its share of the range from its null, an angle over a full turn
        cosine less 1 and sine of how far it is turned. A secondary angle gives the components of a
        vector that is as long as the share before it, another secondary parameter that share times
        how far it lies from the middle of its range.

        Args:
            points: coordinates, shape (n, coordinates).
            acts: which effects act, shape (n, effects).
        """
        shares = self.shares(points)
        columns: list[Array] = []
        leading = np.zeros(len(points))
        for k, one in enumerate(self.coordinates):
            on, value = acts[:, one.effect], shares[:, k]
            if k == one.first or not one.parameter.secondary:
                leading = np.where(on, value, 0.0)
            if is_angle(one.parameter):
                turn = 2 * np.pi * value * _turn_share(one, value)
                if one.parameter.secondary:
                    columns += [leading * np.cos(turn), leading * np.sin(turn)]
                else:
                    columns += [
                        np.where(on, np.cos(turn) - 1, 0.0),
                        np.where(on, np.sin(turn), 0.0),
                    ]
            elif one.parameter.secondary:
                columns.append(leading * (2 * value - 1))
            else:
                columns.append(leading)
        return np.stack(columns, axis=1) if columns else np.zeros((len(points), 0))

    def effects(self, point: Array, acts: Acts) -> Effects:
        """What acts at a point, as a simulator takes it.

        Args:
            point: coordinates, shape (coordinates,).
            acts: which effects act, shape (effects,).
        """
        return tuple(
            (name, self.values(name, point))
            for name, on in zip(self.names, acts, strict=True)
            if on
        )

    def values(self, name: str, point: Array) -> tuple[float, ...]:
        """Values of all parameters of an effect, fixed ones at their null."""
        shares = self.shares(point[None])[0]
        known = {
            one.parameter.name: value_at(one.parameter, float(share))
            for one, share in zip(self.coordinates, shares, strict=True)
            if self.names[one.effect] == name
        }
        return tuple(float(known.get(p.name, p.null)) for p in self.library[name].parameters)


def cause_space(library: Library, exclude: Collection[str] = ()) -> CauseSpace:
    """Of the effects of a library that act throughout a campaign and that margins can show.

    Those that come in at a session are made of these (`SessionSteps`).
    """
    names = tuple(
        name
        for name, effect in library.items()
        if not_judged(effect) is None
        and not isinstance(effect, StepEffect)
        and name not in exclude
        and name != GAIN
        and sides(effect)
    )
    return CauseSpace(library, names)


def draw_scene(space: CauseSpace, index: int, seed: int) -> tuple[Array, Acts]:
    """A scene whose margins are sought; any can be drawn alone, and in scene 0 nothing acts.

    Returns:
        Coordinates, shape (coordinates,), and which effects act, shape (effects,).
    """
    rng = np.random.default_rng([seed, MarginStream.SCENES, index])
    acts = rng.random(len(space.names)) < CAUSES.acting
    return space.draw(1, rng)[0], acts & (index > 0)
