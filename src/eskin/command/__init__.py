"""From touches to motion: arms, what they do, and what may command them."""

from eskin.command.arm import Arm, ArmState
from eskin.command.command_map import CommandMap, Rule, load_commands
from eskin.command.dynamic_plant import DynamicPlant
from eskin.command.functions import command_function
from eskin.command.policy import Policy, PolicyConfig
from eskin.command.routine import Routine
from eskin.command.simulated_arm import SimulatedArm
from eskin.command.skin_watch import WatchConfig
from eskin.command.task import FRAME_TASK, Task, Waypoint
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
