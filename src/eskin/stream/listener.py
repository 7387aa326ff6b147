"""This module defines listeners, their messages and queues, and times them."""

import math
import sys
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from threading import Condition
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.drivers import Clock, Event, SourceInfo
from eskin.live import Detection
from eskin.reasons import Reason
from eskin.touch import Scan, TouchRecord, TouchState
from eskin.units import NS_PER_S

MAX_CLOSED = 256
"""Largest number of closed touches that a state tells of, with those of dropped ones;
in each state the open ones are listed anew."""


@dataclass(frozen=True, eq=False)
class RecognitionState:
    """What the recogniser knows after one scan; it is published for every scan."""

    state: TouchState
    """The calibrated reading with its faults, contacts and touches."""
    probabilities: dict[int, Float[np.ndarray, "class"]]
    """Calibrated probabilities of the model's vocabulary, for each open touch by id."""
    detections: tuple[Detection, ...]
    """Detections of this scan; each has been published by itself before."""

    def add_closed(self, closed: tuple[TouchRecord, ...]) -> "RecognitionState":
        """Return a state that also tells which touches closed before it."""
        tracking = self.state.tracking
        tracking = tracking._replace(closed=(closed + tracking.closed)[-MAX_CLOSED:])
        return replace(self, state=replace(self.state, tracking=tracking))


@dataclass(frozen=True)
class CommandEvent:
    """A decision that a policy makes about the robot's motion."""

    stamp: int
    """Time of the decision [ns since the epoch]."""
    action: str
    """Action that the decision is about."""
    touch: int | None
    """Id of the touch that led to it; None where a fault did."""
    gesture: str | None
    """Gesture recognised in that touch, if any."""
    accepted: bool
    """Whether the action was carried out."""
    reason: Reason
    """Why it was, or was not."""
    onset: int | None = None
    """First contact of that touch [ns since the epoch]; None without one."""
    patch: str | None = None
    """Patch of its strongest contact; None without one."""
    likeliest: str = ""
    """Likeliest gesture of that touch, where none was recognised; empty otherwise."""

    @property
    def why(self) -> str:
        """The reason, as a person reads it."""
        return str(self.reason)


@dataclass(frozen=True)
class Correction:
    """What a person says that a touch was, to be kept as a label."""

    stamp: int
    """Time of the correction [ns since the epoch]."""
    start: int
    """First contact of the touch [ns since the epoch]."""
    end: int
    """First instant after its last contact [ns since the epoch]."""
    gesture: str
    """Name of the gesture that it was."""


Message = Scan | RecognitionState | Detection | Event | CommandEvent | Correction
"""Scans and recognition states come at the rate of the skin; the others are rare."""

RARE = (Detection, Event, CommandEvent, Correction)
"""Messages that a full queue drops only where it holds no others."""

Drop = Literal["oldest", "newest", "never"]


@dataclass(frozen=True)
class QueueCount:
    """Counters of a queue, for which given = taken + dropped + waiting always holds."""

    given: int
    """Number of messages put in, whether kept or not."""
    taken: int
    """Number of messages that the listener has taken out."""
    dropped: int
    """Number of messages that were dropped."""
    waiting: int
    """Number of messages in the queue now."""
    longest: int
    """Largest number of messages that the queue has held."""


