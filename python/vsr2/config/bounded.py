"""Bytes of files that may be anything: pipes, gigabytes, nothing."""

from __future__ import annotations

import os
import stat
from itertools import islice
from pathlib import Path

from vsr2.errors import ConfigError, Vsr2Error, reason
from vsr2.near_words import NEAR, near_words


class UnreadableError(Vsr2Error):
    """A file whose bytes cannot be had; says why, and the remedy, without naming the file."""


def from_here(path: str | os.PathLike[str]) -> Path:
    """A path made absolute against the working folder, which an absolute one does not need.

    Not normalised: `..` after a symbolic link means the folder above the link's target.

    Raises:
        ConfigError: the path is relative, and the working folder is gone.
    """
    found = Path(path)
    if found.is_absolute():
        return found
    try:
        return Path.cwd() / found
    except OSError:
        raise ConfigError(
            "the working folder is gone, so that nothing is relative to it; change to a folder "
            "that exists",
            file=found,
        ) from None


MAX_NEIGHBOURS = 10_000
"""Most entries of a folder among which a near name is sought."""


def near_path(path: str | os.PathLike[str]) -> str:
    """The path of the entry beside `path` that a mistyped name most likely means; empty: none."""
    folder, name = os.path.split(os.fspath(path))
    try:
        with os.scandir(folder or ".") as entries:
            names = [one.name for one in islice(entries, MAX_NEIGHBOURS) if one.name != name]
    except (OSError, ValueError):
        return ""
    near = near_words(name, names, alike=NEAR.slip)
    return os.path.join(folder, near[0]) if near and near[0].isprintable() else ""


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
        near = near_path(path)
        raise UnreadableError(
            f"no such file; did you mean {near}?" if near else "no such file; check the path"
        ) from None
    except (OSError, ValueError) as error:
        raise UnreadableError(f"cannot be read ({reason(error)}); check path and rights") from None
    if max(status.st_size, len(content)) > limit:
        raise UnreadableError(f"larger than {limit} bytes; {remedy}")
    return content
