"""Arrays in `.npz` files, read without pickle and without trust in what the file claims."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Collection

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from vsr2.campaign.problems import Problems
from vsr2.motion.motion import MAX_SAMPLES

Array = NDArray[np.float64]

MAX_ARRAY_FILE_BYTES = 512 * 1024**2
"""Greater files are refused unread."""
_MAX_ARRAYS = 20


def parse_arrays(
    content: bytes, file: str, allowed: Collection[str], problems: Problems
) -> dict[str, Array] | None:
    """The arrays of real numbers in an `.npz` file; None where `problems` got one.

    Args:
        content: the file's bytes.
        file: how problems name it.
        allowed: names an array may have.
        problems: gets what is wrong.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.namelist()
            if len(members) > _MAX_ARRAYS or len(set(members)) != len(members):
                problems.add(file, f"holds {len(members)} arrays, some twice; write it again")
                return None
            names = {member.removesuffix(".npy"): member for member in members}
            unknown = sorted(set(names) - set(allowed))
            if unknown:
                problems.add(
                    file,
                    f"holds {ascii(unknown[0])[:60]}, which no reader knows; allowed are "
                    f"{', '.join(allowed)}",
                )
                return None
            out: dict[str, Array] = {}
            for name, member in names.items():
                found = _array(archive, member)
                if isinstance(found, str):
                    problems.add(file, found, column=name)
                    return None
                out[name] = found
            return out
    except Exception as error:  # a damaged archive raises what zipfile and numpy happen to raise
        reason = ascii(str(error))[1:-1][:200]
        problems.add(
            file,
            f"no sound .npz file ({type(error).__name__}: {reason}); write it again with "
            "numpy.savez",
        )
        return None


def _array(archive: zipfile.ZipFile, member: str) -> Array | str:
    """One array, or what is wrong with it; its header is judged before its data are unpacked."""
    with archive.open(member) as file:
        version = npy_format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = npy_format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, fortran, dtype = npy_format.read_array_header_2_0(file)
        else:
            return f"has the unknown .npy version {version}; write it with numpy.savez"
        if dtype.kind not in "fiu" or dtype.itemsize > 16:
            return f"holds {ascii(str(dtype))[:40]}, not real numbers; convert it to float64"
        if len(shape) > 2 or not 0 < math.prod(shape) <= 4 * MAX_SAMPLES:
            return (
                f"has shape {shape}; at most two dimensions and 1 to {4 * MAX_SAMPLES} numbers "
                "are allowed"
            )
        wanted = math.prod(shape) * dtype.itemsize
        data = file.read(wanted + 1)
    if len(data) != wanted:
        return f"has {len(data)} bytes where its shape needs {wanted}; write it again"
    raw: NDArray[np.generic] = np.frombuffer(data, dtype=dtype)
    with np.errstate(all="ignore"):  # what does not fit is refused as not finite, by its place
        return raw.astype(np.float64).reshape(shape, order="F" if fortran else "C")
