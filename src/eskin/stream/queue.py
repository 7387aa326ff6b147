"""This module provides the bounded queue in front of each listener."""

from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import Literal, final

from eskin.stream.messages import RARE, Message

Drop = Literal["oldest", "newest", "never"]


@dataclass(frozen=True)
class QueueCount:
    """What a queue has counted: given = taken + dropped + waiting, at every moment."""

    given: int
    """What was put in, whether it was kept or not."""
    taken: int
    """What the listener has taken out."""
    dropped: int
    """What the listener will never hear."""
    waiting: int
    """What is in it now."""
    longest: int
    """The most that was ever in it."""


@final
class BoundedQueue:
    """Holds what a listener has still to hear; safe between threads.

    When it is full, the oldest scan or moment goes (`oldest`), or the one that comes is
    not let in (`newest`), or who brings it waits until there is room (`never`). A
    detection or event is only dropped where nothing but such are held.
    """

    def __init__(self, size: int, drop: Drop) -> None:
        """Start empty.

        Args:
            size: how much it holds at most.
            drop: what happens when it is full.
        """
        if size < 1:
            raise ValueError(f"queue of size {size}; allowed is 1 or more; give one")
        self.size = size
        self.drop = drop
        self.items: deque[Message] = deque()
        self.changed = Condition()
        self.ending = False
        self.given = self.taken = self.dropped = self.longest = 0

    def put(self, item: Message) -> None:
        """Bring something; waits for room only where nothing may be dropped."""
        with self.changed:
            self.given += 1
            if self.drop == "never":
                self.changed.wait_for(self.has_room)
            if self.ending or not (self.has_room() or self.make_room(item)):
                self.dropped += 1
                return
            self.items.append(item)
            self.longest = max(self.longest, len(self.items))
            self.changed.notify_all()

    def has_room(self) -> bool:
        """Whether something may enter."""
        return len(self.items) < self.size

    def make_room(self, item: Message) -> bool:
        """Drop what matters less than `item`; false where that is `item` itself."""
        rare = isinstance(item, RARE)
        if self.drop == "newest":
            places = range(self.size - 1, -1, -1) if rare else ()
        else:
            places = range(self.size)
        for place in places:
            if not isinstance(self.items[place], RARE):
                del self.items[place]
                self.dropped += 1
                return True
        if rare and self.drop == "oldest":
            self.items.popleft()
            self.dropped += 1
            return True
        return False

    def take(self) -> Message | None:
        """The next, once there is one; None when no more will come."""
        with self.changed:
            self.changed.wait_for(lambda: self.items or self.ending)
            if not self.items:
                return None
            self.taken += 1
            item = self.items.popleft()
            self.changed.notify_all()
            return item

    def end(self) -> None:
        """Let nothing more in; what is held can still be taken."""
        with self.changed:
            self.ending = True
            self.changed.notify_all()

    def close(self) -> None:
        """Let nothing more in, and drop what is held."""
        with self.changed:
            self.ending = True
            self.dropped += len(self.items)
            self.items.clear()
            self.changed.notify_all()

    def count(self) -> QueueCount:
        """What it has counted so far."""
        with self.changed:
            return QueueCount(
                self.given, self.taken, self.dropped, len(self.items), self.longest
            )
