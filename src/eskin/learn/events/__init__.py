"""Continuous streams scored: true events, what was said of them, and what fits."""

from eskin.learn.events.counting import LeftAlone, Tally
from eskin.learn.events.hearing import HeardStream, hear, is_stream
from eskin.learn.events.judge import score_events
from eskin.learn.events.matching import MatchConfig, Matching, match
from eskin.learn.events.score import EventScore
from eskin.learn.events.take import Take
from eskin.learn.events.trace import Trace, trace_of
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
