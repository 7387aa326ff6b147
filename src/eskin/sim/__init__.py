"""A simulated world: people, hands, gestures, contact and sensor."""

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
