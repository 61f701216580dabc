"""Arrays in values whose hash is kept, of real numbers and read-only; read-only mappings.

What is promised: no assignment, method or operator changes a value through the array that it
gives, nor one through a copy or a pickle of the value. What is not: numpy lets whoever asks for it
make the memory behind a view writable again (`array.base.setflags(write=True)`), as Python lets
`object.__setattr__` change a frozen dataclass. A value that was changed so no longer fits its hash.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np


def real_array(given: Any, *, truths: bool = False) -> np.ndarray[Any, np.dtype[np.float64]]:
    """`given` as an array of real numbers in double precision, itself where it is one.

    numpy turns text, truth values, complex numbers and dates into numbers too, and drops masks.

    Args:
        given: what should be numbers.
        truths: whether truth values count as 1 and 0, as of outcomes.

    Raises:
        TypeError: `given` holds any of these; its text goes on after the name of the array.
    """
    refuse_mask(given)
    try:
        value = np.asarray(given)
        if (
            not truths
            and isinstance(given, list | tuple)
            and any(
                isinstance(one, bool | np.bool_) for one in np.asarray(given, dtype=object).flat
            )
        ):
            raise TypeError("with truth values")
    except (TypeError, ValueError) as error:
        raise TypeError(f"is not an array of numbers ({error})") from None
    if value.dtype.kind not in ("biuf" if truths else "iuf"):
        raise TypeError(f"is not an array of numbers (but of {value.dtype})")
    return value.astype(np.float64, copy=False)


def real_argument(
    given: Any, name: str, error: type[Exception], *, truths: bool = False
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """As :func:`real_array`, of an argument.

    Raises:
        Exception: as `error`; names the argument.
    """
    try:
        return real_array(given, truths=truths)
    except TypeError as fault:
        raise error(f"{name} {fault}") from None


def refuse_mask(given: Any) -> None:
    """Refuse what numpy would drop a mask of: a masked array, or a list with one in it.

    Raises:
        TypeError: it is one; the text goes on after the name of what was given.
    """
    if isinstance(given, np.ma.MaskedArray):
        raise TypeError("is a masked array; fill what its mask hides")
    if isinstance(given, list | tuple):
        for one in given:
            if isinstance(one, np.ma.MaskedArray | list | tuple):
                refuse_mask(one)


def truth_argument(
    given: Any, name: str, error: type[Exception]
) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """An argument as truth values, shape (n,), itself where it is such an array.

    Numbers are refused because NaN, the usual mark of a missing outcome, would count as true.

    Raises:
        Exception: as `error`; names the argument.
    """
    array = _unmasked(given, name, error)
    if isinstance(given, list | tuple) and not array.size:
        array = array.astype(np.bool_)  # An empty list is one of floats.
    if array.dtype != np.bool_ or array.ndim != 1:
        raise error(
            f"{name}: must be boolean of shape (n,), is {array.dtype} of shape {array.shape}; "
            "compare first, as in outcome == 'overturned'"
        )
    return array


def label_argument(given: Any, name: str, error: type[Exception]) -> np.ndarray[Any, Any]:
    """An argument as labels, shape (n,): text or numbers, equal where trials belong together.

    Raises:
        Exception: as `error`; names the argument.
    """
    array = _unmasked(given, name, error)
    if array.dtype.kind == "O" and all(isinstance(one, str) for one in array.flat):
        array = array.astype(np.str_)
    if array.size and (array.dtype.kind not in "biufSUT" or _holds_nan(array)):
        raise error(f"{name}: must be text or numbers, none missing (is of {array.dtype})")
    if array.ndim != 1:
        raise error(f"{name}: must be of shape (n,), is of shape {array.shape}")
    return array


def _holds_nan(array: np.ndarray[Any, Any]) -> bool:
    return array.dtype.kind == "f" and bool(np.isnan(array).any())


def _unmasked(given: Any, name: str, error: type[Exception]) -> np.ndarray[Any, Any]:
    try:
        refuse_mask(given)
        return np.asarray(given)
    except (TypeError, ValueError) as fault:  # also of lists of unequal length
        raise error(f"{name}: {fault}") from None


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A view of the array where nobody can write to its memory, else of a read-only copy.

    The core borrows the first kind alone. An array that owns its memory can be set writable again,
    a view of it cannot.
    """
    if not _is_read_only(array):
        array = array.copy(order="K")
        array.setflags(write=False)
    return array.view() if array.flags.owndata else array


def _is_read_only(array: np.ndarray[Any, Any]) -> bool:
    """Whether the array views read-only arrays alone, the last its own memory or `bytes`.

    Another owner may offer read-only views of memory that it writes to.
    """
    owner: Any = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        if owner.base is None:
            return owner.flags.owndata
        owner = owner.base
        if isinstance(owner, memoryview):  # numpy puts one between itself and a buffer
            owner = owner.obj
    return type(owner) is bytes


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
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
                self.__dict__[name] = read_only(value)


class ReadOnlyDict(dict[str, Any]):
    """A mapping that cannot be changed, nor those in it; `dict(it)` is a copy that can."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        super().__init__(
            (key, ReadOnlyDict(value) if isinstance(value, dict) else value)
            for key, value in given.items()
        )

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("this mapping is read-only; change a copy of it, `dict(...)`")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type[ReadOnlyDict], tuple[dict[str, Any]]]:
        return ReadOnlyDict, (dict(self),)
