"""Values that show themselves as one line, in a terminal and in a notebook."""

from __future__ import annotations

from abc import abstractmethod
from html import escape


class OneLine:
    """Base of values whose `repr` says in one line what they hold.

    A dataclass needs `repr=False` beside it, which else writes one of its own.
    """

    @property
    @abstractmethod
    def summary(self) -> str:
        """What it holds, without the name of its class."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {' '.join(self.summary.split())}>"

    def _repr_html_(self) -> str:
        """For notebooks."""
        name = type(self).__name__
        return f"<b>{escape(name)}</b>: {escape(' '.join(self.summary.split()))}"
