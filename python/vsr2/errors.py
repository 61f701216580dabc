"""Errors a user can act on; every message names what is wrong, where, and the remedy."""

from __future__ import annotations

import os
from typing import NoReturn, Self, overload

# What an error is about, for code that reacts to it.
from vsr2._native import Fault as Fault


class Renamed:
    """An attribute that is gone: whoever asks for it reads what replaced it.

    Args:
        name: what replaced it.
        note: what follows the name: its unit, and what else one may want.
    """

    def __init__(self, name: str, note: str) -> None:
        self.name = name
        self.now = name + note

    def __set_name__(self, owner: type, name: str) -> None:
        self.was = f"{owner.__name__}.{name}"

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> NoReturn: ...
    def __get__(self, instance: object, owner: type) -> Self:
        if instance is None:
            return self
        raise AttributeError(f"{self.was} is gone; use {self.now}")


class Vsr2Error(Exception):
    """Base of every error VSR2 raises on purpose; the command line prints no traceback for it.

    Args:
        message: what is wrong and the remedy.
        key: of the study, dotted, or what of a file is at fault; empty: nothing of the kind, or it
            is not known where the error is raised.
        file: that is at fault; empty: none.
        line: of the file, counted from 1; None: no line.
        fault: what it is about; None: that of its class.

    The text is `file:line: key: message`, without the parts that are empty.
    """

    fault = Fault.bad_value

    def __init__(
        self,
        message: str = "",
        *,
        key: str = "",
        file: str | os.PathLike[str] = "",
        line: int | None = None,
        fault: Fault | None = None,
    ) -> None:
        self.message, self.key, self.file, self.line = message, key, os.fspath(file), line
        self.fault = fault or self.fault
        where = self.file if line is None else f"{self.file}:{line}"
        super().__init__(": ".join(part for part in (where, key, message) if part))


def reason(error: BaseException) -> str:
    """Why something failed, of a system's error without its number and path."""
    return getattr(error, "strerror", None) or str(error)


class ConfigError(Vsr2Error):
    """A configuration file or value that cannot be used (names file, key, value, remedy)."""


class GeometryError(Vsr2Error):
    """A mesh, URDF or body description that cannot be used (names file and remedy)."""

    fault = Fault.geometry


class MotionError(Vsr2Error):
    """A ground motion that cannot be used (names file, sample or value, and remedy)."""

    fault = Fault.motion


class SimulationError(Vsr2Error):
    """A simulation that cannot be started or stepped as asked."""


class ResultError(Vsr2Error):
    """A result file or folder that cannot be read or written."""


class HazardError(Vsr2Error):
    """A hazard curve or fragility that gives no rate (names file, value and remedy)."""


class CampaignError(Vsr2Error):
    """A campaign of trials that cannot be used (names file, row, column, value and remedy)."""


class BlindError(Vsr2Error):
    """A blind pack, its key or its verdicts that cannot be used (names file, key and remedy)."""


class DiagnosisError(Vsr2Error):
    """A diagnosis that cannot be made as asked (names campaign, scene or option, and remedy)."""
