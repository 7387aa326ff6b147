"""This module runs a stream: a source and its listeners, each on its own thread."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Event as Flag
from threading import Lock, Thread
from time import monotonic
from types import FrameType, TracebackType
from typing import final

from eskin.drivers import Source
from eskin.errors import StreamError
from eskin.stream.listener import Context, Listener
from eskin.stream.messages import Message
from eskin.stream.queue import BoundedQueue, QueueCount

Fail = Callable[[str, BaseException], None]


@final
class ListenerThread:
    """Where a listener listens."""

    def __init__(self, listener: Listener, fail: Fail) -> None:
        """Set up queue and thread; nothing runs yet.

        Args:
            listener: who listens.
            fail: is given its title and what it raises.
        """
        self.listener = listener
        self.title = f"listener '{listener.name}'"
        self.fail = fail
        self.inbox = BoundedQueue(listener.size, listener.drop)
        self.thread = Thread(target=self.run, name=f"eskin {self.title}", daemon=True)

    def put(self, item: Message) -> None:
        """Give the listener something, if it hears such."""
        if isinstance(item, self.listener.message_types):
            self.inbox.put(item)

    def run(self) -> None:
        """Listen until no more will come."""
        try:
            while (item := self.inbox.take()) is not None:
                self.listener.on_message(item)
        except BaseException as error:
            self.fail(self.title, error)


SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Inside, the first SIGINT or SIGTERM calls `stop`; the second kills the process.

    Handlers are put back at the end. Outside the main thread, where Python allows no
    handlers, nothing is changed.

    Args:
        stop: returns at once and takes no lock, such as `Stream.stop`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_signal(number: int, frame: FrameType | None) -> None:
        for one in SIGNALS:
            signal.signal(one, signal.SIG_DFL)
        stop()

    before = {one: signal.signal(one, on_signal) for one in SIGNALS}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, signal.SIG_DFL if handler is None else handler)


SLICE = 0.05
"""How often a thread that waits looks whether it should go on [s]."""

logger = logging.getLogger(__name__)


@final
class Stream:
    """Reads a source and gives what comes to listeners, until it ends or is stopped.

    One thread reads, and one runs for each listener; queues between them are bounded.
    When the source ends, or `stop` is called, listeners hear what is held for them and
    are closed one after the other. When the source or a listener raises, nothing more
    is heard, all are closed, and `wait` and the end of `with` raise the error.

    Attributes:
        source: what is read; the stream closes it.
        failure: what stopped the stream, if it had to stop.
    """

    def __init__(
        self, source: Source, listeners: Sequence[Listener], patience: float = 5.0
    ) -> None:
        """Set everything up; nothing runs before `with`.

        Args:
            source: what to read.
            listeners: in the order in which they are started and closed. One that tells
                something comes before those that hear it.
            patience: how long each listener has to finish once the stream is to stop
                [s]; one that hangs for longer is left behind, which is a failure.

        Raises:
            ValueError: two listeners have one name.
        """
        names = [listener.name for listener in listeners]
        if len(set(names)) < len(names):
            raise ValueError(
                f"listeners are called {', '.join(names)}; allowed is each name once; "
                "name them apart"
            )
        self.source = source
        self.title = f"source {source.info.uri}"
        self.patience = patience
        self.posts = tuple(
            ListenerThread(listener, self.fail) for listener in listeners
        )
        self.reader = Thread(target=self.run, name="eskin reader", daemon=True)
        self.stopping = False
        self.failure: StreamError | None = None
        self.failing, self.closing = Lock(), Lock()
        self.read_all, self.over = Flag(), Flag()

    def __enter__(self) -> "Stream":
        """Start the listeners, then read."""
        started: list[ListenerThread] = []
        try:
            for post in self.posts:
                tell = partial(self.tell, post)
                post.listener.start(Context(self.source.info, self.source.clock, tell))
                started.append(post)
        except BaseException:
            for post in started:
                self.attempt(post.title, post.listener.close)
            self.attempt(self.title, self.source.close)
            raise
        for post in self.posts:
            post.thread.start()
        self.reader.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop and close; raise what stopped the stream, unless something else is."""
        self.close()
        if kind is None and self.failure is not None:
            raise self.failure

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the stream is over; whether it is.

        Args:
            timeout: how long at most [s]; None waits for as long as it takes.

        Raises:
            StreamError: the source or a listener failed; everything is closed then.
        """
        until = None if timeout is None else monotonic() + timeout
        while self.failure is None and not self.over.wait(SLICE):
            if until is not None and monotonic() >= until:
                return False
        if self.failure is not None:
            self.close()
            raise self.failure
        return True

    def stop(self) -> None:
        """Read no more; returns at once, and may be called by a signal's handler."""
        self.stopping = True

    def close(self) -> None:
        """Stop, and come back when everything is closed."""
        self.stop()
        if not self.read_all.wait(self.patience):
            self.fail(self.held_up_by(), self.too_late())
            self.finish_all()
        if not self.over.wait(self.patience * (len(self.posts) + 1)):
            self.fail("closing", self.too_late())

    def counted(self) -> dict[str, QueueCount]:
        """What each listener's queue has counted so far."""
        return {post.listener.name: post.inbox.count() for post in self.posts}

    def run(self) -> None:
        """Read, then close everything."""
        self.attempt(self.title, self.read)
        self.read_all.set()
        self.finish_all()

    def read(self) -> None:
        """Tell the listeners what comes, as long as it comes."""
        while not (self.stopping or self.source.ended):
            scan = self.source.read(SLICE)
            for event in self.source.take_events():
                self.tell(None, event)
            if scan is not None:
                self.tell(None, scan)

    def tell(self, teller: ListenerThread | None, item: Message) -> None:
        """Give something to all who hear its kind, but for the one who tells it."""
        for post in self.posts:
            if post is not teller:
                post.put(item)

    def finish_all(self) -> None:
        """Let every listener finish and close it, then the source; once."""
        if not self.closing.acquire(blocking=False):
            return
        for post in self.posts:
            self.attempt(post.title, self.finish, post)
        self.attempt(self.title, self.source.close)
        self.over.set()

    def finish(self, post: ListenerThread) -> None:
        """Let a listener hear what is held for it, then close it."""
        post.inbox.end()
        waited = 0.0
        while post.thread.is_alive():
            post.thread.join(SLICE)
            waited += SLICE if self.stopping else 0.0
            if waited > self.patience:
                raise self.too_late()
        post.listener.close()

    def attempt(
        self, title: str, action: Callable[..., None], *arguments: object
    ) -> None:
        """Do something that makes the stream fail when it raises."""
        try:
            action(*arguments)
        except BaseException as error:
            self.fail(title, error)

    def fail(self, title: str, error: BaseException) -> None:
        """Stop because of an error; the first is the one that is raised."""
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        failure = StreamError(
            f"{title} failed and the stream has stopped ({reason}); mend it or do "
            "without it, and start anew"
        )
        failure.__cause__ = error
        logger.error("%s", failure)
        with self.failing:
            self.failure = self.failure or failure
        self.stop()
        for post in self.posts:
            post.inbox.close()

    def held_up_by(self) -> str:
        """Who keeps the reader from coming back: a full queue, else the source."""
        for post in self.posts:
            if post.inbox.drop == "never" and post.inbox.count().waiting:
                return post.title
        return self.title

    def too_late(self) -> TimeoutError:
        """The error of what does not finish in time."""
        return TimeoutError(f"not finished after {self.patience:g} s")
