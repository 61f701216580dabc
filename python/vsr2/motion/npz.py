"""Arrays of real numbers in `.npz` files, read without pickle and without trust in headers."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from vsr2.errors import Vsr2Error
from vsr2.motion.motion import Array
from vsr2.one_line import counted

_MAX_ARRAYS = 20
"""Of one file; more is no record."""


class NpzError(Vsr2Error):
    """What is wrong with an `.npz` file.

    Attributes:
        array: its name; "" where it is the file.
        what: value and remedy.
    """

    def __init__(self, array: str, what: str) -> None:
        super().__init__(f"{array}: {what}" if array else what)
        self.array = array
        self.what = what


def npz_arrays(
    content: bytes,
    check_names: Callable[[Collection[str]], None],
    *,
    max_dimensions: int,
    max_numbers: int,
) -> dict[str, Array]:
    """The arrays of an `.npz` file as double precision.

    Args:
        content: the file's bytes.
        check_names: gets the names before anything is unpacked; raises :class:`NpzError`.
        max_dimensions: of an array.
        max_numbers: of an array.

    Raises:
        NpzError: no sound archive, too many arrays, or one of no real numbers or of other bounds.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.namelist()
            if len(members) > _MAX_ARRAYS or len(set(members)) != len(members):
                raise NpzError(
                    "", f"holds {counted(len(members), 'array')}, some twice; write it again"
                )
            names = {member.removesuffix(".npy"): member for member in members}
            check_names(names.keys())
            return {
                name: _array(archive, name, member, max_dimensions, max_numbers)
                for name, member in names.items()
            }
    except NpzError:
        raise
    except Exception as error:  # a damaged archive raises what zipfile and numpy happen to raise
        reason = ascii(str(error))[1:-1][:200]
        raise NpzError(
            "",
            f"no sound .npz file ({type(error).__name__}: {reason}); write it again with "
            "numpy.savez",
        ) from None


def _array(
    archive: zipfile.ZipFile, name: str, member: str, max_dimensions: int, max_numbers: int
) -> Array:
    def check(shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        if dtype.kind not in "fiu" or dtype.itemsize > 16:
            raise NpzError(
                name, f"holds {ascii(str(dtype))[:40]}, not real numbers; convert it to float64"
            )
        if len(shape) > max_dimensions or not 0 < math.prod(shape) <= max_numbers:
            raise NpzError(
                name,
                f"has shape {shape}; at most {max_dimensions} dimension(s) and 1 to {max_numbers} "
                "numbers are allowed",
            )

    raw = stored_array(archive, name, member, check)
    with np.errstate(all="ignore"):  # what does not fit is refused as not finite, by its sample
        return raw.astype(np.float64)


def stored_array(
    archive: zipfile.ZipFile,
    name: str,
    member: str,
    check: Callable[[tuple[int, ...], np.dtype[Any]], None],
) -> NDArray[Any]:
    """One array of an archive, read-only; its header is judged before its data are unpacked.

    Args:
        archive: open for reading.
        name: of the array, for messages.
        member: its file in the archive.
        check: gets the shape and type that the header claims; raises where they are not wanted.

    Raises:
        NpzError: a header of an unknown version, or data of another size than it claims.
    """
    with archive.open(member) as file:
        version = npy_format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = npy_format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, fortran, dtype = npy_format.read_array_header_2_0(file)
        else:
            raise NpzError(name, f"unknown .npy version {version}; write it with numpy.savez")
        check(shape, dtype)
        # In Python integers, which do not overflow: the header may claim any shape.
        wanted = math.prod(shape) * dtype.itemsize
        data = file.read(wanted + 1)
    if len(data) != wanted:
        raise NpzError(
            name,
            f"has {counted(len(data), 'byte')} where its shape needs {wanted}; copy the file, or "
            "write it, again",
        )
    return np.frombuffer(data, dtype=dtype).reshape(shape, order="F" if fortran else "C")
