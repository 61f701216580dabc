"""Draws of the nuisances, put into the trials of a campaign."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect, each_with_effects
from vsr2.effects.apply import ByTrial, MadeEarlier, Seed, Values
from vsr2.effects.registry import place
from vsr2.ensemble.simulated.distributions import DrawnByEffect
from vsr2.ensemble.simulated.nuisances import Nuisance, Scope
from vsr2.ensemble.simulated.simulator import nuisance_normal
from vsr2.trial import Trial

Array = NDArray[np.float64]
Caused = tuple[Effect, Values]
"""What is hypothesised, with complete values."""


class SeededEffect(NamedTuple):
    """An effect that acts in a simulated campaign.

    Attributes:
        effect: whichever.
        values: complete.
        seed: of what it draws.
    """

    effect: Effect
    values: Values
    seed: Seed


class ActingEffects:
    """What acts in a simulated campaign, as the nuisances of motions and trials come to it.

    A relative nuisance multiplies the values of the same effect where it is a cause, or else those
    of the nuisance of the same parameter that came before it, or else the nominal value.

    Args:
        first: trial that has the nominal values.
        caused: hypothesised effects.

    Attributes:
        nuisances: effects that act by nuisances, in the order in which they came.
        caused: hypothesised effects, multiplied.
    """

    def __init__(self, first: Trial, caused: Sequence[SeededEffect]) -> None:
        self.nuisances: list[SeededEffect] = []
        self.caused = list(caused)
        self._first = first
        self._holding: dict[tuple[str, str], list[int]] = {}

    def add(self, effect: SeededEffect, parameters: Collection[str]) -> None:
        """An effect by nuisances of these parameters of it."""
        for name in parameters:
            self._holding.setdefault((effect.effect.name, name), []).append(len(self.nuisances))
        self.nuisances.append(effect)

    def add_scope(
        self,
        own: Sequence[Nuisance],
        drawn: Sequence[dict[int, dict[str, float]]],
        seeds: Sequence[dict[int, int]],
    ) -> None:
        """Nuisances of one scope; secondary ones join the others of their effect.

        Args:
            own: all of the scope.
            drawn: of each, values by the trial's index.
            seeds: of each, of what its effect draws, by the trial's index.
        """
        joining: dict[str, list[tuple[str, dict[int, dict[str, float]]]]] = {}
        primary: list[int] = []
        for k, one in enumerate(own):
            if one.relative:
                if self._multiplies(one, drawn[k]):
                    continue
                nominal = one.acting.nominal(self._first)[one.parameter]
                for value in drawn[k].values():
                    value[one.parameter] *= nominal
            if one.acting.parameter(one.parameter).secondary:
                joining.setdefault(one.acting.name, []).append((one.parameter, drawn[k]))
            else:
                primary.append(k)
        for k in primary:
            effect, values = own[k].acting, ByTrial()
            joined = joining.get(effect.name, [])
            for i, value in drawn[k].items():
                complete = dict(value)
                for _, more in joined:
                    complete.update(more[i])
                values[i] = effect.complete(complete)
            names = [own[k].parameter, own[k].direction, *(name for name, _ in joined)]
            self.add(SeededEffect(effect, values, seeds[k]), names)

    def _multiplies(self, one: Nuisance, drawn: Mapping[int, Mapping[str, float]]) -> bool:
        """Whether a relative nuisance multiplies more than the nominal value; it does so then."""
        name, parameter = one.acting.name, one.parameter
        causes = [k for k, own in enumerate(self.caused) if own.effect.name == name]
        acting = self.caused if causes else self.nuisances
        multiplied = causes or self._holding.get((name, parameter), [])
        factors = {i: values[parameter] for i, values in drawn.items()}
        for k in multiplied:
            acting[k] = _multiplied(acting[k], parameter, factors)
        return bool(multiplied)


def _multiplied(one: SeededEffect, parameter: str, factors: Mapping[int, float]) -> SeededEffect:
    """The effect with a parameter multiplied in each trial; where it acts stays."""
    own = one.values
    given = own if isinstance(own, ByTrial) else dict.fromkeys(factors, own)
    made = type(own) if isinstance(own, ByTrial) else ByTrial
    values = {i: {**v, parameter: v[parameter] * factors[i]} for i, v in given.items()}
    return one._replace(values=made(values))


def correlated(nuisances: Sequence[Nuisance], draws: Array) -> Array:
    """Standard normal draws of nuisances, those of a group correlated.

    Args:
        nuisances: of one scope.
        draws: independent, shape (..., nuisances).
    """
    out = draws.copy()
    first: dict[str, int] = {}
    for i, one in enumerate(nuisances):
        if one.group and first.setdefault(one.group, i) != i:
            own = math.sqrt(1 - one.correlation**2)
            out[..., i] = one.correlation * draws[..., first[one.group]] + own * draws[..., i]
    return out


class NuisanceDraws:
    """Draws what is uncertain of a set-up, by numbers alone: any draw can be made on its own.

    Args:
        nuisances: that are drawn.
        order: of the trials, 0 first and 1 last.
        sessions: of the trials.
        motions: ground motion of each trial.
        seed: of all draws.

    Attributes:
        names: of those drawn once a campaign.
    """

    def __init__(
        self,
        nuisances: Sequence[Nuisance],
        order: Sequence[float],
        sessions: Sequence[str],
        motions: Sequence[str],
        seed: int,
    ) -> None:
        self._order, self._sessions, self._seed = order, sessions, seed
        known = list(dict.fromkeys(motions))
        self._motion = [known.index(motion) for motion in motions]
        self._wide = [one for one in nuisances if one.scope is Scope.CAMPAIGN]
        self._own = {
            scope: [
                one
                for one in nuisances
                if one.scope is scope and not isinstance(one.prior, DrawnByEffect)
            ]
            for scope in (Scope.MOTION, Scope.TRIAL)
        }
        self._by_effect = [
            one
            for one in nuisances
            if one.scope is Scope.TRIAL and isinstance(one.prior, DrawnByEffect)
        ]
        self.names = tuple(one.name for one in self._wide)

    def draw(self, index: int) -> Array:
        """Standardised nuisances of a draw, shape (nuisances,); zeros for index 0."""
        return nuisance_normal(self._seed, len(self._wide), index)

    def applied(
        self,
        trials: Sequence[Trial],
        first: Trial,
        nuisance: int,
        replicate: int,
        wanted: Collection[int],
        own: Sequence[SeededEffect] = (),
        caused: Sequence[Caused] = (),
        made: MadeEarlier | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """The wanted trials with effects in them, all in one order of application.

        Of one effect the scene's own comes first, then nuisances, those of a motion and a trial
        last, then what is hypothesised. The trials come one after another, with their indices, and
        are not kept. What an effect draws belongs to the trial's position in the campaign; trials
        that are not wanted keep theirs without work.

        Args:
            trials: of the campaign, without effects.
            first: nominal, of which relative nuisances take the value that they multiply.
            nuisance: index of the draw; 0: none.
            replicate: of what belongs to single trials; 0 and below: nothing is drawn.
            wanted: indices of trials.
            own: the scene's.
            caused: hypothesised effects with complete values, those of all trials or of each.
            made: as of :func:`each_with_effects`.
        """
        parts = [self._seed, nuisance, abs(replicate), replicate < 0]
        seed = int(np.random.SeedSequence(parts).generate_state(1, np.uint64)[0])
        wide, caused = self._acting(first, nuisance, replicate, caused)
        acting = ActingEffects(first, [SeededEffect(*one, seed) for one in caused])
        for effect, values in wide:
            acting.add(SeededEffect(effect, effect.complete(values), seed), values)
        self._add_motions_and_trials(acting, nuisance, replicate, wanted)
        given = [*own, *acting.nuisances, *acting.caused]
        given.sort(key=lambda one: place(one.effect))
        return each_with_effects(
            trials, [(one.effect, one.values) for one in given],
            relative_order=self._order, sessions=self._sessions,
            seed=[one.seed for one in given], only=wanted, made=made,
        )  # fmt: skip

    def _acting(
        self,
        first: Trial,
        nuisance: int,
        replicate: int,
        caused: Sequence[Caused],
    ) -> tuple[list[tuple[Effect, dict[str, float]]], list[Caused]]:
        """Nuisances of the campaign, and the given effects, which relative ones multiply."""
        drawn: list[tuple[Nuisance, float]] = []
        if nuisance:
            draws = correlated(self._wide, self.draw(nuisance))
            drawn += zip(self._wide, draws.tolist(), strict=True)
        if replicate > 0:
            drawn += [(one, 0.0) for one in self._by_effect]
        causes: dict[str, list[dict[str, float]]] = {}
        given: list[Caused] = []
        for effect, values in caused:
            own = values if isinstance(values, ByTrial) else {0: values}
            copied = {i: dict(one) for i, one in own.items()}
            causes[effect.name] = list(copied.values())
            given.append((effect, type(values)(copied) if own is values else copied[0]))
        acting: dict[str, tuple[Effect, dict[str, float]]] = {}
        for one, z in drawn:
            effect, values = one.acting, one.values(z)
            if one.relative and effect.name in causes:
                for cause in causes[effect.name]:
                    cause[one.parameter] *= values[one.parameter]
                continue
            if one.relative:
                values[one.parameter] *= effect.nominal(first)[one.parameter]
            acting.setdefault(effect.name, (effect, {}))[1].update(values)
        return [*acting.values()], given

    def _add_motions_and_trials(
        self, acting: ActingEffects, nuisance: int, replicate: int, wanted: Collection[int]
    ) -> None:
        """Nuisances that each motion, then those that each trial has values of its own of."""
        if nuisance:
            numbers = {i: (3, self._motion[i], nuisance, 0) for i in wanted}
            self._add_scope(acting, Scope.MOTION, numbers)
        if replicate > 0:
            numbers = {i: (1, i, nuisance, replicate) for i in wanted}
            self._add_scope(acting, Scope.TRIAL, numbers)

    def _add_scope(
        self,
        acting: ActingEffects,
        scope: Scope,
        numbers: Mapping[int, tuple[int, int, int, int]],
    ) -> None:
        """Nuisances of a scope, each trial's drawn by its numbers.

        Args:
            acting: gets them.
            scope: of motions or of trials.
            numbers: by trial.
        """
        own = self._own[scope]
        drawn, seeds = [dict[int, dict[str, float]]() for _ in own], [dict[int, int]() for _ in own]
        for i, counter in numbers.items() if own else ():
            rng = np.random.Generator(np.random.Philox(key=self._seed, counter=counter))
            draws = correlated(own, rng.standard_normal(len(own)))
            for k, (one, z) in enumerate(zip(own, draws.tolist(), strict=True)):
                drawn[k][i] = one.values(z)
                seeds[k][i] = int(rng.integers(2**63))
        acting.add_scope(own, drawn, seeds)
