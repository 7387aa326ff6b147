"""Recordings on a timeline: play them, label them, compare what was said."""

from eskin.viewer.timeline.comparing import Pair, compare
from eskin.viewer.timeline.editing import Editing
from eskin.viewer.timeline.playing import Playing
from eskin.viewer.timeline.take import Take, read_take

__all__ = ["Editing", "Pair", "Playing", "Take", "compare", "read_take"]
