"""Read-only arrays in values whose hash is kept."""

from __future__ import annotations

from typing import Any

import numpy as np


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The array where nobody can write to its memory, else a read-only copy."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            array = array.copy(order="K")
            array.setflags(write=False)
            return array
        owner = owner.base
    return array


class ReadOnlyArrays:
    """Base of frozen dataclasses: arrays given to the constructor are kept read-only.

    numpy forgets in pickles and copies that an array is read-only; here it stays so.
    """

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
