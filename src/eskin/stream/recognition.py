"""This module runs a recogniser, and a report of faults, as one listener."""

from collections.abc import Sequence
from time import perf_counter
from typing import final

from eskin.drivers import Event
from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream.listener import Context, Drop, Listener, Message, RecognitionState
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
    """Turns the list of current faults into events as faults come and go."""

    def __init__(self) -> None:
        """Start with a skin without faults."""
        self.known: tuple[Fault, ...] = ()

    def push(self, stamp: int, faults: Sequence[Fault]) -> list[Event]:
        """Return the events of a reading.

        A fault that becomes part of a larger one, as a taxel whose row goes out, does
        not count as over.

        Args:
            stamp: stamp of the reading [ns since the epoch].
            faults: faults known at that reading.
        """
        faults = tuple(faults)
        if faults == self.known:
            return []
        before, now = map(faults_by_place, (self.known, faults))
        self.known = faults
        over = [
            fault
            for place, fault in before.items()
            if place not in now and not any(covers(other, fault) for other in faults)
        ]
        begun = [fault for place, fault in now.items() if place not in before]
        return [
            *(fault_event(stamp, fault, over=True) for fault in over),
            *(fault_event(stamp, fault, over=False) for fault in begun),
        ]


def found_at_once(last: Event | None, event: Event) -> bool:
    """Tell whether an event is a fault found at the same reading as the last one."""
    return (
        last is not None
        and event.kind == last.kind == "fault"
        and event.stamp == last.stamp
    )


def faults_by_place(faults: Sequence[Fault]) -> dict[tuple[object, ...], Fault]:
    """Return faults keyed by kind and place."""
    return {
        (fault.kind, fault.patch, fault.row, fault.column, fault.taxel): fault
        for fault in faults
    }


def covers(fault: Fault, other: Fault) -> bool:
    """Tell whether a fault of a line or patch includes another."""
    if fault.patch != other.patch:
        return False
    if fault.kind in ("row", "column"):
        line = "row" if fault.kind == "row" else "column"
        return other.taxel is not None and getattr(fault, line) == getattr(other, line)
    return fault.kind == "patch"


def fault_event(stamp: int, fault: Fault, over: bool) -> Event:
    """Return the event that a fault has come, or is over."""
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
    """Pushes every scan through a recogniser and publishes what it finds.

    It publishes detections first, then faults that have come or gone, then the
    recognition state. Touches still open when the stream ends are closed, and their
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
        """Wrap a recogniser that has got no scan yet.

        Args:
            recognizer: a recogniser for the skin of the source.
            size: capacity of the queue of scans.
            drop: policy of a full queue; live, fresh scans count most.
        """
        self.recognizer = recognizer
        self.size = size
        self.drop = drop
        self.step = DurationHistogram()
        self.age = DurationHistogram()
        self.faults = FaultReporter()
        self.detections = 0

    def start(self, context: Context) -> None:
        """Check that the source has the recogniser's skin.

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
        """Process one scan."""
        if not isinstance(item, Scan):
            return
        began = perf_counter()
        detections = self.recognizer.push(item)
        self.step.add(perf_counter() - began)
        self.age.add(self.context.age(item.stamp))
        self.publish(detections)
        state = self.recognizer.state
        if state is not None:
            for event in self.faults.push(item.stamp, state.faults):
                self.context.publish(event)
            moment = RecognitionState(
                state, self.recognizer.probabilities, tuple(detections)
            )
            self.context.publish(moment)

    def close(self) -> None:
        """Close the touches that are still open."""
        self.publish(self.recognizer.finish())

    def publish(self, detections: list[Detection]) -> None:
        """Publish and count detections."""
        self.detections += len(detections)
        for detection in detections:
            self.context.publish(detection)
