"""This module runs a recogniser, and a report of faults, as one listener."""

from time import perf_counter
from typing import final

from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream.faults import FaultReporter
from eskin.stream.listener import (
    Context,
    Drop,
    DurationHistogram,
    Listener,
    Message,
    RecognitionState,
)
from eskin.touch import Scan


@final
class Recognition(Listener):
    """Pushes every scan through a recogniser and publishes what it finds.

    It publishes detections first, then faults that have begun or ended, then the
    recognition state. Touches that are open when the stream ends are closed, and their
    detections published.

    Attributes:
        step: durations of one step of the recogniser.
        age: ages of scans when they have been processed.
        detections: number of detections published.
    """

    name = "recognition"
    message_types = (Scan,)

    def __init__(
        self, recognizer: Recognizer, size: int = 512, drop: Drop = "oldest"
    ) -> None:
        """Wrap a recogniser for the skin of the source, without any scan so far."""
        self.recognizer = recognizer
        self.size = size
        self.drop = drop
        self.step = DurationHistogram()
        self.age = DurationHistogram()
        self.faults = FaultReporter(recognizer.mounted.skin)
        self.detections = 0

    def start(self, context: Context) -> None:
        """Raise a SkinMismatchError if the source has another skin or robot."""
        mounted = self.recognizer.mounted
        info = context.info
        own = mounted.skin.count, tuple(mounted.robot.joint_names)
        given = info.skin.count, info.joint_names
        if own != given:
            raise SkinMismatchError(
                f"source {info.uri} is of skin '{info.skin.name}' with {given[0]} "
                f"taxels and {len(given[1])} joints, the recogniser of "
                f"'{mounted.skin.name}' with {own[0]} and {len(own[1])}; allowed is "
                "one skin and robot; give both the same"
            )
        self.context = context

    def on_message(self, item: Message) -> None:
        """Process one scan."""
        if not isinstance(item, Scan):
            return
        began = perf_counter()
        detections = self.recognizer.push(item)
        self.step.add_duration(perf_counter() - began)
        self.age.add_duration(self.context.age(item.stamp))
        self.publish(detections)
        state = self.recognizer.state
        if state is not None:
            for event in self.faults.report_faults(item.stamp, state.faults):
                self.context.publish(event)
            probabilities = self.recognizer.probabilities
            self.context.publish(
                RecognitionState(state, probabilities, tuple(detections))
            )

    def close(self) -> None:
        """Close the touches that are still open, and tell what is not told yet."""
        self.publish(self.recognizer.finish())
        for event in self.faults.finish():
            self.context.publish(event)

    def publish(self, detections: list[Detection]) -> None:
        """Publish and count detections."""
        self.detections += len(detections)
        for detection in detections:
            self.context.publish(detection)
