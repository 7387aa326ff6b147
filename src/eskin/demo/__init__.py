"""A simulated arm at work in its skin, touched by people or by the mouse."""

from eskin.demo.headless import DemoConfig, Outcome, run_headless
from eskin.demo.live_source import LiveSource
from eskin.demo.simulated_user import Score, Try, Visitor

__all__ = [
    "DemoConfig",
    "LiveSource",
    "Outcome",
    "Score",
    "Try",
    "Visitor",
    "run_headless",
]
