"""What the maker of a pack keeps between its runs: its state, and steps that are each done once."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from vsr2.blind.form.pack_form import Entry
from vsr2.blind.form.reader import Digits, Part, Sha256
from vsr2.blind.form.seal import canonical, read_json, write_json
from vsr2.config.problems import shown
from vsr2.errors import BlindError
from vsr2.results.store import is_number


def read_back(content: Any) -> Any:
    """As it is after JSON."""
    return json.loads(json.dumps(content))


Wanted = tuple[str, Callable[[Any], bool]]
"""What a step gives, in words and as a check of what a file has of it."""


def is_entry(value: object) -> bool:
    """Whether it is a campaign of a key, all numbers of it finite."""
    try:
        Entry.model_validate(value)
        canonical(value)
    except (ValidationError, BlindError):
        return False
    return True


NUMBER: Wanted = ("a finite number", partial(is_number, whole=True))
LIMIT: Wanted = (
    "a finite number or null",
    lambda value: value is None or is_number(value, whole=True),
)
ENTRY: Wanted = ("a campaign as a key has it", is_entry)


def numbers(count: int) -> Wanted:
    """So many positive numbers."""
    return (
        f"a list of {count} positive numbers",
        lambda value: (
            isinstance(value, list)
            and len(value) == count
            and all(is_number(one, whole=True) and one > 0 for one in value)
        ),
    )


class PackState(Part):
    """What of `custodian.json` all draws and the seal come from."""

    seed: Digits
    salt: Sha256


class Steps:
    """Results of steps in a file of its owner alone: what was killed does none of them twice.

    Raises:
        BlindError: the file is there and cannot be read.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._known = read_json(file) if file.exists() else {}

    def once(
        self, label: str, step: Callable[[], Any], wanted: Wanted, *, again: bool = False
    ) -> Any:
        """The result of a step as plain data; done where it is not known, or has to be `again`.

        Raises:
            BlindError: the file has something else than is `wanted`.
        """
        if again or label not in self._known:
            self._known[label] = read_back(step())
            write_json(self._file, self._known, private=True)
        value = self._known[label]
        words, holds = wanted
        if not holds(value):
            raise BlindError(
                f"{self._file}: {label} is {shown(value)}; it should be {words}; remove this key, "
                "and the step is done again"
            )
        return value
