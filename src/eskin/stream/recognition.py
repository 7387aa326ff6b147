"""The recogniser as a listener."""

from time import perf_counter
from typing import final

from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream.durations import Durations
from eskin.stream.fault_watch import FaultWatch
from eskin.stream.inbox import Drop
from eskin.stream.listener import Context, Listener
from eskin.stream.moment import Heard, Moment
from eskin.touch import Scan


@final
class Recognition(Listener):
    """Pushes every scan through a recogniser and tells what it finds.

    Each detection is told first, then faults that have come or gone, then the moment.
    Touches still open when the stream ends are closed and their detections told too.

    Attributes:
        step: how long one scan takes.
        age: how old a scan is once all is said of it.
        detections: how many were told.
    """

    name = "recognition"
    hears = (Scan,)

    def __init__(
        self, recognizer: Recognizer, size: int = 512, drop: Drop = "oldest"
    ) -> None:
        """Listen with a recogniser that has heard nothing yet.

        Args:
            recognizer: of the skin that the source is of.
            size: scans that may wait.
            drop: what happens when more wait; live, fresh scans count most.
        """
        self.recognizer = recognizer
        self.size = size
        self.drop = drop
        self.step = Durations()
        self.age = Durations()
        self.faults = FaultWatch()
        self.detections = 0

    def start(self, context: Context) -> None:
        """Refuse a source of another skin.

        Raises:
            SkinMismatchError: the recogniser is for another skin or robot.
        """
        mounted, info = self.recognizer.mounted, context.info
        ours = mounted.skin.count, tuple(mounted.robot.joint_names)
        theirs = info.skin.count, info.joint_names
        if ours != theirs:
            raise SkinMismatchError(
                f"source {info.uri} is of skin '{info.skin.name}' with {theirs[0]} "
                f"taxels and {len(theirs[1])} joints, the recogniser of "
                f"'{mounted.skin.name}' with {ours[0]} and {len(ours[1])}; allowed is "
                "one skin and robot; give both the same"
            )
        self.context = context

    def hear(self, item: Heard) -> None:
        """Recognise one scan."""
        if not isinstance(item, Scan):
            return
        began = perf_counter()
        detections = self.recognizer.push(item)
        self.step.add(perf_counter() - began)
        self.age.add(self.context.age(item.stamp))
        self.tell(detections)
        state = self.recognizer.state
        if state is not None:
            for event in self.faults.push(item.stamp, state.faults):
                self.context.tell(event)
            moment = Moment(state, self.recognizer.probabilities, tuple(detections))
            self.context.tell(moment)

    def close(self) -> None:
        """Close the touches still open."""
        self.tell(self.recognizer.finish())

    def tell(self, detections: list[Detection]) -> None:
        """Tell detections, and count them."""
        self.detections += len(detections)
        for detection in detections:
            self.context.tell(detection)