@final
class BoundedQueue:
    """Holds the messages that wait for a listener; it is thread-safe.

    When it is full, it drops its oldest scan or state (`oldest`) or the new one
    (`newest`), or blocks until there is room (`never`). Rare messages are dropped only
    where it holds no others. The touches that closed with a dropped state are told by
    the next one.
    """

    def __init__(self, size: int, drop: Drop) -> None:
        """Create an empty queue with a capacity and a policy for when it is full."""
        if size < 1:
            raise ValueError(f"queue of size {size}; allowed is 1 or more")
        self.size = size
        self.drop = drop
        self.items: deque[Message] = deque()
        self.closed: tuple[TouchRecord, ...] = ()
        self.changed = Condition()
        self.ending = False
        self.given = self.taken = self.dropped = self.longest = 0

    def put(self, item: Message) -> None:
        """Put a message in; wait for room only where nothing may be dropped."""
        with self.changed:
            self.given += 1
            if self.drop == "never":
                self.changed.wait_for(self.has_room)
            if self.ending or not (self.has_room() or self.make_room(item)):
                self.dropped += 1
                if isinstance(item, RecognitionState):
                    closed = self.closed + item.state.tracking.closed
                    self.closed = closed[-MAX_CLOSED:]
                return
            if isinstance(item, RecognitionState) and self.closed:
                item = item.add_closed(self.closed)
                self.closed = ()
            self.items.append(item)
            self.longest = max(self.longest, len(self.items))
            self.changed.notify_all()

    def has_room(self) -> bool:
        """Return whether there is room for a message."""
        return len(self.items) < self.size

    def make_room(self, item: Message) -> bool:
        """Drop a message in favour of `item`; return whether that is allowed."""
        rare = isinstance(item, RARE)
        if self.drop == "newest":
            places = range(self.size - 1, -1, -1) if rare else ()
        else:
            places = range(self.size)
        for place in places:
            if not isinstance(dropped := self.items[place], RARE):
                del self.items[place]
                self.dropped += 1
                self.pass_on_closed(dropped, place)
                return True
        if rare and self.drop == "oldest":
            self.items.popleft()
            self.dropped += 1
            return True
        return False

    def pass_on_closed(self, dropped: Message, place: int) -> None:
        """Let the next state tell which touches closed with one from a place."""
        if not isinstance(dropped, RecognitionState):
            return
        closed = dropped.state.tracking.closed
        for later in range(place, len(self.items) if closed else 0):
            state = self.items[later]
            if isinstance(state, RecognitionState):
                self.items[later] = state.add_closed(closed)
                return
        self.closed = closed + self.closed

    def take(self) -> Message | None:
        """Wait for the next message and return it; None when no more will come."""
        with self.changed:
            self.changed.wait_for(lambda: self.items or self.ending)
            if not self.items:
                return None
            self.taken += 1
            item = self.items.popleft()
            self.changed.notify_all()
            return item

    def end(self) -> None:
        """Accept no more messages; those in the queue can still be taken."""
        with self.changed:
            self.ending = True
            self.changed.notify_all()

    def close(self) -> None:
        """Accept no more messages, and drop those in the queue."""
        with self.changed:
            self.ending = True
            self.dropped += len(self.items)
            self.items.clear()
            self.changed.notify_all()

    def count(self) -> QueueCount:
        """Return the counters so far."""
        with self.changed:
            return QueueCount(
                self.given, self.taken, self.dropped, len(self.items), self.longest
            )


@dataclass(frozen=True)
class Context:
    """What a listener can access of its stream."""

    info: SourceInfo
    """Description of the source."""
    clock: Clock
    """Clock that stamps the scans."""
    publish: Callable[[Message], None]
    """Function that gives a message to every other listener that takes its type."""

    def age(self, stamp: int) -> float:
        """Return how long ago a stamp was [s]."""
        return (self.clock.now() - stamp) / NS_PER_S


class Listener(ABC):
    """Receives the messages of a stream, one at a time, on a thread of its own.

    Attributes:
        name: unique among the listeners of a stream.
        message_types: types of the messages that it receives. The source publishes
            `Scan` and `Event`, a `Recognition` publishes `RecognitionState` and
            `Detection`.
        size: capacity of its queue.
        drop: policy of a full queue. `oldest` drops the oldest message, for listeners
            that need the latest data; `newest` drops the new one; `never` blocks the
            publisher, so that a recording is read no faster than it is processed, while
            a device continues and counts what is lost.
    """

    name: str
    message_types: tuple[type, ...]
    size: int
    drop: Drop

    @abstractmethod
    def start(self, context: Context) -> None:
        """Get ready, before the first scan is read."""

    @abstractmethod
    def on_message(self, item: Message) -> None:
        """Process one message; an exception stops the whole stream."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources; called once, after the last message."""


MIN_DURATION = 1e-6
"""Upper edge of the first bin [s]."""
BIN_RATIO = 1.02
"""Ratio of neighbouring bin edges: a quantile is at most 2 % too long."""
BINS = 1100
"""Number of bins; they reach 2,800 s, and longer durations count in the last."""
SWITCH_INTERVAL = 0.0005
"""Time after which Python switches threads [s]; its default of 5 ms is five readings
at 1 kHz."""


@final
class DurationHistogram:
    """Counts durations in logarithmic bins, which take 9 kB for any number of them.

    Attributes:
        count: number of durations.
        longest: the longest of them [s].
    """

    def __init__(self) -> None:
        """Create an empty histogram."""
        self.bins = np.zeros(BINS, np.int64)
        self.count = 0
        self.longest = 0.0

    def add_duration(self, seconds: float) -> None:
        """Count a duration [s]; one below 1 us counts as 1 us."""
        ratio = max(seconds, MIN_DURATION) / MIN_DURATION
        index = math.ceil(math.log(ratio) / math.log(BIN_RATIO))
        self.bins[min(index, BINS - 1)] += 1
        self.count += 1
        self.longest = max(self.longest, seconds)

    def quantile(self, share: float) -> float:
        """Return a quantile of the durations [s]; 0 where there are none.

        Args:
            share: 0.5 for the median, 0.99 for the 99th percentile.
        """
        sums = np.cumsum(self.bins)
        if not sums[-1]:
            return 0.0
        index = int(np.searchsorted(sums, max(share * sums[-1], 1)))
        edge = MIN_DURATION * BIN_RATIO**index
        return min(edge, max(self.longest, MIN_DURATION))


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let Python switch between threads sooner, inside a `with` block.

    It holds for the whole process, so programs choose it, not the library.
    """
    previous = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(previous)
