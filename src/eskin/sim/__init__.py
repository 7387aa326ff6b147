"""A simulated world: people, hands, gestures, contact and sensor."""

from eskin.sim.constants import Constants, load_constants
from eskin.sim.contact.chart import Chart, charts_of
from eskin.sim.contact.press import Flesh, Press, Stamps, TrueTouch

__all__ = [
    "Chart",
    "Constants",
    "Flesh",
    "Press",
    "Stamps",
    "TrueTouch",
    "charts_of",
    "load_constants",
]
