"""This package publishes the scans of a source to recogniser, recorder and viewer."""

from eskin.stream.faults import (
    WAY_TEXTS,
    FaultReporter,
    describe_places,
    describe_way,
)
from eskin.stream.listener import (
    BoundedQueue,
    CommandEvent,
    Context,
    Correction,
    DurationHistogram,
    Listener,
    Message,
    QueueCount,
    RecognitionState,
    short_switch_interval,
)
from eskin.stream.recognition import Recognition
from eskin.stream.recorder import Recorder, RecorderConfig
from eskin.stream.stream import Stream, stop_on_signals

__all__ = [
    "CommandEvent",
    "Context",
    "Correction",
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
    "WAY_TEXTS",
    "describe_places",
    "describe_way",
    "short_switch_interval",
    "stop_on_signals",
]
