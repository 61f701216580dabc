"""The effects of a scene's own, with which its trials are the nominal ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsr2.config.study import Study
from vsr2.effects import chosen
from vsr2.effects.own_code import own_code
from vsr2.ensemble.observed.random_streams import Stream
from vsr2.ensemble.simulated.nuisance_draws import SeededEffect
from vsr2.ensemble.simulated.nuisances import Nuisance
from vsr2.errors import DiagnosisError


class SceneEffects:
    """The effects of a study, which act in every simulated campaign.

    They act among the nuisances and hypothesised effects, in the order of application. What they
    draw belongs to a simulated campaign, as a laboratory's own draws are not known.

    Args:
        study: of the scene.

    Raises:
        ConfigError: an effect or a value that cannot be used.
    """

    def __init__(self, study: Study) -> None:
        self._given = [
            (one, values) for one, values in chosen(study.effects) if not one.is_null(values)
        ]

    @property
    def content(self) -> list[tuple[str, list[tuple[str, float]], str]]:
        """Name, values and a user's own code of each, in the order of application."""
        return [
            (one.name, sorted(values.items()), own_code(type(one))) for one, values in self._given
        ]

    def check(self, nuisances: Sequence[Nuisance]) -> None:
        """Refuse a nuisance that cannot act beside the scene's own effect.

        Raises:
            DiagnosisError: names it.
        """
        names = {own.name for effect, values in self._given for own in effect.acting_once(values)}
        for one in nuisances:
            if one.acting.name in names:
                raise DiagnosisError(
                    f"nuisance {one.name!r}: its effect is in the scene's `effects` and cannot act "
                    f"twice: {one.acting.once}; leave one of them out"
                )

    def drawn_by(self, seed: Sequence[int]) -> list[SeededEffect]:
        """Each with its values and the seed of what it draws.

        Args:
            seed: of the simulated campaign.
        """
        state = np.random.SeedSequence([*seed, Stream.SCENE_EFFECTS]).generate_state(1, np.uint64)
        return [SeededEffect(one, values, int(state[0])) for one, values in self._given]
