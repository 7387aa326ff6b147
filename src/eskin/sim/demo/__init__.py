"""This package shows a simulated arm in its skin, touched by people or the mouse."""

from eskin.sim.demo.headless import DemoConfig, DemoResult, run_headless
from eskin.sim.demo.live_source import FaultStorm, LiveSource, StormConfig
from eskin.sim.demo.score import Attempt, CommandScore, TouchCauses, summarise_score
from eskin.sim.demo.simulated_user import SimulatedUser, SimulatedUserConfig

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
