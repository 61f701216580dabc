"""How busy a machine is beside a benchmark."""

from __future__ import annotations

import os


def busy_seconds() -> float:
    """CPU time that all programs of this machine have used [s]."""
    with open("/proc/stat", encoding="ascii") as file:
        user, nice, system, _, _, irq, softirq, *_ = map(int, file.readline().split()[1:])
    return (user + nice + system + irq + softirq) / os.sysconf("SC_CLK_TCK")
