"""Traces: what the decider sees of a recording, to be decided upon again and again."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.live import Decider, Detection, Recognizer
from eskin.live.logits import calibrated
from eskin.live.recognizer import detection_of
from eskin.model import DecisionConfig, Model
from eskin.recording import Recording
from eskin.robot import recorded_robot
from eskin.skin import MountedSkin
from eskin.touch import Touch

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
    """Whether touches end when another class is likelier (see `Decider`)."""

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
        decider = Decider(self.vocabulary, config, self.change_ends)
        directions: dict[int, np.ndarray] = {}
        found: list[Detection] = []
        for moment in self.moments:
            ids = [touch.id for touch in moment.touches]
            directions |= zip(ids, moment.directions, strict=True)
            chances = {
                number: calibrated(logits, heat)
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
                found.append(detection_of(verdict, touch, moment.stamp, direction))
        return found


def trace_of(recording: Recording, model: Model) -> Trace:
    """Replay a recording through the recogniser, and keep what it decides upon."""
    mounted = MountedSkin(recording.skin, recorded_robot(recording.robot_name))
    recognizer = Recognizer(model, mounted, recording.calibration, ANY_TRAVEL)
    moments: list[TraceStep] = []
    for scan in recording.scans():
        recognizer.push(scan)
        state = recognizer.state
        if state is not None and (state.touches or state.closed):
            moments.append(moment_of(recognizer, state.touches, state.closed))
    left = recognizer.touches.finish()
    if left:
        moments.append(moment_of(recognizer, (), left))
    return Trace(
        vocabulary=model.card.vocabulary,
        temperature=model.card.temperature,
        decision=model.card.decision,
        change_ends=not mounted.skin.calibrated,
        moments=tuple(moments),
    )


def moment_of(
    recognizer: Recognizer, touches: tuple[Touch, ...], closed: tuple[Touch, ...]
) -> TraceStep:
    """What the recogniser knows at the reading that it has just taken."""
    assert recognizer.state is not None
    classes = len(recognizer.model.card.vocabulary)
    keys = [recognizer.graphs.key_of(touch.id) for touch in touches]
    directions = [recognizer.travel.of(touch.id) for touch in touches]
    return TraceStep(
        stamp=recognizer.state.reading.stamp,
        touches=touches,
        closed=closed,
        logits=np.array([recognizer.logits[key] for key in keys]).reshape(-1, classes),
        directions=np.array(directions).reshape(-1, 3),
    )
