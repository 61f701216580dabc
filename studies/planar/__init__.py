"""The planar rocking block: a fast simulator on which the diagnosis is rehearsed and tested."""

from planar.library import PLANAR_LIBRARY, PlanarEffect
from planar.simulator import PlanarSimulator

__all__ = ["PLANAR_LIBRARY", "PlanarEffect", "PlanarSimulator"]
