"""This package shows a simulated arm in its skin, touched by people or the mouse."""

from eskin.demo.headless import DemoConfig, DemoResult, run_headless
from eskin.demo.live_source import LiveSource
from eskin.demo.score import Attempt, CommandScore, TouchCauses, summarise_score
from eskin.demo.simulated_user import SimulatedUser, SimulatedUserConfig
from eskin.demo.storm import FaultStorm, StormConfig

__all__ = [
    "Attempt",
    "CommandScore",
    "DemoConfig",
    "DemoResult",
    "FaultStorm",
    "LiveSource",
    "SimulatedUser",
    "SimulatedUserConfig",
    "StormConfig",
    "TouchCauses",
    "run_headless",
    "summarise_score",
]
