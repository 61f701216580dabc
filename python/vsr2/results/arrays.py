"""Named arrays in `.npz` files, read without trust in what the file claims."""

from __future__ import annotations

import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.results.atomic import write_atomic

MAX_ARRAY_BYTES = 4 * 2**30
"""Largest array that is read; the longest motion with contacts at each step stays below it."""


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of numbers as an `.npz` file, whole or not at all.

    Raises:
        ResultError: the file cannot be written.
    """
    write_atomic(path, lambda file: np.savez(file, allow_pickle=False, **dict(arrays)))


def read_arrays(
    path: Path, kinds: Mapping[str, type[np.generic]], *, optional: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Read named arrays of known number types from an `.npz` file.

    Args:
        path: the file.
        kinds: the wanted arrays with their types; others in the file are not looked at.
        optional: those that the file need not hold; they are then not in the answer.

    Raises:
        ResultError: the file is missing, damaged, or holds something else.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            held = set(archive.namelist())
            return {
                name: _read_array(archive, name, np.dtype(kind))
                for name, kind in kinds.items()
                if name not in optional or f"{name}.npy" in held
            }
    except FileNotFoundError as error:
        raise ResultError(f"{path}: does not exist") from error
    except Exception as error:  # bytes of any kind make zip and header readers raise any kind
        reason = error.args[0] if error.args else type(error).__name__
        raise ResultError(
            f"{path}: damaged or not of VSR2 ({reason}); restore it or run the study again"
        ) from error


def _read_array(archive: zipfile.ZipFile, name: str, dtype: np.dtype[np.generic]) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as file:
        version = npy_format.read_magic(file)
        if version != (1, 0):
            raise ValueError(f"array {name} has the unknown format {version}")
        shape, fortran, stored = npy_format.read_array_header_1_0(file)
        if stored != dtype:
            raise ValueError(f"array {name} holds {stored} where {dtype} is wanted")
        # In Python integers, which do not overflow: the header may claim any shape.
        size = dtype.itemsize
        for length in shape:
            size *= length
        if not 0 <= size <= MAX_ARRAY_BYTES:
            raise ValueError(f"array {name} claims the shape {shape}")
        data = file.read(size + 1)
    if len(data) != size:
        raise ValueError(f"array {name} has {len(data)} bytes where its shape needs {size}")
    return np.frombuffer(data, dtype=dtype).reshape(shape, order="F" if fortran else "C").copy()
