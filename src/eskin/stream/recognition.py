"""This module runs a recogniser, and a report of faults, as one listener."""

from collections.abc import Sequence
from time import perf_counter
from typing import final

from eskin.drivers import Event
from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream.listener import Context, Listener
from eskin.stream.messages import Message, RecognitionState
from eskin.stream.queue import Drop
from eskin.stream.timing import DurationHistogram
from eskin.touch import Fault, Scan

WRONG = {
    "stuck": "is frozen at one count",
    "dead": "is frozen at zero",
    "negative": "counts below zero",
    "saturated": "is at full scale for longer than anybody touches",
    "noisy": "jumps to and fro on its own",
    "row": "is out",
    "column": "is out",
    "patch": "is out or silent",
}


@final
class FaultReporter:
    """Remembers the faults of the last reading; says what is new and what is over."""

    def __init__(self) -> None:
        """Start with a skin in order."""
        self.known: tuple[Fault, ...] = ()

    def push(self, stamp: int, faults: Sequence[Fault]) -> list[Event]:
        """Events of a reading.

        What becomes part of a larger fault, as a taxel whose row goes out, is not over.

        Args:
            stamp: of the reading [ns since the epoch].
            faults: known at it.
        """
        faults = tuple(faults)
        if faults == self.known:
            return []
        before, now = map(places, (self.known, faults))
        self.known = faults
        over = [
            fault
            for place, fault in before.items()
            if place not in now and not any(covers(other, fault) for other in faults)
        ]
        begun = [fault for place, fault in now.items() if place not in before]
        return [
            *(event_of(stamp, fault, over=True) for fault in over),
            *(event_of(stamp, fault, over=False) for fault in begun),
        ]


def found_at_once(last: Event | None, event: Event) -> bool:
    """Whether an event is a fault that was found together with the last one."""
    return (
        last is not None
        and event.kind == last.kind == "fault"
        and event.stamp == last.stamp
    )


def places(faults: Sequence[Fault]) -> dict[tuple[object, ...], Fault]:
    """Faults by what and where they are."""
    return {
        (fault.kind, fault.patch, fault.row, fault.column, fault.taxel): fault
        for fault in faults
    }


def covers(fault: Fault, other: Fault) -> bool:
    """Whether a fault is of a line or patch that another is part of."""
    if fault.patch != other.patch:
        return False
    if fault.kind in ("row", "column"):
        line = "row" if fault.kind == "row" else "column"
        return other.taxel is not None and getattr(fault, line) == getattr(other, line)
    return fault.kind == "patch"


def event_of(stamp: int, fault: Fault, over: bool) -> Event:
    """The event that a fault has come, or is over."""
    what = f"patch '{fault.patch}'"
    if fault.taxel is not None:
        what = f"taxel {fault.taxel} (row {fault.row}, column {fault.column}) of {what}"
    elif fault.row is not None or fault.column is not None:
        number = fault.column if fault.row is None else fault.row
        what = f"{fault.kind} {number} of {what}"
    text = f"{what} {WRONG[fault.kind]} and is left out; check its lines and plug"
    return Event(
        stamp,
        "mended" if over else "fault",
        f"{what} is in order again" if over else text,
        fault.patch,
        fault.row,
        fault.column,
        fault.taxel,
    )


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
    message_types = (Scan,)

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
        self.step = DurationHistogram()
        self.age = DurationHistogram()
        self.faults = FaultReporter()
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

    def on_message(self, item: Message) -> None:
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
                self.context.publish(event)
            moment = RecognitionState(
                state, self.recognizer.probabilities, tuple(detections)
            )
            self.context.publish(moment)

    def close(self) -> None:
        """Close the touches still open."""
        self.tell(self.recognizer.finish())

    def tell(self, detections: list[Detection]) -> None:
        """Tell detections, and count them."""
        self.detections += len(detections)
        for detection in detections:
            self.context.publish(detection)
