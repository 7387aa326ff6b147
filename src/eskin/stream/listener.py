"""What hears a stream: the abstract listener."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from eskin.drivers import Clock, SourceInfo
from eskin.stream.inbox import Drop
from eskin.stream.moment import Heard
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Context:
    """The stream, as its listeners see it."""

    info: SourceInfo
    """Of the source."""
    clock: Clock
    """That scans are stamped by."""
    tell: Callable[[Heard], None]
    """Gives something to every other listener that hears its kind."""

    def age(self, stamp: int) -> float:
        """How long ago that stamp was [s]."""
        return (self.clock.now() - stamp) / NS_PER_S


class Listener(ABC):
    """Hears what streams, one thing after the other, on a thread of its own.

    Attributes:
        name: tells it from the stream's other listeners.
        hears: kinds of what it is told: `Scan` and `Event` come from the source,
            `Moment` and `Detection` from a `Recognition`.
        size: how much its queue holds.
        drop: what happens when that is full: `oldest` keeps what is fresh, for whom old
            data is of no use; `newest` keeps what is held; `never` makes who tells it
            wait, so that a recording is read no faster than it is heard, while a device
            goes on and counts what it loses.
    """

    name: str
    hears: tuple[type, ...]
    size: int
    drop: Drop

    @abstractmethod
    def start(self, context: Context) -> None:
        """Make ready, before the first scan is read."""

    @abstractmethod
    def hear(self, item: Heard) -> None:
        """Take one thing in; what it raises stops the whole stream."""

    @abstractmethod
    def close(self) -> None:
        """Let everything go; called once, after the last `hear`, if it was started."""
