"""The planar rocking block: a fast simulator on which the diagnosis is rehearsed and tested."""

from vsr2.diagnosis.simulated.planar.library import PLANAR_LIBRARY, PlanarEffect
from vsr2.diagnosis.simulated.planar.simulator import PlanarSimulator

__all__ = ["PLANAR_LIBRARY", "PlanarEffect", "PlanarSimulator"]
