"""Links within a result's folder, which may lead to files that are not ours."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from vsr2.errors import ResultError

FIGURE_FOLDER, SHARD_FOLDER = "figures", "shards"


def refuse_links(folder: Path, inner: Iterable[str]) -> None:
    """Refuse folders within a result's that are links.

    Args:
        folder: of the result.
        inner: names of its folders, whether or not they are there.

    Raises:
        ResultError: one is a link.
    """
    for name in inner:
        if (folder / name).is_symlink():
            raise ResultError(
                f"{folder / name}: is a link, through which no result is written or removed; "
                "remove it, or choose another folder"
            )
