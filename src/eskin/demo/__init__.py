"""This package shows a simulated arm in its skin, touched by people or the mouse."""

from eskin.demo.headless import DemoConfig, DemoResult, run_headless
from eskin.demo.live_source import LiveSource
from eskin.demo.simulated_user import (
    Attempt,
    CommandScore,
    SimulatedUser,
    SimulatedUserConfig,
    summarise_score,
)

__all__ = [
    "Attempt",
    "CommandScore",
    "DemoConfig",
    "DemoResult",
    "LiveSource",
    "SimulatedUser",
    "SimulatedUserConfig",
    "run_headless",
    "summarise_score",
]
