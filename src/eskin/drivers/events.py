"""This module describes what happens to a skin while it streams, and collects it."""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Literal, final

from eskin.recording import EventRecord

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
    "damaged",
    "lost",
    "fault",
    "mended",
    "unrecorded",
]


@dataclass(frozen=True)
class Event:
    """Something about the skin or a part of it that people should know."""

    stamp: int
    """When it was noticed [ns since the epoch]."""

    kind: EventKind
    """What happened. `appeared`: a patch is heard for the first time; `silent`: no
    longer; `returned`: again; `replaced`: another module is at its address; `moved`: it
    is heard at another port or network address; `rebooted`: its clock began anew;
    `misfit`: it is not of this skin; `conflict`: two modules share an address; `slow`:
    fewer scans come than it promises; `on_rate`: as many again; `damaged`: packets
    arrive broken; `lost`: scans do not arrive; `fault`: something of the skin is out of
    order; `mended`: no longer; `unrecorded`: recording has stopped, the rest goes
    on."""

    text: str
    """The same as a sentence, with what to do where there is something."""

    patch: str | None = None
    """Its patch, where it is of one."""

    row: int | None = None
    """Row in its patch, where it is of a row or taxel."""

    column: int | None = None
    """Column in its patch, where it is of a column or taxel."""

    taxel: int | None = None
    """Index in the skin, where it is of one taxel."""

    def record(self) -> EventRecord:
        """As a recording keeps it."""
        return EventRecord(**asdict(self))


PAUSE = 10_000_000_000
"""Between two events about the same trouble that goes on [ns]."""
MOST = 1000
"""Events that are kept for whoever asks."""
MOST_TROUBLES = 256


@final
class RepeatedEvent:
    """Something that happens again and again at one place."""

    def __init__(self) -> None:
        """Start without having happened."""
        self.count = 0
        self.told: int | None = None


@final
class EventLog:
    """Keeps events until they are taken; memory is bounded, the oldest go first."""

    def __init__(self) -> None:
        """Start empty."""
        self.events: deque[Event] = deque(maxlen=MOST)
        self.troubles: dict[tuple[EventKind, str, str | None], RepeatedEvent] = {}

    def say(
        self, stamp: int, kind: EventKind, text: str, patch: str | None = None
    ) -> None:
        """Something happened."""
        self.events.append(Event(stamp, kind, text, patch))

    def count(
        self, kind: EventKind, text: str, count: int = 1, patch: str | None = None
    ) -> None:
        """Something happened that may happen often; said at most every 10 s.

        Args:
            kind: of the event.
            text: what happened, to stand behind the number of times.
            count: how often.
            patch: where, if at one.
        """
        key = (kind, text, patch)
        trouble = self.troubles.get(key)
        if trouble is None:
            if len(self.troubles) >= MOST_TROUBLES:
                del self.troubles[next(iter(self.troubles))]
            trouble = self.troubles[key] = RepeatedEvent()
        trouble.count += count

    def poll(self, now: int) -> None:
        """Say what has been counted and is due."""
        for (kind, text, patch), trouble in self.troubles.items():
            due = trouble.told is None or now - trouble.told >= PAUSE
            if trouble.count and due:
                self.say(now, kind, f"{trouble.count} {text}", patch)
                trouble.count, trouble.told = 0, now

    def take(self) -> list[Event]:
        """What has happened since it was last asked."""
        events = list(self.events)
        self.events.clear()
        return events
