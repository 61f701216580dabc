"""Effects that are the same in all trials of a campaign."""

from __future__ import annotations

from vsr2.effects import (
    actuation,
    beside,
    contact,
    geometry,
    inertia,
    mechanism,
    registration,
    support,
)
from vsr2.effects.effect import Effect, effects_in

STATIC: tuple[Effect, ...] = tuple(
    effect
    for module in (
        geometry, registration, support, inertia, contact, mechanism, actuation, beside,
    )
    for effect in effects_in(module)
)  # fmt: skip
"""Of these modules: a class with a `name` is one."""
