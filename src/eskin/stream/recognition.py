"""This module runs a recogniser, and a report of faults, as one listener."""

from collections.abc import Sequence
from time import perf_counter
from typing import final

from eskin.drivers import Event
from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream.listener import (
    Context,
    Drop,
    DurationHistogram,
    Listener,
    Message,
    RecognitionState,
)
from eskin.touch import Fault, Scan

FAULT_TEXTS = {
    "stuck": "is frozen at one count",
    "dead": "is frozen at zero",
    "negative": "counts below zero",
    "saturated": "is at full scale for longer than anybody touches",
    "noisy": "jumps to and fro on its own",
    "row": "is out",
    "column": "is out",
    "patch": "is out or silent",
}
WAY_TEXTS = {
    "falling": "has counts that fall under pressure; use --falling, or run eskin "
    "calibrate, which finds that by itself: no touch is felt",
    "rising": "has counts that rise under pressure; leave out --falling, or "
    "run eskin calibrate, which finds that by itself: no touch is felt",
}


@final
class FaultReporter:
    """Turns lists of current faults into events of faults that begin and end."""

    def __init__(self) -> None:
        """Start with a skin without faults."""
        self.known: tuple[Fault, ...] = ()

    def push(self, stamp: int, faults: Sequence[Fault]) -> list[Event]:
        """Return the events of a reading with some stamp [ns] and faults.

        A fault that becomes part of a larger one, such as a taxel whose row fails, does
        not count as over.
        """
        faults = tuple(faults)
        if faults == self.known:
            return []
        previous, now = map(faults_by_place, (self.known, faults))
        self.known = faults
        over = [
            fault
            for place, fault in previous.items()
            if place not in now and not any(covers(other, fault) for other in faults)
        ]
        begun = [fault for place, fault in now.items() if place not in previous]
        return [
            *(fault_event(stamp, fault, over=True) for fault in over),
            *(fault_event(stamp, fault, over=False) for fault in begun),
        ]


def found_together(last: Event | None, event: Event) -> bool:
    """Return whether two events are faults found at the same reading."""
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
    """Return whether a fault of a line or patch includes another."""
    if fault.patch != other.patch:
        return False
    if fault.kind in ("row", "column"):
        line = "row" if fault.kind == "row" else "column"
        return other.taxel is not None and getattr(fault, line) == getattr(other, line)
    return fault.kind == "patch"


def describe_way(faults: Sequence[Fault]) -> str:
    """Describe that counts go another way under pressure; empty where they do not."""
    texts = [
        f"patch '{fault.patch}' {WAY_TEXTS[fault.kind]}"
        for fault in faults
        if fault.kind in WAY_TEXTS
    ]
    return "".join(texts[:1])


def fault_event(stamp: int, fault: Fault, over: bool) -> Event:
    """Return the event of a fault that has begun, or is over."""
    what = f"patch '{fault.patch}'"
    if fault.taxel is not None:
        what = f"taxel {fault.taxel} (row {fault.row}, column {fault.column}) of {what}"
    elif fault.row is not None or fault.column is not None:
        number = fault.column if fault.row is None else fault.row
        what = f"{fault.kind} {number} of {what}"
    text = describe_way((fault,))
    if not text:
        found = FAULT_TEXTS[fault.kind]
        text = f"{what} {found} and is left out; check its lines and plug"
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
        self.faults = FaultReporter()
        self.detections = 0

    def start(self, context: Context) -> None:
        """Raise a SkinMismatchError if the source has another skin or robot."""
        mounted, info = self.recognizer.mounted, context.info
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
        self.step.add(perf_counter() - began)
        self.age.add(self.context.age(item.stamp))
        self.publish(detections)
        state = self.recognizer.state
        if state is not None:
            for event in self.faults.push(item.stamp, state.faults):
                self.context.publish(event)
            probabilities = self.recognizer.probabilities
            self.context.publish(
                RecognitionState(state, probabilities, tuple(detections))
            )

    def close(self) -> None:
        """Close the touches that are still open."""
        self.publish(self.recognizer.finish())

    def publish(self, detections: list[Detection]) -> None:
        """Publish and count detections."""
        self.detections += len(detections)
        for detection in detections:
            self.context.publish(detection)
