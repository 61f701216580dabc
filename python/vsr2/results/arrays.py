"""Named arrays in `.npz` files, read without trust in what the file claims."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsr2.errors import ResultError
from vsr2.motion.npz import stored_array
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


def _read_array(archive: zipfile.ZipFile, name: str, wanted: np.dtype[Any]) -> NDArray[Any]:
    def check(shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        if dtype != wanted:
            raise ValueError(f"array {name} holds {dtype} where {wanted} is wanted")
        if not 0 <= math.prod(shape) * dtype.itemsize <= MAX_ARRAY_BYTES:
            raise ValueError(f"array {name} claims the shape {shape}")

    return stored_array(archive, name, f"{name}.npy", check).copy()
