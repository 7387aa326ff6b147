"""From touches to motion: arms, what they do, and what may command them."""

from eskin.command.actions import command_function
from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import CommandMap, Rule, load_commands
from eskin.command.policy import Policy, PolicyConfig
from eskin.command.simulated_arm import DynamicPlant, SimulatedArm
from eskin.command.skin_monitor import WatchConfig
from eskin.command.task import FRAME_TASK, Routine, Task, Waypoint
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
    "Routine",
    "Rule",
    "SimulatedArm",
    "Task",
    "Trajectory",
    "WatchConfig",
    "Waypoint",
    "command_function",
    "load_commands",
]
