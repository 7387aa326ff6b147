"""This package turns touches into commands of an arm that works on a task.

The names below are imported when they are first used: the process that connects to a
robot imports `eskin.command.ur` alone, so that it starts quickly.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.command.actions import (
        ASK,
        HALTING_ACTIONS,
        REDUCING_ACTIONS,
        STARTING_ACTIONS,
        SUSPEND,
        command_function,
        moves_nothing,
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
    from eskin.command.policy import Policy, PolicyConfig
    from eskin.command.question import Question, QuestionConfig
    from eskin.command.skin_monitor import SkinMonitorConfig
    from eskin.command.task import FRAME_TASK, Task, TaskExecutor, Waypoint
    from eskin.command.trajectory import MotionConfig, Trajectory
    from eskin.command.ur_arm import UrArm

EXPORTS = {
    "actions": "ASK HALTING_ACTIONS REDUCING_ACTIONS STARTING_ACTIONS SUSPEND "
    "command_function moves_nothing resolve_action",
    "arm": "Arm ArmState",
    "command_map": "NON_GESTURES CommandMap Rule load_commands parse_commands",
    "policy": "Policy PolicyConfig",
    "question": "Question QuestionConfig",
    "skin_monitor": "SkinMonitorConfig",
    "task": "FRAME_TASK Task TaskExecutor Waypoint",
    "trajectory": "MotionConfig Trajectory",
    "ur_arm": "UrArm",
}
MODULES = {name: module for module, names in EXPORTS.items() for name in names.split()}

__all__ = [
    "ASK",
    "FRAME_TASK",
    "HALTING_ACTIONS",
    "NON_GESTURES",
    "REDUCING_ACTIONS",
    "STARTING_ACTIONS",
    "SUSPEND",
    "Arm",
    "ArmState",
    "CommandMap",
    "MotionConfig",
    "Policy",
    "PolicyConfig",
    "Question",
    "QuestionConfig",
    "Rule",
    "SkinMonitorConfig",
    "Task",
    "TaskExecutor",
    "Trajectory",
    "UrArm",
    "Waypoint",
    "command_function",
    "load_commands",
    "moves_nothing",
    "parse_commands",
    "resolve_action",
]


def __getattr__(name: str) -> object:
    """Import a name from its module when it is first used."""
    if name not in MODULES:
        raise AttributeError(f"module 'eskin.command' has no attribute '{name}'")
    module = importlib.import_module(f"eskin.command.{MODULES[name]}")
    value = globals()[name] = getattr(module, name)
    return value
