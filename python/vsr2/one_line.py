"""Text of one line: values that show themselves so, in a terminal and in a notebook; counts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, fields


class OneLine:
    """Base of values whose `repr` names in one line what they hold, as that of a dataclass does.

    A dataclass needs `repr=False` beside it, which else writes one of its own.
    """

    @property
    @abstractmethod
    def facts(self) -> Mapping[str, object]:
        """What is shown, by name: numbers and names, no sentence; None is left out."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._line()}>"

    def _repr_html_(self) -> str:
        """For notebooks."""
        from markupsafe import Markup

        return str(Markup("<b>{}</b>: {}").format(type(self).__name__, self._line()))

    def _line(self) -> str:
        return ", ".join(
            f"{name}={_shown(value)}" for name, value in self.facts.items() if value is not None
        )


class OnlyGiven:
    """Base of settings, dataclasses with `repr=False`, whose `repr` leaves out the defaults."""

    def __repr__(self) -> str:
        given = []
        for field in fields(self):  # type: ignore[arg-type]
            made = field.default_factory
            usual = field.default if made is MISSING else made()
            value = getattr(self, field.name)
            if value is not usual and value != usual:
                given.append(f"{field.name}={value!r}")
        return f"{type(self).__name__}({', '.join(given)})"


def counted(number: int, what: str) -> str:
    """A number with its noun: 1 trial, 2 trials."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return repr(str(value))
    return str(value)
