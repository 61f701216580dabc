"""Several causes of a campaign's outcomes at once, by how strong motions must be to overturn."""

from vsr2.causes.causes import Causes, find_causes
from vsr2.causes.causes_schema import causes_schema

__all__ = ["Causes", "causes_schema", "find_causes"]
