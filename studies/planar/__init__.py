"""The planar rocking block: a fast simulator on which the diagnosis is rehearsed and tested."""

from planar.planar_library import PLANAR_LIBRARY, PlanarEffect
from planar.planar_simulator import PlanarSimulator

__all__ = ["PLANAR_LIBRARY", "PlanarEffect", "PlanarSimulator"]
