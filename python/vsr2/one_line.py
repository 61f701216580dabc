"""Values that show themselves as one line, in a terminal and in a notebook."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping


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


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return repr(str(value))
    return str(value)
