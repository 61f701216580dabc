"""The study: typed, frozen settings; reading YAML; importing ROS 2 parameter files."""

from vsr2.config.load import dump_study, load_study, study_from_mapping
from vsr2.config.reference import reference_markdown
from vsr2.config.ros2 import Ros2Import, import_ros2
from vsr2.config.schema import study_schema
from vsr2.config.study import Study

__all__ = [
    "Ros2Import",
    "Study",
    "dump_study",
    "import_ros2",
    "load_study",
    "reference_markdown",
    "study_from_mapping",
    "study_schema",
]
