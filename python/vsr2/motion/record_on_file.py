"""A record whose samples stay in its file: read when they are asked for, and not kept."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from vsr2.errors import MotionError
from vsr2.motion.motion import CHANNELS, Array
from vsr2.motion.record import Record
from vsr2.motion.recording import read_record


class RecordOnFile(Record):
    """A record that reads its channels from the file it came from.

    Args:
        record: whose file holds the same samples.

    Raises:
        MotionError: where a channel is asked for: the file is gone, or was changed.
    """

    def __init__(self, record: Record) -> None:
        kept = {key: value for key, value in vars(record).items() if key not in CHANNELS}
        vars(self).update(kept, _recorded=tuple(record.channels))

    def __getattribute__(self, name: str) -> object:
        if name not in CHANNELS:
            return super().__getattribute__(name)
        return self._channel(name) if name in vars(self)["_recorded"] else None

    def lacking(self, channel: str) -> str | None:
        """As of :class:`Record`, without reading."""
        needed = ("displacement", "acceleration") if channel == "fused" else (channel,)
        return next((name for name in needed if name not in vars(self)["_recorded"]), None)

    def _channel(self, name: str) -> Array:
        channel: Array = getattr(_read(self.source, self.sha256), name)
        return channel


@lru_cache(maxsize=1)
def _read(source: str, sha256: str) -> Record:
    """The record of a file of that hash: the channels of one are asked for together."""
    found = read_record(Path(source))
    if found.sha256 != sha256:
        raise MotionError("was changed after it was read; put it back, or begin again", file=source)
    return found


def on_file(record: Record) -> Record:
    """The same record, its samples left in its file where that holds nothing else.

    Args:
        record: any.

    Returns:
        A record that reads; `record` itself where it has no file, or where its samples or interval
        are not the file's.
    """
    if isinstance(record, RecordOnFile) or not record.sha256:
        return record
    try:
        found = read_record(Path(record.source))
    except MotionError:
        return record
    same = (
        found.sha256 == record.sha256
        and found.sample_interval == record.sample_interval
        and list(found.channels) == list(record.channels)
        and all(map(np.array_equal, found.channels.values(), record.channels.values()))
    )
    return RecordOnFile(record) if same else record
