"""Events until somebody takes them; those that repeat are summed up."""

from collections import deque
from typing import final

from eskin.drivers.event import Event, EventKind

PAUSE = 10_000_000_000
"""Between two events about the same trouble that goes on [ns]."""
MOST = 1000
"""Events that are kept for whoever asks."""
MOST_TROUBLES = 256


@final
class Trouble:
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
        self.troubles: dict[tuple[EventKind, str, str | None], Trouble] = {}

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
            trouble = self.troubles[key] = Trouble()
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
