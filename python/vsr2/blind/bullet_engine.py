"""The engine `bullet`: a scene on our own core, with the library's effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

from vsr2.blind.shake import Drawable, Observed, Shake
from vsr2.config import Study
from vsr2.errors import BlindError


class BulletEngine:
    """Trials of a study on the native core; effects are those of `vsr2.effects`.

    Raises:
        BlindError: this version has no library of effects.
    """

    def __init__(self, study: Study) -> None:
        raise BlindError("engine bullet: needs the library of effects; choose engine mujoco")

    @property
    def name(self) -> Literal["bullet"]:
        """Of the engine."""
        return "bullet"

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        return {}

    @property
    def static_pga(self) -> float:
        """Acceleration of uplift, g b / h [m/s^2]."""
        return math.nan

    @property
    def effects(self) -> Mapping[str, Drawable]:
        """All that the library has."""
        return {}

    def run(self, shakes: Iterable[Shake], series_interval: float) -> Iterator[Observed]:
        """Simulate trials, in their order."""
        found: list[Any] = []
        return iter(found)
