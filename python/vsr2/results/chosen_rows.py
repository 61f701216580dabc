"""Some of the rows of a table: a slice, indices or a mask, as numpy takes them."""

from __future__ import annotations

from numbers import Integral
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from vsr2.config.problems import shown
from vsr2.errors import ResultError
from vsr2.read_only import refuse_mask


def chosen_rows(wanted: Any, count: int) -> NDArray[np.intp]:
    """Indices of the rows that are wanted, shape (m,).

    numpy also takes None, a single number and arrays of more dimensions, which give no table, and
    truth values among numbers as 0 and 1.

    Args:
        wanted: a slice, indices of shape (m,), negative ones from the end, or a mask of shape
            (count,).
        count: rows of the table.

    Raises:
        ResultError: anything else, or a row that is not there; names what was given.
    """
    if isinstance(wanted, Integral) and not isinstance(wanted, bool):
        _refuse_one(int(wanted), count)
    try:
        return np.arange(count)[wanted if isinstance(wanted, slice) else _one_dimension(wanted)]
    except (IndexError, TypeError, ValueError) as error:
        raise ResultError(
            f"result[{shown(wanted)}]: no such trials among {count} ({error}); give a slice, "
            "indices or a mask"
        ) from None


def _refuse_one(wanted: int, count: int) -> NoReturn:
    """Refuse a single number with what gives that trial."""
    if not -count <= wanted < count:
        raise ResultError(
            f"result[{wanted}]: no such trial among {count}; give a slice, indices or a mask"
        )
    end = "" if wanted == -1 else str(wanted + 1)
    raise ResultError(
        f"result[{wanted}]: give a slice, as in result[{wanted}:{end}], or use "
        f"result.log({wanted if wanted >= 0 else wanted + count})"
    )


def _one_dimension(wanted: Any) -> NDArray[Any]:
    """Indices or a mask, of one dimension."""
    refuse_mask(wanted)
    given = np.asarray(wanted)
    if isinstance(wanted, list) and given.dtype.kind != "b" and any(map(_is_truth, wanted)):
        raise TypeError("truth values among numbers")
    if isinstance(wanted, tuple) or given.ndim != 1:
        raise TypeError("not of one dimension")
    if not given.size:
        return given.astype(np.intp)  # An empty list is one of floats.
    if given.dtype.kind not in "iub":
        raise TypeError(f"neither indices nor a mask, but of {given.dtype}")
    if given.dtype.kind == "u" and given.max() > np.iinfo(np.intp).max:
        raise IndexError(f"index {given.max()} is out of bounds")  # numpy would wrap it round.
    return given


def _is_truth(value: object) -> bool:
    return isinstance(value, bool | np.bool_)
