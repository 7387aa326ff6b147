"""This module replays recordings up to the last step of recognition, the decision.

A trace holds all inputs of the decision, so that other settings need no other replay.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from joblib import Parallel, delayed, parallel_config

from eskin.learn.events.matching import ScoredStream, TrueEvent, read_true_events
from eskin.learn.ground_truth import match_labels
from eskin.live import (
    DecisionConfig,
    DecisionFilter,
    Detection,
    Model,
    Recognizer,
    build_detection,
    compute_probabilities,
)
from eskin.recording import (
    NO_OVERRIDES,
    Overrides,
    Recording,
    check_labels,
    read_recording,
)
from eskin.skin import MountedSkin
from eskin.touch import Touch
from eskin.units import NS_PER_S

ANY_TRAVEL = DecisionConfig(min_travel=float(np.finfo(float).tiny))
"""Settings by which every touch that has moved at all has a direction."""


@dataclass(frozen=True, eq=False)
class TraceStep:
    """A trace step holds the inputs of the decision at one reading."""

    stamp: int
    """Stamp of the reading [ns since the epoch]."""
    touches: tuple[Touch, ...]
    """Touches that are open."""
    closed: tuple[Touch, ...]
    """Touches that closed with it."""
    logits: Float[np.ndarray, "touch class"]
    """Logits of the open touches."""
    closing_logits: Float[np.ndarray, "touch class"]
    """Logits for their decisions if they close after this reading."""
    directions: Float[np.ndarray, "touch 3"]
    """Direction of travel of each open touch in the world, a unit vector."""


@dataclass(frozen=True, eq=False)
class Trace:
    """A trace holds all results of recognising a recording but the decisions."""

    vocabulary: tuple[str, ...]
    """Classes in the order of the logits."""
    temperature: float
    """Temperature of the model's card."""
    decision: DecisionConfig
    """Decision settings of the model's card."""
    change_ends: bool
    """Whether touches end when another class is likelier (see `DecisionFilter`)."""
    steps: tuple[TraceStep, ...]
    """Steps in the order of time; other readings have no open or closing touch."""

    def decide(
        self, config: DecisionConfig | None = None, temperature: float | None = None
    ) -> list[Detection]:
        """Return the detections that would be made live with some decision settings.

        Args:
            config: decision settings; None takes the model's.
            temperature: temperature to use instead of the model's.
        """
        config = config or self.decision
        if temperature is None:
            temperature = self.temperature
        decision_filter = DecisionFilter(self.vocabulary, config, self.change_ends)
        directions: dict[int, np.ndarray] = {}
        found: list[Detection] = []
        for step in self.steps:
            ids = [touch.id for touch in step.touches]
            directions |= zip(ids, step.directions, strict=True)
            probabilities, closing = (
                {
                    touch: compute_probabilities(row, temperature)
                    for touch, row in zip(ids, logits, strict=True)
                }
                for logits in (step.logits, step.closing_logits)
            )
            decisions = decision_filter.make_decisions(
                step.stamp, step.touches, step.closed, probabilities, closing
            )
            by_id = {touch.id: touch for touch in (*step.touches, *step.closed)}
            for decision in decisions:
                touch = by_id[decision.touch]
                has_moved = np.linalg.norm(touch.travel) >= config.min_travel
                direction = directions[touch.id] if has_moved else np.zeros(3)
                found.append(build_detection(decision, touch, step.stamp, direction))
        return found


def trace_recording(recording: Recording, model: Model) -> Trace:
    """Replay a recording through the recogniser and record each step."""
    mounted = MountedSkin(recording.skin, recording.load_robot())
    recognizer = Recognizer(model, mounted, recording.calibration, ANY_TRAVEL)
    steps: list[TraceStep] = []
    for scan in recording.scans():
        recognizer.push(scan)
        state = recognizer.state
        if state is not None and (state.touches or state.closed_touches):
            steps.append(record_step(recognizer, state.touches, state.closed_touches))
    closed = recognizer.pipeline.finish()
    if closed:
        steps.append(record_step(recognizer, (), closed))
    return Trace(
        vocabulary=model.card.vocabulary,
        temperature=model.card.temperature,
        decision=model.card.decision,
        change_ends=not mounted.skin.calibrated,
        steps=tuple(steps),
    )


