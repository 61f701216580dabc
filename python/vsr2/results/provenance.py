"""Where a result comes from: versions, machine, time."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np


def base_provenance(build: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Facts about this program and machine, JSON-serialisable.

    Args:
        build: build facts of the native core, kept under the key `build`.

    Returns:
        `vsr2`, `python` and `numpy` versions, `platform`, `processor`, `created` (UTC, ISO 8601)
        and `build`.
    """
    try:
        own_version = version("vsr2")
    except PackageNotFoundError:
        own_version = "not installed"
    return {
        "vsr2": own_version,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": platform.platform(),
        "processor": _processor(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "build": dict(build or {}),
    }


def _processor() -> str:
    # `platform.processor()` is empty on Debian. The model matters: the maths library picks its
    # variants by it, so the last bits of a result may differ between processors.
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
