"""From a source to those who listen: recogniser, recorder, viewer, commands."""

from eskin.stream.durations import Durations
from eskin.stream.fault_watch import FaultWatch, found_together
from eskin.stream.inbox import Inbox, InboxCount
from eskin.stream.listener import Context, Listener
from eskin.stream.moment import Commanded, Heard, Moment
from eskin.stream.recognition import Recognition
from eskin.stream.recorder import Recorder, RecorderConfig
from eskin.stream.signals import stopped_by_signals
from eskin.stream.stream import Stream
from eskin.stream.turns import short_turns

__all__ = [
    "Commanded",
    "Context",
    "Durations",
    "FaultWatch",
    "Heard",
    "Inbox",
    "InboxCount",
    "Listener",
    "Moment",
    "Recognition",
    "Recorder",
    "RecorderConfig",
    "Stream",
    "found_together",
    "short_turns",
    "stopped_by_signals",
]