def record_step(
    recognizer: Recognizer, touches: tuple[Touch, ...], closed: tuple[Touch, ...]
) -> TraceStep:
    """Return the trace step of the reading that a recogniser has just processed."""
    assert recognizer.state is not None
    classes = len(recognizer.model.card.vocabulary)
    classifier = recognizer.classifier
    keys = [classifier.get_key(touch.id) for touch in touches]
    logits = [classifier.logits[key] for key in keys]
    closing_logits = [classifier.closing_logits[key] for key in keys]
    compute_direction = recognizer.directions.compute_direction
    directions = [compute_direction(touch.id) for touch in touches]
    return TraceStep(
        stamp=recognizer.state.reading.stamp,
        touches=touches,
        closed=closed,
        logits=np.array(logits).reshape(-1, classes),
        closing_logits=np.array(closing_logits).reshape(-1, classes),
        directions=np.array(directions).reshape(-1, 3),
    )


STREAM_SECONDS = 10.0  # [s] without a gap that make a simulated recording a stream


@dataclass(frozen=True, eq=False)
class TracedStream:
    """A traced stream holds a recording's trace and its true events."""

    path: Path
    """Path of the recording."""
    subject: str
    """Subject of the recording, or its session where that is not known."""
    seconds: float
    """Duration of its readings, without the gaps [s]."""
    truncated: bool
    """Whether the end of the recording is missing."""
    events: tuple[TrueEvent, ...]
    """True events."""
    trace: Trace
    """Trace of the recogniser."""

    def decide(
        self, config: DecisionConfig | None = None, temperature: float | None = None
    ) -> ScoredStream:
        """Return the stream with the detections of some decision settings."""
        detections = self.trace.decide(config, temperature)
        return ScoredStream(self.events, detections, self.seconds, self.subject)


def trace_recordings(
    paths: Sequence[Path],
    model: Model,
    workers: int = 1,
    overrides: Overrides = NO_OVERRIDES,
) -> Iterator[TracedStream]:
    """Yield the traces of recordings, in their order.

    Args:
        paths: paths of the recordings.
        model: model to recognise with.
        workers: number of processes; 1 uses this process.
        overrides: what to use in place of what the recordings hold.

    Raises:
        RecordingError: if one of them has neither labels nor ground truth, or labels
            that cannot be right, as `check_labels` says.
    """
    count = max(1, min(workers, len(paths)))
    jobs = (delayed(trace_file)(path, model, overrides) for path in paths)
    with parallel_config("loky", inner_max_num_threads=1):
        found: Any = Parallel(count, return_as="generator")(jobs)
    yield from found


def trace_file(
    path: Path, model: Model, overrides: Overrides = NO_OVERRIDES
) -> TracedStream:
    """Trace one recording."""
    recording = read_recording(path, overrides)
    check_labels([recording.label_set], needed=True)
    trace = trace_recording(recording, model)
    if not recording.metadata.simulated:
        pairs = [(each.id, step.stamp) for step in trace.steps for each in step.touches]
        touch, stamps = np.array(sorted(pairs), np.int64).reshape(-1, 2).T
        check_labels([match_labels(recording, stamps, touch).label_set])
    return TracedStream(
        path=path,
        subject=recording.metadata.subject or recording.metadata.session,
        seconds=recording.seconds,
        truncated=recording.truncated,
        events=read_true_events(recording),
        trace=trace,
    )


def is_stream(recording: Recording) -> bool:
    """Tell whether a recording is continuous.

    A simulated set of clips is not: seconds are missing between its clips.
    """
    if not recording.metadata.simulated:
        return True
    longest = max((end - start for start, end in recording.runs), default=0)
    return longest >= STREAM_SECONDS * NS_PER_S
