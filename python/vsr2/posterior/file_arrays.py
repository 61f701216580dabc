"""Arrays of a posterior's file, each checked before it is used: there, and of its shape."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FileArrays:
    """Reads arrays, whose shapes must agree with one another.

    Args:
        file: by name, as `numpy.load` gives it.
        sizes: lengths that are known, by their names.
        may_be_zero: names of lengths that may be 0; no other named one is.
    """

    def __init__(
        self,
        file: Mapping[str, Any],
        sizes: Mapping[str, int],
        may_be_zero: Collection[str] = (),
    ) -> None:
        self._file = file
        self._sizes = dict(sizes)
        self._may_be_zero = may_be_zero

    def __contains__(self, name: str) -> bool:
        return name in self._file

    def size(self, of: str) -> int:
        """A length that is known or was met in an array."""
        return self._sizes[of]

    def numbers(
        self,
        name: str,
        *shape: str | int,
        above: float | None = None,
        endless: Sequence[bool] | bool = False,
    ) -> Array:
        """An array of finite numbers.

        Args:
            name: of the array.
            shape: its lengths; a name stands for the same length in every array.
            above: below all of its numbers; None: there is no bound.
            endless: whether numbers may be infinite, for all or for each place of the last axis.

        Raises:
            ValueError: names array, value and what is wanted.
        """
        found = self._of_shape(name, shape, "f")
        wrong = np.isnan(found) | (np.isinf(found) & ~np.asarray(endless))
        if above is not None:
            wrong |= ~(found > above)
        self._refuse(name, found, wrong, "finite" if above is None else f"above {above:g}")
        return found

    def indices(self, name: str, *shape: str | int, least: int, below: int) -> NDArray[np.int64]:
        """An array of whole numbers within bounds.

        Args:
            name: of the array.
            shape: as of :meth:`numbers`.
            least: bound, included.
            below: bound, not included.

        Raises:
            ValueError: names array, value and what is wanted.
        """
        found = self._of_shape(name, shape, "i")
        wanted = f"from {least} to {below - 1}"
        self._refuse(name, found, (found < least) | (found >= below), wanted)
        return found

    def _of_shape(self, name: str, shape: tuple[str | int, ...], kind: str) -> NDArray[Any]:
        if name not in self._file:
            raise ValueError(f"array {name} is missing")
        found: NDArray[Any] = self._file[name]
        if found.dtype.kind != kind:
            wanted = {"f": "floating-point", "i": "whole"}[kind]
            raise ValueError(f"array {name} is of type {found.dtype}, wanted are {wanted} numbers")
        sizes = dict(self._sizes)
        if found.ndim == len(shape):
            for of, length in zip(shape, found.shape, strict=True):
                if isinstance(of, str):
                    sizes.setdefault(of, length)
                    if not length and of not in self._may_be_zero:
                        raise ValueError(f"array {name} is empty, of shape {found.shape}")
        wanted_shape = tuple(sizes.get(of, of) if isinstance(of, str) else of for of in shape)
        if found.shape != wanted_shape:
            said = ", ".join(map(str, wanted_shape))
            raise ValueError(f"array {name} has the shape {found.shape}, wanted is ({said})")
        self._sizes = sizes
        return found

    @staticmethod
    def _refuse(name: str, found: NDArray[Any], wrong: NDArray[np.bool_], wanted: str) -> None:
        if wrong.any():
            place = tuple(int(k) for k in np.argwhere(wrong)[0])
            raise ValueError(f"array {name} holds {found[place]} at {place}, wanted is {wanted}")
