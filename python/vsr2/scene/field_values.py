"""Fields of frozen descriptions, kept in one form, whatever Python or numpy type spells them.

The content hash of a scene or a trial is made of these fields, and so are pickles: equal values
that were spelt differently, as 1, 1.0 and np.float64(1), must not differ there.
"""

from __future__ import annotations

from types import UnionType

import numpy as np

from vsr2.config.problems import shown
from vsr2.errors import GeometryError
from vsr2.read_only import real_argument


def keep_array(value: object, name: str, shape: tuple[int | None, ...]) -> None:
    """Turn what was given into an array of real numbers of a shape, in which None is any length.

    Raises:
        GeometryError: it is none.
    """
    what = f"{type(value).__name__}: {name}"
    array = real_argument(getattr(value, name), what, GeometryError)
    _check_shape(what, array.shape, shape)
    object.__setattr__(value, name, array)


def keep_indices(value: object, name: str, width: int) -> None:
    """Turn what was given into an array of 32-bit integers of shape (n, width).

    Raises:
        GeometryError: it is no array of integers, has a mask or another shape, or holds an integer
            that 32 bits do not.
    """
    given, what = getattr(value, name), f"{type(value).__name__}: {name}"
    masked = isinstance(given, np.ma.MaskedArray)
    if masked or not isinstance(given, np.ndarray) or given.dtype.kind not in "iu":
        raise GeometryError(f"{what} is not an array of integers without a mask")
    _check_shape(what, given.shape, (None, width))
    kept = given.astype(np.int32, copy=False)
    if not np.array_equal(kept, given):
        raise GeometryError(f"{what} holds {given.max()} as its largest, beyond 32 bits")
    object.__setattr__(value, name, kept)


def keep_number(value: object, *names: str) -> None:
    """Turn each of what was given into a real number of Python's own type.

    Raises:
        GeometryError: it is none.
    """
    for name in names:
        if type(getattr(value, name)) is not float:
            keep_array(value, name, ())
            object.__setattr__(value, name, float(getattr(value, name)))


def keep_numbers(value: object, **counts: int) -> None:
    """Turn each of what was given into a tuple of so many real numbers of Python's own type.

    Raises:
        GeometryError: it holds something else.
    """
    for name, count in counts.items():
        given = getattr(value, name)
        if type(given) is tuple and len(given) == count and {*map(type, given)} == {float}:
            continue  # Nearly all, and there are several a trial.
        keep_array(value, name, (count,))
        object.__setattr__(value, name, tuple(getattr(value, name).tolist()))


def keep_tuples(value: object, **kinds: type | UnionType) -> None:
    """Turn what was given in place of a tuple, such as a list, into one.

    Args:
        value: whose fields they are.
        kinds: what each field holds.

    Raises:
        GeometryError: it is no sequence, or holds something else.
    """
    for name, kind in kinds.items():
        given, what = getattr(value, name), f"{type(value).__name__}: {name}"
        if not isinstance(given, tuple | list | np.ndarray):
            raise GeometryError(f"{what} is {shown(given)}; give a tuple of {_named(kind)}")
        object.__setattr__(value, name, tuple(given))
        for k, one in enumerate(given):
            if not isinstance(one, kind):
                raise GeometryError(f"{what}[{k}] is {shown(one)}; it must be {_named(kind)}")


def check_kinds(value: object, **kinds: type | UnionType) -> None:
    """Refuse fields of another type.

    Raises:
        GeometryError: names field, value and the types that it may have.
    """
    for name, kind in kinds.items():
        given = getattr(value, name)
        if not isinstance(given, kind):
            what = f"{type(value).__name__}: {name}"
            raise GeometryError(f"{what} is {shown(given)}; it must be {_named(kind)}")


def _named(kind: type | UnionType) -> str:
    kinds = kind.__args__ if isinstance(kind, UnionType) else (kind,)
    return " or ".join("None" if one is type(None) else one.__name__ for one in kinds)


def _check_shape(what: str, given: tuple[int, ...], wanted: tuple[int | None, ...]) -> None:
    if len(given) != len(wanted) or any(
        n is not None and n != k for k, n in zip(given, wanted, strict=True)
    ):
        shape = str(wanted).replace("None", "n")
        raise GeometryError(f"{what} has shape {given}; it needs {shape}")
