"""This package simulates people who touch a robot in its skin, from hands to counts.

Subpackages depend on each other one way: `contact` (pressure on taxels), `people`
(bodies and gestures), `scene` (the robot, poses, places), `sensor` (pressure to
counts), `dataset` (clips as files), `interactive` (a skin without end).
"""

from eskin.sim.constants import Constants, load_constants
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactPads, Press, SoftTissue, TrueTouch

__all__ = [
    "Chart",
    "Constants",
    "SoftTissue",
    "Press",
    "ContactPads",
    "TrueTouch",
    "build_charts",
    "load_constants",
]
