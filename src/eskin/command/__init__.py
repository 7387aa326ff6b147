"""This package turns touches into commands of an arm."""

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
from eskin.command.reasons import Problem, Refusal, Trigger
from eskin.command.skin_monitor import SkinMonitorConfig

__all__ = [
    "ASK",
    "HALTING_ACTIONS",
    "NON_GESTURES",
    "REDUCING_ACTIONS",
    "STARTING_ACTIONS",
    "SUSPEND",
    "Arm",
    "ArmState",
    "CommandMap",
    "Policy",
    "PolicyConfig",
    "Problem",
    "Question",
    "QuestionConfig",
    "Refusal",
    "Rule",
    "SkinMonitorConfig",
    "Trigger",
    "command_function",
    "load_commands",
    "moves_nothing",
    "parse_commands",
    "resolve_action",
]
