"""This package simulates touches live, on request or as an endless stream."""

from eskin.sim.interactive.hand import InteractiveHand, LinkPoint
from eskin.sim.interactive.player import SampledScan, TouchPlayer
from eskin.sim.interactive.skin import InteractiveSkin, draw_demo_person

__all__ = [
    "InteractiveHand",
    "InteractiveSkin",
    "LinkPoint",
    "SampledScan",
    "TouchPlayer",
    "draw_demo_person",
]
