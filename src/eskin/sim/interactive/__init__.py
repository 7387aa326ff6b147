"""This package simulates touches live, on request or as an endless stream."""

from eskin.sim.interactive.hand import InteractiveHand, LinkPoint
from eskin.sim.interactive.player import TouchPlayer
from eskin.sim.interactive.skin import InteractiveSkin, draw_demo_person

__all__ = [
    "InteractiveHand",
    "InteractiveSkin",
    "LinkPoint",
    "TouchPlayer",
    "draw_demo_person",
]
