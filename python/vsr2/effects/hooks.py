"""What effects change, one place in the order of application after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

from vsr2.effects.effect import Effect
from vsr2.effects.registry import place
from vsr2.errors import SimulationError, Vsr2Error
from vsr2.trial import Applied, Trial

T = TypeVar("T")


class InForce(NamedTuple):
    """An effect where it acts.

    Attributes:
        effect: whichever.
        where: with its values in force, by the trial's index.
        sought: whether its values differ from one call to the next.
    """

    effect: Effect
    where: Mapping[int, Applied]
    sought: bool


@dataclass(frozen=True)
class Hook:
    """What changes trials at one place in the order.

    Attributes:
        effect: whose `change` it is.
        values: by the trial's index; equal ones are one object.
        sought: whether its values differ from one call to the next.
        composite: the effect of which it is a part; None: of none.
    """

    effect: Effect
    values: Mapping[int, dict[str, float]]
    sought: bool
    composite: Effect | None = None

    @cached_property
    def holders(self) -> Counter[int]:
        """Number of trials that hold the same values, by their identity."""
        return Counter(map(id, self.values.values()))

    @property
    def each(self) -> bool:
        """Whether the effect changes a trial with several values in one go."""
        return type(self.effect).change_each is not Effect.change_each

    @property
    def key(self) -> str:
        """Of the study, by which errors name the effect."""
        return f"effects.{(self.composite or self.effect).name}"

    def key_of(self, own: str) -> str:
        """Of the study, for the key that an error of the effect names."""
        before = f"effects.{self.effect.name}."
        if self.composite is None or not own.startswith(before):
            return own
        return f"{self.key}.{self.effect.name}_{own.removeprefix(before)}"


def hooks_of(effects: Sequence[InForce]) -> list[Hook]:
    """Of all effects, and of the parts of those with some, in the order of application.

    A part comes after the effect of its name: a step acts on top of what acts in all trials.
    """
    found = []
    for one, where, sought in effects:
        known = {id(applied): dict(applied.values) for applied in where.values()}
        if one.parts:
            acting = {key: dict(one.acting_parts(values)) for key, values in known.items()}
            for part in one.parts:
                own = {i: acting[id(a)][part] for i, a in where.items() if part in acting[id(a)]}
                found.append(Hook(part, own, sought, one))
        elif one.stage != "outcome":
            own = {i: known[id(applied)] for i, applied in where.items()}
            found.append(Hook(one, own, sought))
    return sorted(found, key=lambda hook: (place(hook.effect), hook.composite is not None))


def changed_by(trial: Trial, hook: Hook, values: dict[str, float]) -> Trial:
    """A trial with the effect in it.

    Raises:
        Vsr2Error: of the effect; names the key of the study.
    """
    changed = with_key(hook, lambda: hook.effect.change(trial, values))
    if not isinstance(changed, Trial):
        raise SimulationError(
            f"effect {hook.effect.name!r}: `change` must return a Trial "
            f"(returned {type(changed).__name__})"
        )
    return changed


def with_key(hook: Hook, change: Callable[[], T]) -> T:
    """What an effect makes; its error names the key of the study."""
    try:
        return change()
    except Vsr2Error as error:
        key = hook.key_of(error.key) if error.key else hook.key
        if key == error.key:
            raise
        raise type(error)(error.message, key=key, fault=error.fault) from error
