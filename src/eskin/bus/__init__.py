"""This package publishes a stream to other programs: to ROS 2 and to Foxglove.

The modules `ros2` and `foxglove` need the extras of their names.
"""

from eskin.bus.messages import (
    CONTACTS,
    DIAGNOSTICS,
    MARKERS,
    PRESSURE,
    ROBOT_DESCRIPTION,
    TRANSFORMS,
    DiagnosticStatus,
    Marker,
    compute_type_hash,
)
from eskin.bus.publisher import PUBLISHED, Bus, Publisher

__all__ = [
    "CONTACTS",
    "DIAGNOSTICS",
    "MARKERS",
    "PRESSURE",
    "PUBLISHED",
    "ROBOT_DESCRIPTION",
    "TRANSFORMS",
    "Bus",
    "DiagnosticStatus",
    "Marker",
    "Publisher",
    "compute_type_hash",
]
