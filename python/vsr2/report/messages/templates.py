"""How values go into a template."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def counted(number: int, what: str) -> str:
    """A number with its noun: 1 trial, 2 trials."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def filled_in(template: str, values: Mapping[str, Any]) -> str:
    """A template of `str.format` with its values: lists parted by commas, numbers of six digits."""
    return template.format(
        **{
            name: ", ".join(one if isinstance(one, str) else f"{one:.6g}" for one in value)
            if isinstance(value, tuple | list)
            else value
            for name, value in values.items()
        }
    )
