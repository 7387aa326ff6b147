"""This package turns touches into commands of an arm that works on a task."""

from eskin.command.actions import (
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    command_function,
    resolve_action,
)
from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import (
    NON_GESTURES,
    CommandMap,
    Rule,
    load_commands,
    parse_commands,
)
from eskin.command.policy import SUSPEND, Policy, PolicyConfig
from eskin.command.simulated_arm import (
    DynamicPlant,
    ProtectiveStopConfig,
    SimulatedArm,
)
from eskin.command.skin_monitor import SkinMonitorConfig
from eskin.command.task import FRAME_TASK, Task, TaskExecutor, Waypoint
from eskin.command.trajectory import MotionConfig, Trajectory
from eskin.command.ur_arm import UrArm

__all__ = [
    "FRAME_TASK",
    "HALTING_ACTIONS",
    "NON_GESTURES",
    "REDUCING_ACTIONS",
    "STARTING_ACTIONS",
    "Arm",
    "ArmState",
    "CommandMap",
    "DynamicPlant",
    "MotionConfig",
    "Policy",
    "PolicyConfig",
    "ProtectiveStopConfig",
    "Rule",
    "SimulatedArm",
    "SkinMonitorConfig",
    "Task",
    "TaskExecutor",
    "SUSPEND",
    "Trajectory",
    "UrArm",
    "Waypoint",
    "command_function",
    "load_commands",
    "parse_commands",
    "resolve_action",
]
