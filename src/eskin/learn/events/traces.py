"""Traces."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from joblib import Parallel, delayed, parallel_config

from eskin.errors import RecordingError
from eskin.learn.events.matching import ScoredStream
from eskin.learn.events.true_events import TrueEvent, read_true_events
from eskin.live import (
    DecisionFilter,
    Detection,
    Recognizer,
    build_detection,
    compute_probabilities,
)
from eskin.model import DecisionConfig, Model
from eskin.recording import Recording, read_recording
from eskin.robot import load_recorded_robot
from eskin.skin import MountedSkin
from eskin.touch import Touch
from eskin.units import NS_PER_S

ANY_TRAVEL = DecisionConfig(still=float(np.finfo(float).tiny))
"""Keeps the direction of every touch that is not exactly where it began."""


@dataclass(frozen=True, eq=False)
class TraceStep:
    """A reading at which a touch is open or has just closed."""

    stamp: int
    """Of the reading [ns since the epoch]."""

    touches: tuple[Touch, ...]
    """Touches that are open."""

    closed: tuple[Touch, ...]
    """Touches that closed with it."""

    logits: Float[np.ndarray, "touch class"]
    """Of the open touches."""

    directions: Float[np.ndarray, "touch 3"]
    """Unit vectors of the travel of the open touches in the world."""


@dataclass(frozen=True, eq=False)
class Trace:
    """A recording as the decider hears it: all of the recognition but its last step."""

    vocabulary: tuple[str, ...]
    """Classes in the order of the logits."""

    temperature: float
    """Of the model's card."""

    decision: DecisionConfig
    """Of the model's card."""

    change_ends: bool
    """Whether touches end when another class is likelier (see `DecisionFilter`)."""

    moments: tuple[TraceStep, ...]
    """In the order of time; nothing is decided at other readings."""

    def detections(
        self,
        config: DecisionConfig | None = None,
        temperature: float | None = None,
    ) -> list[Detection]:
        """What the recogniser says live with a decision of one's choice.

        Args:
            config: how sure is sure; None takes what comes with the model.
            temperature: in place of that of the model's card.
        """
        config = config or self.decision
        heat = self.temperature if temperature is None else temperature
        decider = DecisionFilter(self.vocabulary, config, self.change_ends)
        directions: dict[int, np.ndarray] = {}
        found: list[Detection] = []
        for moment in self.moments:
            ids = [touch.id for touch in moment.touches]
            directions |= zip(ids, moment.directions, strict=True)
            chances = {
                number: compute_probabilities(logits, heat)
                for number, logits in zip(ids, moment.logits, strict=True)
            }
            verdicts = decider.push(
                moment.stamp, moment.touches, moment.closed, chances
            )
            known = {touch.id: touch for touch in (*moment.touches, *moment.closed)}
            for verdict in verdicts:
                touch = known[verdict.touch]
                gone = np.linalg.norm(touch.travel) >= config.still
                direction = directions[touch.id] if gone else np.zeros(3)
                found.append(build_detection(verdict, touch, moment.stamp, direction))
        return found


def trace_recording(recording: Recording, model: Model) -> Trace:
    """Replay a recording through the recogniser, and keep what it decides upon."""
    mounted = MountedSkin(recording.skin, load_recorded_robot(recording.robot_name))
    recognizer = Recognizer(model, mounted, recording.calibration, ANY_TRAVEL)
    moments: list[TraceStep] = []
    for scan in recording.scans():
        recognizer.push(scan)
        state = recognizer.state
        if state is not None and (state.touches or state.closed_touches):
            moments.append(record_step(recognizer, state.touches, state.closed_touches))
    left = recognizer.touches.finish()
    if left:
        moments.append(record_step(recognizer, (), left))
    return Trace(
        vocabulary=model.card.vocabulary,
        temperature=model.card.temperature,
        decision=model.card.decision,
        change_ends=not mounted.skin.calibrated,
        moments=tuple(moments),
    )


def record_step(
    recognizer: Recognizer, touches: tuple[Touch, ...], closed: tuple[Touch, ...]
) -> TraceStep:
    """What the recogniser knows at the reading that it has just taken."""
    assert recognizer.state is not None
    classes = len(recognizer.model.card.vocabulary)
    keys = [recognizer.graphs.get_key(touch.id) for touch in touches]
    directions = [
        recognizer.directions.compute_direction(touch.id) for touch in touches
    ]
    return TraceStep(
        stamp=recognizer.state.reading.stamp,
        touches=touches,
        closed=closed,
        logits=np.array([recognizer.logits[key] for key in keys]).reshape(-1, classes),
        directions=np.array(directions).reshape(-1, 3),
    )


BREAK = 1.0
"""Time without a reading after which another clip begins [s]."""

STREAM = 10.0
"""Time without a break from which a simulated recording is no clip [s]."""


@dataclass(frozen=True, eq=False)
class TracedStream:
    """A recording's trace, and what really happened in it."""

    path: Path
    """The recording."""

    subject: str
    """Who touched, or the session where that is not known."""

    seconds: float
    """From its first reading to its last [s]."""

    truncated: bool
    """Whether its end is missing."""

    events: tuple[TrueEvent, ...]
    """What really happened."""

    trace: Trace
    """What the decider hears."""

    def take(
        self, config: DecisionConfig | None = None, temperature: float | None = None
    ) -> ScoredStream:
        """What is said with a decision of one's choice, to be scored."""
        detections = self.trace.detections(config, temperature)
        return ScoredStream(self.events, detections, self.seconds, self.subject)


def trace_recordings(
    paths: Sequence[Path], model: Model, workers: int = 1
) -> Iterator[TracedStream]:
    """Trace recordings in their order.

    Args:
        paths: the recordings.
        model: what to recognise with.
        workers: processes that share them; 1 works in this one.

    Raises:
        RecordingError: it is not known what happened in one of them.
    """
    count = max(1, min(workers, len(paths)))
    jobs = (delayed(trace_file)(path, model) for path in paths)
    with parallel_config("loky", inner_max_num_threads=1):
        found: Any = Parallel(count, return_as="generator")(jobs)
    yield from found


def trace_file(path: Path, model: Model) -> TracedStream:
    """Trace one recording."""
    recording = read_recording(path)
    if not recording.labels and not recording.metadata.simulated:
        raise RecordingError(
            f"{path} has no labels; scoring needs them; make some with: "
            f"eskin label {path}"
        )
    return TracedStream(
        path=path,
        subject=recording.metadata.subject or recording.metadata.session,
        seconds=(recording.end - recording.start) / NS_PER_S,
        truncated=recording.truncated,
        events=read_true_events(recording),
        trace=trace_recording(recording, model),
    )


def is_stream(recording: Recording) -> bool:
    """Whether a recording shows all that happened in one go.

    A simulated set of clips does not: seconds are missing between its clips.
    """
    if not recording.metadata.simulated:
        return True
    start = last = recording.start
    for scan in recording.scans():
        start = scan.stamp if scan.stamp - last > BREAK * NS_PER_S else start
        last = scan.stamp
        if last - start >= STREAM * NS_PER_S:
            return True
    return False
