"""From a source to those who listen: recogniser, recorder, viewer, commands."""

from eskin.stream.listener import Context, Listener
from eskin.stream.messages import Commanded, Message, RecognitionState
from eskin.stream.queue import BoundedQueue, QueueCount
from eskin.stream.recognition import FaultReporter, Recognition, found_at_once
from eskin.stream.recorder import Recorder, RecorderConfig
from eskin.stream.stream import Stream, stop_on_signals
from eskin.stream.timing import DurationHistogram, short_switch_interval

__all__ = [
    "Commanded",
    "Context",
    "DurationHistogram",
    "FaultReporter",
    "Message",
    "BoundedQueue",
    "QueueCount",
    "Listener",
    "RecognitionState",
    "Recognition",
    "Recorder",
    "RecorderConfig",
    "Stream",
    "found_at_once",
    "short_switch_interval",
    "stop_on_signals",
]
