"""What a command line says of a file or folder that it wrote."""

from __future__ import annotations

from os import PathLike


def wrote(path: str | PathLike[str]) -> str:
    """That it lies there now."""
    return f"wrote {path}"
