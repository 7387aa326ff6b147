"""This package turns touches into commands of an arm that works on a task."""

from eskin.command.actions import command_function
from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import CommandMap, Rule, load_commands
from eskin.command.policy import Policy, PolicyConfig
from eskin.command.simulated_arm import DynamicPlant, SimulatedArm
from eskin.command.skin_monitor import SkinMonitorConfig
from eskin.command.task import FRAME_TASK, Task, TaskExecutor, Waypoint
from eskin.command.trajectory import MotionConfig, Trajectory

__all__ = [
    "FRAME_TASK",
    "Arm",
    "ArmState",
    "CommandMap",
    "DynamicPlant",
    "MotionConfig",
    "Policy",
    "PolicyConfig",
    "TaskExecutor",
    "Rule",
    "SimulatedArm",
    "Task",
    "Trajectory",
    "SkinMonitorConfig",
    "Waypoint",
    "command_function",
    "load_commands",
]
