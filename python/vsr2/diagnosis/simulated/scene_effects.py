"""The effects of a scene's own, with which its trials are the nominal ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from vsr2.config.study import Study
from vsr2.diagnosis.observed.random_streams import Stream
from vsr2.diagnosis.simulated.nuisances import Nuisance
from vsr2.effects import Circumstances, Effect, chosen, each_with_effects
from vsr2.effects.own_code import own_code
from vsr2.errors import DiagnosisError
from vsr2.trial import Trial

Given = tuple[Effect, Mapping[str, float]]


def draws_by_trial(
    effect: Effect, values: Mapping[str, float], order: Sequence[float], sessions: Sequence[str]
) -> bool:
    """Whether chance has a part in an effect's values in any trial.

    Args:
        effect: any.
        values: of all parameters.
        order: of the trials, 0 first and 1 last.
        sessions: of the trials.
    """
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    known = tuple(dict.fromkeys(sessions))
    for place, session in zip(order, sessions, strict=True):
        effect.at(values, Circumstances(place, session, known, rng))
    return bool(rng.bit_generator.state != before)


class SceneEffects:
    """Puts the effects of a study into the trials of a campaign.

    They act before all nuisances and hypothesised effects. Those that draw nothing are put into the
    trials once. From the first on that draws, in the order of application, they belong to a
    simulated campaign, as a laboratory's own draws are not known.

    Args:
        study: of the scene.
        order: of the trials, 0 first and 1 last.
        sessions: of the trials.

    Raises:
        ConfigError: an effect or a value that cannot be used.
    """

    def __init__(self, study: Study, order: Sequence[float], sessions: Sequence[str]) -> None:
        self._order, self._sessions = order, sessions
        given = [(one, values) for one, values in chosen(study.effects) if not one.is_null(values)]
        draws = [draws_by_trial(one, values, order, sessions) for one, values in given]
        first = draws.index(True) if any(draws) else len(given)
        self._fixed, self._drawn = given[:first], given[first:]

    @property
    def content(self) -> list[tuple[str, list[tuple[str, float]], str]]:
        """Name, values and a user's own code of each, in the order of application."""
        both = [*self._fixed, *self._drawn]
        return [(one.name, sorted(values.items()), own_code(type(one))) for one, values in both]

    def check(self, nuisances: Sequence[Nuisance]) -> None:
        """Refuse a nuisance that cannot act beside the scene's own effect.

        Raises:
            DiagnosisError: names it.
        """
        names = {
            own.name
            for effect, values in (*self._fixed, *self._drawn)
            for own in effect.acting_once(values)
        }
        for one in nuisances:
            if one.acting.name in names:
                raise DiagnosisError(
                    f"nuisance {one.name!r}: its effect is in the scene's `effects` and cannot act "
                    f"twice: {one.acting.once}; leave one of them out"
                )

    def fixed(self, trials: Sequence[Trial], wanted: Collection[int] | None = None) -> list[Trial]:
        """Trials of the campaign with the effects that draw nothing.

        Args:
            trials: of the whole campaign.
            wanted: indices; other trials come back as they are. None: all.
        """
        return self._with(trials, self._fixed, 0, wanted)

    def drawn(
        self, trials: list[Trial], seed: Sequence[int], wanted: Collection[int]
    ) -> list[Trial]:
        """The wanted ones of these trials with the rest of the effects.

        Args:
            trials: of :meth:`fixed`.
            seed: of the draws.
            wanted: indices; other trials come back as they are.
        """
        if not self._drawn:
            return trials
        state = np.random.SeedSequence([*seed, Stream.SCENE_EFFECTS]).generate_state(1, np.uint64)
        return self._with(trials, self._drawn, int(state[0]), wanted)

    def _with(
        self,
        trials: Sequence[Trial],
        effects: Sequence[Given],
        seed: int,
        wanted: Collection[int] | None,
    ) -> list[Trial]:
        made = list(trials)
        for i, trial in each_with_effects(
            trials, effects, relative_order=self._order, sessions=self._sessions, seed=seed,
            only=wanted,
        ):  # fmt: skip
            made[i] = trial
        return made
