"""Functions that the command map in this folder names."""

from eskin.command import Arm
from eskin.live import Detection


def half(arm: Arm, detection: Detection) -> None:
    """Let the arm go at half of its speed."""
    arm.set_speed(0.5)
