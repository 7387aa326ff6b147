"""Continuous streams scored: true events, what was said of them, and what fits."""

from eskin.learn.events.event_scoring import EventScore, LeftAlone, Tally, score_events
from eskin.learn.events.matching import MatchConfig, Matching, Take, match
from eskin.learn.events.traces import HeardStream, Trace, hear, is_stream, trace_of
from eskin.learn.events.true_events import TrueEvent, true_events
from eskin.learn.events.tuning import TuningConfig, choose_decision

__all__ = [
    "EventScore",
    "HeardStream",
    "LeftAlone",
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
    "trace_of",
    "true_events",
]
