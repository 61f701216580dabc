"""Files of JSON lines that one process appends to: whole lines only, whatever stops the writing."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vsr2.errors import ResultError


def lock_file(file: int, path: Path) -> None:
    """Take an open file for this process alone, until it is closed.

    Raises:
        ResultError: another process holds it; names `path`.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno == errno.EWOULDBLOCK:
            raise ResultError(
                f"{path}: another process is writing it; let that one finish, or end it"
            ) from error
        # A file system without locks, as some networks have: nothing to hold on to.


def append_line(file: int, entry: Mapping[str, Any]) -> None:
    """Append one entry to an open file.

    Raises:
        OSError: it could not be written; what was is taken back.
    """
    line = (json.dumps(entry, separators=(",", ":")) + "\n").encode()
    start = os.lseek(file, 0, os.SEEK_CUR)
    if os.write(file, line) != len(line):
        # A full disk takes part of a line; take it back, so that later lines stay readable.
        os.ftruncate(file, start)
        os.lseek(file, start, os.SEEK_SET)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
