"""This package demonstrates a simulated arm in its skin, touched by people or mouse."""

from eskin.demo.headless import DemoConfig, DemoResult, run_headless
from eskin.demo.live_source import LiveSource
from eskin.demo.simulated_user import Attempt, CommandScore, SimulatedUser

__all__ = [
    "DemoConfig",
    "LiveSource",
    "DemoResult",
    "CommandScore",
    "Attempt",
    "SimulatedUser",
    "run_headless",
]
