"""One trial as the custodian has it simulated, and what an engine is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsr2.blind.form.pack_settings import ENGINES, EngineName
from vsr2.blind.mujoco import NOMINAL, ContactModel, Drawable, Response, TrialContext
from vsr2.config import Study
from vsr2.errors import BlindError

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True)
class Nuisances:
    """What is uncertain in every campaign and not to be diagnosed; factors on nominal values.

    Attributes:
        width, depth, height: of the body.
        energy_ratio: of an impact.
        friction: coefficient.
    """

    width: float = 1.0
    depth: float = 1.0
    height: float = 1.0
    energy_ratio: float = 1.0
    friction: float = 1.0


@dataclass(frozen=True, eq=False)
class TrialInput:
    """One trial to simulate.

    Attributes:
        interval: of the table's motion [s].
        displacement: of the table before any effect, shape (n,) [m].
        effects: by canonical name, with values by parameter.
        nuisances: of the campaign.
        yaw: of the start [rad].
        offset: of the start, x and y [m].
        context: the trial's position in the campaign, and seeds of what effects draw.
    """

    interval: float
    displacement: Array
    effects: Mapping[str, Values] = field(default_factory=dict)
    nuisances: Nuisances = field(default_factory=Nuisances)
    yaw: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    context: TrialContext = field(default_factory=TrialContext)


class PackEngine(Protocol):
    """Simulates trials of one nominal scene."""

    name: str

    @property
    def versions(self) -> Mapping[str, str]:
        """Of what simulates."""
        ...

    @property
    def effects(self) -> Mapping[str, Drawable]:
        """What it can apply."""
        ...

    @property
    def static_acceleration(self) -> float:
        """Acceleration at which the nominal body lifts off, g b / h [m/s^2]."""
        ...

    def run(self, inputs: Iterable[TrialInput], series_interval: float) -> Iterator[Response]:
        """Simulate the trials of a campaign, in their order."""
        ...


def build_engine(name: str, study: Study, contact: ContactModel = NOMINAL) -> PackEngine:
    """The engine of that name for a study's scene.

    Args:
        name: an `EngineName`.
        study: of the nominal scene.
        contact: of the engine mujoco.

    Raises:
        BlindError: it is not known, not installed, or cannot simulate the scene.
    """
    if name == EngineName.MUJOCO:
        from vsr2.blind.custodian.mujoco_engine import MujocoEngine

        return MujocoEngine(study, contact)
    if name == EngineName.BULLET:
        from vsr2.blind.custodian.bullet_engine import BulletEngine

        return BulletEngine(study)
    raise BlindError(f"engine {name!r} is not known; choose {' or '.join(ENGINES)}")
