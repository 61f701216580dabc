"""Draws of the nuisances, put into the trials of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vsr2.diagnosis.simulated.nuisances import DrawnByEffect, Nuisance, Scope, correlated
from vsr2.diagnosis.simulated.simulator import nuisance_normal
from vsr2.effects import Effect, each_with_effects, in_order, with_effect
from vsr2.effects.apply import ByTrial, MadeEarlier, Values
from vsr2.trial import Trial

Array = NDArray[np.float64]
Given = tuple[Effect, Values]


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
        caused: Sequence[Given] = (),
        made: MadeEarlier | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """The wanted trials with what acts in all of them: nuisances, and given effects.

        They come one after another, with their indices, and are not kept. What an effect draws
        belongs to the trial's position in the campaign; trials that are not wanted keep theirs
        without work.

        Args:
            trials: of the campaign, by :meth:`with_own`.
            first: nominal, of which relative nuisances take the value that they multiply.
            nuisance: index of the draw; 0: none.
            replicate: of what belongs to single trials; 0 and below: nothing is drawn.
            wanted: indices of trials.
            caused: effects with complete values, those of all trials or those of each.
            made: as of :func:`each_with_effects`.
        """
        parts = [self._seed, nuisance, abs(replicate), replicate < 0]
        seed = int(np.random.SeedSequence(parts).generate_state(1, np.uint64)[0])
        given = self._acting(first, nuisance, replicate, caused)
        ranks = {e.name: i for i, e in enumerate(in_order({e.name: e for e, _ in given}))}
        given.sort(key=lambda pair: ranks[pair[0].name])
        return each_with_effects(
            trials, given, relative_order=self._order, sessions=self._sessions, seed=seed,
            only=wanted, made=made,
        )  # fmt: skip

    def _acting(
        self,
        first: Trial,
        nuisance: int,
        replicate: int,
        caused: Sequence[Given],
    ) -> list[Given]:
        """Nuisances, then the given effects, which relative nuisances multiply."""
        drawn: list[tuple[Nuisance, float]] = []
        if nuisance:
            draws = correlated(self._wide, self.draw(nuisance))
            drawn += zip(self._wide, draws.tolist(), strict=True)
        if replicate > 0:
            drawn += [(one, 0.0) for one in self._by_effect]
        causes: dict[str, list[dict[str, float]]] = {}
        given: list[Given] = []
        for effect, values in caused:
            own = values if isinstance(values, ByTrial) else {0: values}
            copied = {i: dict(one) for i, one in own.items()}
            causes[effect.name] = list(copied.values())
            given.append((effect, ByTrial(copied) if own is values else copied[0]))
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
        return [(effect, effect.complete(values)) for effect, values in acting.values()] + given

    def with_own(
        self, trials: Sequence[Trial], nuisance: int, replicate: int, wanted: Collection[int]
    ) -> list[Trial]:
        """The trials, the wanted ones with values that belong to their motion or to them alone.

        Args:
            trials: of the campaign.
            nuisance: index of the draw; 0: motions have none.
            replicate: of what belongs to single trials; 0 and below: nothing is drawn.
            wanted: indices of trials.
        """
        out = list(trials)
        for i in wanted if nuisance else ():
            self._draw_own(out, i, Scope.MOTION, [3, self._motion[i], nuisance, 0])
        for i in wanted if replicate > 0 else ():
            self._draw_own(out, i, Scope.TRIAL, [1, i, nuisance, replicate])
        return out

    def _draw_own(self, trials: list[Trial], i: int, scope: Scope, counter: list[int]) -> None:
        """Put nuisances of a scope, drawn from a counter, into a trial."""
        own = self._own[scope]
        if not own:
            return
        rng = np.random.Generator(np.random.Philox(key=self._seed, counter=counter))
        draws = correlated(own, rng.standard_normal(len(own)))
        for one, z in zip(own, draws.tolist(), strict=True):
            effect = one.acting
            trials[i] = with_effect(
                trials[i],
                effect,
                effect.complete(one.values(z)),
                relative_order=self._order[i],
                session=str(self._sessions[i]),
                seed=int(rng.integers(2**63)),
            )
