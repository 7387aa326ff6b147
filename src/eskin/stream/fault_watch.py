"""Faults of the skin, told as they come and go."""

from collections.abc import Sequence
from typing import final

from eskin.drivers import Event
from eskin.touch import Fault

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
class FaultWatch:
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


def found_together(last: Event | None, event: Event) -> bool:
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
