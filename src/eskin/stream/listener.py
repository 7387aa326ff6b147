"""This module defines the abstract listener of a stream."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from eskin.drivers import Clock, SourceInfo
from eskin.stream.messages import Message
from eskin.stream.queue import Drop
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Context:
    """The stream, as its listeners see it."""

    info: SourceInfo
    """Of the source."""
    clock: Clock
    """That scans are stamped by."""
    tell: Callable[[Message], None]
    """Gives something to every other listener that hears its kind."""

    def age(self, stamp: int) -> float:
        """How long ago that stamp was [s]."""
        return (self.clock.now() - stamp) / NS_PER_S


class Listener(ABC):
    """Hears what streams, one thing after the other, on a thread of its own.

    Attributes:
        name: tells it from the stream's other listeners.
        message_types: kinds of what it is told: `Scan` and `Event` come from the source,
            `RecognitionState` and `Detection` from a `Recognition`.
        size: how much its queue holds.
        drop: what happens when that is full: `oldest` keeps what is fresh, for whom old
            data is of no use; `newest` keeps what is held; `never` makes who tells it
            wait, so that a recording is read no faster than it is heard, while a device
            goes on and counts what it loses.
    """

    name: str
    message_types: tuple[type, ...]
    size: int
    drop: Drop

    @abstractmethod
    def start(self, context: Context) -> None:
        """Make ready, before the first scan is read."""

    @abstractmethod
    def on_message(self, item: Message) -> None:
        """Take one thing in; what it raises stops the whole stream."""

    @abstractmethod
    def close(self) -> None:
        """Let everything go; called once, after the last `hear`, if it was started."""
