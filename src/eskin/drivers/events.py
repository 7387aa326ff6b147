"""This module describes events of a streaming skin and collects them in a log."""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Literal, final

from eskin.recording import EventRecord
from eskin.units import format_count

REPORT_INTERVAL = 60_000_000_000
"""Shortest time between two events about the same repeated problem [ns]."""
MAX_EVENTS = 1000
"""Largest number of events that are kept until they are taken."""
MAX_REPEATED = 256
"""Largest number of repeated events that are counted apart."""

EventKind = Literal[
    "appeared",
    "silent",
    "returned",
    "replaced",
    "moved",
    "rebooted",
    "misfit",
    "conflict",
    "slow",
    "on_rate",
    "late",
    "in_time",
    "damaged",
    "lost",
    "fault",
    "mended",
    "unrecorded",
    "unauthenticated",
    "unposed",
    "posed",
]


@dataclass(frozen=True)
class Event:
    """An event describes what happened to the skin or a part of it."""

    stamp: int
    """Time at which it was noticed [ns since the epoch]."""
    kind: EventKind
    """What happened. `appeared`: a patch sends for the first time; `silent`: it no
    longer sends; `returned`: it sends again; `replaced`: another module is at its
    address; `moved`: it sends from another port or network address; `rebooted`: its
    clock started over; `misfit`: it is not of this skin; `conflict`: two modules share
    an address; `slow`: fewer scans arrive than its nominal rate; `on_rate`: no longer
    slow; `late`: its packets arrive long after they were made, or their age is not
    known; `in_time`: no longer late; `damaged`: packets arrive broken; `lost`: scans do
    not arrive; `fault`: a taxel, line or patch is faulty; `mended`: no longer;
    `unrecorded`: recording has stopped, the rest goes on; `unauthenticated`: packets
    were refused for their seal, or are used without one; `unposed`: joint positions are
    missing or too old; `posed`: they arrive again."""
    text: str
    """The same as a sentence, with the remedy where there is one."""
    patch: str | None = None
    """Name of the patch, where the event concerns one."""
    row: int | None = None
    """Row in the patch, where the event concerns a row or taxel."""
    column: int | None = None
    """Column in the patch, where the event concerns a column or taxel."""
    taxel: int | None = None
    """Index in the skin, where the event concerns one taxel."""

    def record(self) -> EventRecord:
        """Return the event in the form that recordings store."""
        return EventRecord(**asdict(self))


@dataclass
class RepeatedEvent:
    """Counts an event that happens again and again at one place."""

    count: int = 0
    """Number of times since the last report."""
    reported: int | None = None
    """Time of the last report [ns]; None before the first."""
    detail: str = ""
    """What was seen the last time, and the remedy."""


@final
class EventLog:
    """Keeps events until they are taken; memory is bounded, the oldest go first."""

    def __init__(self) -> None:
        """Start empty."""
        self.events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self.repeated: dict[tuple[EventKind, str, str, str | None], RepeatedEvent] = {}

    def log_event(
        self, stamp: int, kind: EventKind, text: str, patch: str | None = None
    ) -> None:
        """Add an event."""
        self.events.append(Event(stamp, kind, text, patch))

    def count(
        self,
        kind: EventKind,
        noun: str,
        text: str,
        count: int = 1,
        patch: str | None = None,
        detail: str = "",
    ) -> None:
        """Count an event that may happen often; it is reported once a minute at most.

        The report is as `3 packets`, where the noun is `packet`, and the text. Then
        follows the detail of the last time.
        """
        key = (kind, noun, text, patch)
        if key not in self.repeated and len(self.repeated) >= MAX_REPEATED:
            del self.repeated[next(iter(self.repeated))]
        event = self.repeated.setdefault(key, RepeatedEvent())
        event.count += count
        event.detail = detail

    def flush_counts(self, now: int, at_end: bool = False) -> None:
        """Add events for what has been counted and is due; at the end, for all."""
        for (kind, noun, text, patch), event in self.repeated.items():
            is_due = (
                at_end
                or event.reported is None
                or now - event.reported >= REPORT_INTERVAL
            )
            if event.count and is_due:
                counted = format_count(event.count, noun)
                self.log_event(now, kind, f"{counted} {text}{event.detail}", patch)
                event.count = 0
                event.reported = now

    def take(self) -> list[Event]:
        """Return the events since the last call and forget them."""
        events = list(self.events)
        self.events.clear()
        return events
