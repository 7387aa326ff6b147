"""This package holds arms that work on a task: simulated arms, and arms of UR.

The names below are imported when they are first used: the process that connects to a
robot imports `eskin.arms.ur` alone, so that it starts quickly.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.arms.dynamics import Dynamics, ServoConfig, Wrench
    from eskin.arms.simulated_arm import (
        DynamicPlant,
        ProtectiveStopConfig,
        SimulatedArm,
    )
    from eskin.arms.task import FRAME_TASK, Task, TaskExecutor, Waypoint
    from eskin.arms.trajectory import MotionConfig, Trajectory
    from eskin.arms.ur_arm import UrArm

EXPORTS = {
    "dynamics": "Dynamics ServoConfig Wrench",
    "simulated_arm": "DynamicPlant ProtectiveStopConfig SimulatedArm",
    "task": "FRAME_TASK Task TaskExecutor Waypoint",
    "trajectory": "MotionConfig Trajectory",
    "ur_arm": "UrArm",
}
MODULES = {name: module for module, names in EXPORTS.items() for name in names.split()}

__all__ = [
    "FRAME_TASK",
    "DynamicPlant",
    "Dynamics",
    "MotionConfig",
    "ProtectiveStopConfig",
    "ServoConfig",
    "SimulatedArm",
    "Task",
    "TaskExecutor",
    "Trajectory",
    "UrArm",
    "Waypoint",
    "Wrench",
]


def __getattr__(name: str) -> object:
    """Import a name from its module when it is first used."""
    if name not in MODULES:
        raise AttributeError(f"module 'eskin.arms' has no attribute '{name}'")
    module = importlib.import_module(f"eskin.arms.{MODULES[name]}")
    value = globals()[name] = getattr(module, name)
    return value
