"""Continuous streams scored: true events, what was said of them, and what fits."""

from eskin.learn.events.event_scoring import (
    EventScore,
    NonGestureTally,
    Tally,
    score_events,
)
from eskin.learn.events.matching import MatchConfig, Matching, Take, match
from eskin.learn.events.read_true_events import TrueEvent, read_true_events
from eskin.learn.events.traces import (
    Trace,
    TracedStream,
    hear,
    is_stream,
    trace_recording,
)
from eskin.learn.events.tuning import TuningConfig, choose_decision

__all__ = [
    "EventScore",
    "TracedStream",
    "NonGestureTally",
    "MatchConfig",
    "Matching",
    "Take",
    "Tally",
    "Trace",
    "TrueEvent",
    "TuningConfig",
    "choose_decision",
    "hear",
    "is_stream",
    "match",
    "score_events",
    "trace_recording",
    "read_true_events",
]
