"""Bytes of files that may be anything: pipes, gigabytes, nothing."""

from __future__ import annotations

import os
import stat

from vsr2.errors import Vsr2Error


class UnreadableError(Vsr2Error):
    """A file whose bytes cannot be had; says why, and the remedy, without naming the file."""


def read_bounded(path: str | os.PathLike[str], limit: int, *, remedy: str) -> bytes:
    """Bytes of a regular file of at most `limit` bytes.

    Args:
        path: the file.
        limit: [bytes]; a larger file is not read.
        remedy: what to do about a larger file.

    Raises:
        UnreadableError: missing, not a file, not readable, or larger.
    """
    try:
        # Opening a pipe would wait for a writer for ever.
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise UnreadableError("not a file; give the path of the file itself")
        content = b""
        if status.st_size <= limit:
            with open(path, "rb") as stream:
                content = stream.read(limit + 1)
    except FileNotFoundError:
        raise UnreadableError(
            "no such file; check the path, which is relative to the file that names it"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UnreadableError(f"cannot be read ({reason}); check path and rights") from None
    if max(status.st_size, len(content)) > limit:
        raise UnreadableError(f"larger than {limit} bytes; {remedy}")
    return content
