"""Draws of the nuisances, put into the trials of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsr2.effects import Effect, each_with_effects
from vsr2.effects.apply import ByTrial, MadeEarlier, Seed, Values
from vsr2.effects.registry import place
from vsr2.ensemble.simulated.nuisances import DrawnByEffect, Nuisance, Scope, correlated
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
        given = [
            *own,
            *(SeededEffect(*one, seed) for one in wide),
            *self._of_motions_and_trials(nuisance, replicate, wanted),
            *(SeededEffect(*one, seed) for one in caused),
        ]
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
    ) -> tuple[list[Caused], list[Caused]]:
        """Nuisances of the campaign, and the given effects, which relative nuisances multiply."""
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
        return [(effect, effect.complete(values)) for effect, values in acting.values()], given

    def _of_motions_and_trials(
        self, nuisance: int, replicate: int, wanted: Collection[int]
    ) -> Iterator[SeededEffect]:
        """Nuisances that each motion, then those that each trial has values of its own of."""
        if nuisance:
            numbers = {i: (3, self._motion[i], nuisance, 0) for i in wanted}
            yield from self._by_trial(Scope.MOTION, numbers)
        if replicate > 0:
            yield from self._by_trial(Scope.TRIAL, {i: (1, i, nuisance, replicate) for i in wanted})

    def _by_trial(
        self, scope: Scope, numbers: Mapping[int, tuple[int, int, int, int]]
    ) -> Iterator[SeededEffect]:
        """Nuisances of a scope, each trial's drawn by its numbers; secondary ones join the others.

        Args:
            scope: of motions or of trials.
            numbers: by trial.
        """
        own = self._own[scope]
        values, seeds = [ByTrial() for _ in own], [dict[int, int]() for _ in own]
        for i, counter in numbers.items() if own else ():
            rng = np.random.Generator(np.random.Philox(key=self._seed, counter=counter))
            draws = correlated(own, rng.standard_normal(len(own)))
            drawn = [one.values(z) for one, z in zip(own, draws.tolist(), strict=True)]
            joining: dict[str, dict[str, float]] = {}
            for one, value in zip(own, drawn, strict=True):
                if one.secondary:
                    joining.setdefault(one.acting.name, {}).update(value)
            for k, one in enumerate(own):
                complete = drawn[k] | joining.get(one.acting.name, {})
                values[k][i] = one.acting.complete(complete)
                seeds[k][i] = int(rng.integers(2**63))
        for one, by_trial, seed in zip(own, values, seeds, strict=True):
            if not one.secondary:
                yield SeededEffect(one.acting, by_trial, seed)
