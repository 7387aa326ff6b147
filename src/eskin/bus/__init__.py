"""This package publishes a stream to other programs: to ROS 2 and to Foxglove.

The modules `ros2` and `foxglove` need the extras of their names.
"""

from eskin.bus.messages import (
    COMMAND_EVENT,
    CONTACTS,
    DIAGNOSTICS,
    MARKERS,
    PRESSURE,
    ROBOT_DESCRIPTION,
    TAXELS,
    TRANSFORMS,
    WRENCH,
    DiagnosticStatus,
    Marker,
    compute_type_hash,
)
from eskin.bus.publisher import (
    LEFT_TO_ROS,
    PUBLISHED,
    SENSOR_TOPICS,
    Bus,
    Publisher,
)

__all__ = [
    "COMMAND_EVENT",
    "CONTACTS",
    "DIAGNOSTICS",
    "LEFT_TO_ROS",
    "MARKERS",
    "PRESSURE",
    "PUBLISHED",
    "ROBOT_DESCRIPTION",
    "SENSOR_TOPICS",
    "TAXELS",
    "TRANSFORMS",
    "WRENCH",
    "Bus",
    "DiagnosticStatus",
    "Marker",
    "Publisher",
    "compute_type_hash",
]
