"""Effects that act from a session on: their margins are those of scenes that have them throughout.

No scene is simulated for them. A trial before the step has the margin of the scene without it, a
trial after it the margin of the scene with it. What acts twice is joined nearly as effects are
(:meth:`vsr2.effects.Effect.twice`): turns add, slopes add as vectors, and other sizes add as shares
of their range. But a lean keeps its direction in plan where a step turns the specimen.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vsr2.causes.margins.cause_space import Acts, CauseSpace
from vsr2.causes.margins.margin_emulator import MarginEmulator
from vsr2.causes.margins.trial_groups import Rows
from vsr2.effects import Circumstances, Effect, Parameter
from vsr2.effects.order import StepEffect
from vsr2.ensemble.simulated.library import GAIN, is_angle, primary_parameters, turn_of, value_at

Array = NDArray[np.float64]
_AT = "at"
"""Where among the sessions a step lies."""


@dataclass(frozen=True)
class StepTableConstants:
    """How finely the effects of steps are tabled; chosen by hand.

    Attributes:
        beside: share of a range that stands for its null where that is infinite.
        grid_points: among the sessions, from the first to the last, at which what acts in each
            trial is tabled: fewer trials lie between two of them.
        shares: of a range, from -1 to 1, at which a parameter's values are tabled.
    """

    beside: float = 1e-6
    grid_points: int = 401
    shares: int = 201


STEP_TABLE = StepTableConstants()


@dataclass(frozen=True, eq=False)
class SeenScenes:
    """What an emulator says of scenes, whatever acts in them.

    Attributes:
        emulator: of margins.
        nuisances: as features, shape (n, q).
        error: of the emulator, that all trials share, shape (n,).
    """

    emulator: MarginEmulator
    nuisances: Array
    error: Array

    def __call__(self, features: Array, rows: Rows | None = None) -> tuple[Array, Array, Array]:
        """Means and variances of margins of some of them, as :class:`MarginEmulator` gives them."""
        own = slice(None) if rows is None else rows
        return self.emulator(np.hstack([features, self.nuisances[own]]), self.error[own])


@dataclass(frozen=True)
class _Joined:
    """A primary parameter of a step, and the parameter of the effect that it steps.

    Attributes:
        own, stepped: the parameters.
        label: of the latter among features.
        column: of the former among the coordinates of steps.
        azimuth: label of the direction that belongs to it; empty: it has none.
        azimuth_column: of that direction in the step, among the coordinates of steps; None: it is
            fixed to that of x.
    """

    own: Parameter
    stepped: Parameter
    label: str
    column: int
    azimuth: str
    azimuth_column: int | None


@dataclass(frozen=True, eq=False)
class SessionSteps:
    """What comes in at a session.

    Attributes:
        space: of the effects whose margins are simulated.
        names: of the steps.
        order: of the trials, 0 first and 1 last, shape (trials,).
        sessions: of the trials.
    """

    space: CauseSpace
    names: tuple[str, ...]
    order: Array
    sessions: Sequence[str]

    @cached_property
    def own(self) -> CauseSpace:
        """Coordinates of the steps."""
        return CauseSpace(self.space.library, self.names)

    @cached_property
    def together(self) -> CauseSpace:
        """Coordinates of all that may act, those of the steps last."""
        return CauseSpace(self.space.library, self.space.names + self.names)

    def margins(self, seen: SeenScenes, points: Array, acts: Acts) -> tuple[Array, Array, Array]:
        """Mean margins and variances, shapes (n, trials), (n,), (n,).

        A variance is the greatest of the scenes that a point consists of.

        Args:
            seen: margins of scenes.
            points: coordinates of all that may act, shape (n, coordinates).
            acts: which of it act, shape (n, names).
        """
        effects, first = len(self.space.names), len(self.space.coordinates)
        features = self.space.features(points[:, :first], acts[:, :effects])
        points, acts = points[:, first:], acts[:, effects:]
        mean, by_motion, by_trial = seen(features)
        late = {
            name: self.after(name, points) & acts[:, k, None] for k, name in enumerate(self.names)
        }
        sizes = range(1, len(self.names) + 1)
        for chosen in (some for size in sizes for some in combinations(self.names, size)):
            here = np.logical_and.reduce([late[name] for name in chosen])
            for name in set(self.names) - set(chosen):
                here &= ~late[name]
            rows = np.flatnonzero(here.any(axis=1))
            if not rows.size:
                continue
            joined, gain = features[rows].copy(), np.zeros((rows.size, 1))
            for name in chosen:
                self._join(name, joined, points[rows])
                gain[:, 0] += self._log_gain(name, points[rows])
            later, its_motion, its_trial = seen(joined, rows)
            mean[rows] = np.where(here[rows], later - gain, mean[rows])
            by_motion[rows] = np.maximum(by_motion[rows], its_motion)
            by_trial[rows] = np.maximum(by_trial[rows], its_trial)
        return mean, by_motion, by_trial

    def after(self, name: str, points: Array) -> Acts:
        """Which trials come after a step, shape (n, trials).

        Args:
            name: of the step.
            points: coordinates of the steps, shape (n, coordinates).
        """
        at = points[:, self._columns[name, _AT]]
        return self._afters[name][np.rint(at * (STEP_TABLE.grid_points - 1)).astype(np.int64)]

    def _join(self, name: str, features: Array, points: Array) -> None:
        """Make features of scenes those in which a step acts as well."""
        labels, shares = self.space.feature_names, self.own.shares(points)
        for one in self._joins[name]:
            share = shares[:, one.column]
            if is_angle(one.stepped):
                turn = 2 * np.pi * _tabled(one.own, share) / turn_of(one.stepped)
                c, s = (labels.index(f"{one.label}.{part}") for part in ("cos", "sin"))
                both = (features[:, c] + 1 + 1j * features[:, s]) * np.exp(1j * turn)
                features[:, c], features[:, s] = both.real - 1, both.imag
                continue
            size, at = share * _scale(one, share), labels.index(one.label)
            if not one.azimuth:
                features[:, at] += size
                continue
            turn = np.zeros(len(points))
            if one.azimuth_column is not None:
                turn = 2 * np.pi * shares[:, one.azimuth_column]
            x, y = (labels.index(f"{one.azimuth}.{part}") for part in ("cos", "sin"))
            features[:, x] += size * np.cos(turn)
            features[:, y] += size * np.sin(turn)
            features[:, at] = np.hypot(features[:, x], features[:, y])

    def _log_gain(self, name: str, points: Array) -> Array:
        """Logarithm of the factor by which a step makes the motion stronger, shape (n,)."""
        label = f"{GAIN}_change"
        if (name, label) not in self._columns:
            return np.zeros(len(points))
        share = self.own.shares(points)[:, self._columns[name, label]]
        return np.log1p(_tabled(self.space.library[name].parameter(label), share))

    @cached_property
    def _afters(self) -> dict[str, Acts]:
        """Which trials come after each step, shape (grid points, trials)."""
        in_time = np.argsort(self.order, kind="stable")
        known = tuple(dict.fromkeys(self.sessions[i] for i in in_time))
        rng = np.random.default_rng(0)  # No step draws.
        trials = [
            Circumstances(order, session, known, rng)
            for order, session in zip(self.order.tolist(), self.sessions, strict=True)
        ]
        found = {}
        for name in self.names:
            step = self.space.library[name]
            positions = np.linspace(0.0, 1.0, STEP_TABLE.grid_points).tolist()
            values = [
                step.extreme() | {_AT: value_at(step.parameter(_AT), position)}
                for position in positions
            ]
            found[name] = np.array(
                [[not step.is_null(step.at(own, one)) for one in trials] for own in values]
            )
        return found

    @cached_property
    def _columns(self) -> dict[tuple[str, str], int]:
        """Position of each coordinate of the steps, by step and parameter."""
        own = self.own
        return {
            (own.names[one.effect], one.parameter.name): k for k, one in enumerate(own.coordinates)
        }

    @cached_property
    def _joins(self) -> dict[str, list[_Joined]]:
        """Of each step, the primary parameters but the strength of the motion."""
        return {
            name: [
                self._joined(name, part, parameter)
                for part, parameter in _primary(self.space.library[name])
                if part != GAIN
            ]
            for name in self.names
        }

    def _joined(self, name: str, part: str, parameter: str) -> _Joined:
        stepped = self.space.library[part]
        one = stepped.parameter(parameter)
        following = stepped.parameters[stepped.parameters.index(one) + 1 :][:1]
        azimuth = next((p.name for p in following if p.secondary and is_angle(p)), "")
        label = f"{part}_{parameter}"
        return _Joined(
            own=self.space.library[name].parameter(label),
            stepped=one,
            label=f"{part}.{parameter}",
            column=self._columns[name, label],
            azimuth=azimuth and f"{part}.{azimuth}",
            azimuth_column=self._columns.get((name, f"{part}_{azimuth}")),
        )


def session_steps(
    space: CauseSpace, order: Array, sessions: Sequence[str], exclude: Collection[str] = ()
) -> SessionSteps:
    """The steps of a library whose parts all have margins.

    Args:
        space: of the effects whose margins are simulated.
        order: of the trials, 0 first and 1 last, shape (trials,).
        sessions: of the trials.
        exclude: names of effects that are not looked for.
    """
    known = {(space.names[one.effect], one.parameter.name) for one in space.coordinates}
    names = []
    for name, effect in space.library.items():
        if not isinstance(effect, StepEffect) or name in exclude:
            continue
        stepped = _primary(effect)
        if stepped and all(one in known or one[0] == GAIN for one in stepped):
            names.append(name)
    return SessionSteps(space, tuple(names), np.asarray(order), tuple(sessions))


def _primary(step: Effect) -> list[tuple[str, str]]:
    """Effect and parameter of each primary parameter of a step that its prior leaves open."""
    free = {p.name for p in primary_parameters(step)}
    return [
        (part.name, p.name)
        for part in step.parts
        for p in part.parameters
        if f"{part.name}_{p.name}" in free
    ]


def _tabled(parameter: Parameter, share: Array) -> Array:
    """Values at shares of the range from the null, shape as given."""
    grid = np.linspace(-1.0, 1.0, STEP_TABLE.shares)
    return np.interp(share, grid, [value_at(parameter, float(at)) for at in grid])


def _scale(one: _Joined, share: Array) -> Array:
    """Range of a step's parameter over that of the one it steps, on the side of a share."""

    def extent(parameter: Parameter, side: float) -> float:
        # Where the null is infinite, from the end of the prior next to it.
        null = (
            parameter.null
            if math.isfinite(parameter.null)
            else value_at(parameter, side * STEP_TABLE.beside)
        )
        ends = np.array([null, value_at(parameter, side)])
        return float(np.diff(np.log(ends) if parameter.prior == "loguniform" else ends)[0])

    below, above = (extent(one.own, side) / extent(one.stepped, side) for side in (-1.0, 1.0))
    return np.where(share < 0, below, above)
