"""This package simulates touches without end, computed while they are played."""

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
