"""This package scores continuous streams: it matches detections to true events."""

from eskin.learn.events.curve import (
    RATES,
    CurvePoint,
    draw_curves,
    interpolate_missed,
    measure_curve,
)
from eskin.learn.events.event_scoring import (
    GROUPS,
    ErrorCount,
    EventScore,
    NonGestureTally,
    Tally,
    TouchGroup,
    score_events,
)
from eskin.learn.events.matching import (
    MatchConfig,
    Matching,
    ScoredStream,
    TrueEvent,
    match_events,
    read_true_events,
)
from eskin.learn.events.traces import (
    Trace,
    TracedStream,
    is_stream,
    trace_recording,
    trace_recordings,
)
from eskin.learn.events.tuning import TuningConfig, choose_decision

__all__ = [
    "GROUPS",
    "RATES",
    "CurvePoint",
    "ErrorCount",
    "EventScore",
    "TouchGroup",
    "TracedStream",
    "NonGestureTally",
    "MatchConfig",
    "Matching",
    "ScoredStream",
    "Tally",
    "Trace",
    "TrueEvent",
    "TuningConfig",
    "choose_decision",
    "trace_recordings",
    "draw_curves",
    "interpolate_missed",
    "is_stream",
    "match_events",
    "measure_curve",
    "score_events",
    "trace_recording",
    "read_true_events",
]
