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
from types import FrameType
from typing import final

from eskin.drivers import Source
from eskin.errors import StreamError
from eskin.stream.listener import BoundedQueue, Context, Listener, Message, QueueCount

POLL_INTERVAL = 0.05
"""Interval at which a waiting thread checks whether to go on [s]."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)
Fail = Callable[[str, BaseException], None]

logger = logging.getLogger(__name__)


@final
class ListenerThread:
    """Runs one listener with its queue on a thread."""

    def __init__(self, listener: Listener, fail: Fail) -> None:
        """Set up queue and thread; `fail` gets what the listener raises."""
        self.listener = listener
        self.title = f"listener '{listener.name}'"
        self.fail = fail
        self.queue = BoundedQueue(listener.size, listener.drop)
        self.thread = Thread(target=self.run, name=f"eskin {self.title}", daemon=True)

    def put(self, item: Message) -> None:
        """Queue a message, if the listener takes its type."""
        if isinstance(item, self.listener.message_types):
            self.queue.put(item)

    def run(self) -> None:
        """Pass messages to the listener until the queue has ended."""
        try:
            while (item := self.queue.take()) is not None:
                self.listener.on_message(item)
        except BaseException as error:
            self.fail(self.title, error)


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on the first SIGINT or SIGTERM; the second kills the process.

    The handlers are restored at the end. Outside the main thread, where Python allows
    no handlers, nothing changes.

    Args:
        stop: a function that returns at once and takes no lock, such as `Stream.stop`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_signal(number: int, frame: FrameType | None) -> None:
        for each in SIGNALS:
            signal.signal(each, signal.SIG_DFL)
        stop()

    previous = {each: signal.signal(each, on_signal) for each in SIGNALS}
    try:
        yield
    finally:
        for each, handler in previous.items():
            signal.signal(each, signal.SIG_DFL if handler is None else handler)


@final
class Stream:
    """Reads a source and publishes its scans to listeners, until it ends or is stopped.

    One thread reads, and one runs for each listener; queues between them are bounded.
    When the source ends, or `stop` is called, the listeners get the messages in their
    queues and are closed one after the other. When the source or a listener raises, no
    more messages are delivered, all are closed, and `wait` and the end of `with` raise
    the error.

    Attributes:
        source: the source that is read; the stream closes it.
        failure: the error that stopped the stream, if any.
    """

    def __init__(
        self, source: Source, listeners: Sequence[Listener], patience: float = 5.0
    ) -> None:
        """Create queues and threads; nothing runs before `with`.

        Args:
            source: the source to read.
            listeners: in the order in which they are started and closed. A listener
                that publishes comes before those that receive its messages.
            patience: time that each listener has to finish when the stream stops [s];
                one that takes longer is abandoned, which is a failure.

        Raises:
            ValueError: two listeners have one name.
        """
        names = [listener.name for listener in listeners]
        if len(set(names)) < len(names):
            raise ValueError(
                f"listeners are called {', '.join(names)}; allowed is each name once"
            )
        self.source = source
        self.title = f"source {source.info.uri}"
        self.patience = patience
        self.workers = tuple(
            ListenerThread(listener, self.fail) for listener in listeners
        )
        self.reader = Thread(target=self.run, name="eskin reader", daemon=True)
        self.stopping = False
        self.failure: StreamError | None = None
        self.failing = Lock()
        self.closing = Lock()
        self.read_all = Flag()
        self.over = Flag()

    def __enter__(self) -> "Stream":
        """Start the listeners, then read."""
        started: list[ListenerThread] = []
        try:
            for worker in self.workers:
                publish = partial(self.publish, worker)
                context = Context(self.source.info, self.source.clock, publish)
                worker.listener.start(context)
                started.append(worker)
        except BaseException:
            for worker in started:
                self.attempt(worker.title, worker.listener.close)
            self.attempt(self.title, self.source.close)
            raise
        for worker in self.workers:
            worker.thread.start()
        self.reader.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Stop and close; raise what stopped the stream, unless the block raises."""
        self.close()
        if kind is None and self.failure is not None:
            raise self.failure

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the stream is over; return whether it is.

        Args:
            timeout: longest wait [s]; None waits without a limit.

        Raises:
            StreamError: the source or a listener failed; everything is closed then.
        """
        until = None if timeout is None else monotonic() + timeout
        while self.failure is None and not self.over.wait(POLL_INTERVAL):
            if until is not None and monotonic() >= until:
                return False
        if self.failure is not None:
            self.close()
            raise self.failure
        return True

    def stop(self) -> None:
        """Stop reading; returns at once, and may be called by a signal handler."""
        self.stopping = True

    def close(self) -> None:
        """Stop, and return when everything is closed."""
        self.stop()
        if not self.read_all.wait(self.patience):
            self.fail(self.find_blocker(), self.timed_out())
            self.finish_all()
        if not self.over.wait(self.patience * (len(self.workers) + 1)):
            self.fail("closing", self.timed_out())

    def queue_counts(self) -> dict[str, QueueCount]:
        """Return the counters of each listener's queue, by the listener's name."""
        return {worker.listener.name: worker.queue.count() for worker in self.workers}

    def run(self) -> None:
        """Read until the end, then close everything."""
        self.attempt(self.title, self.read)
        self.read_all.set()
        self.finish_all()

    def read(self) -> None:
        """Publish scans and events of the source as they arrive."""
        while not (self.stopping or self.source.ended):
            scan = self.source.read(POLL_INTERVAL)
            for event in self.source.take_events():
                self.publish(None, event)
            if scan is not None:
                self.publish(None, scan)
        for event in self.source.take_last_events():
            self.publish(None, event)

    def publish(self, sender: ListenerThread | None, item: Message) -> None:
        """Give a message to all listeners that take its type, except its sender."""
        for worker in self.workers:
            if worker is not sender:
                worker.put(item)

    def finish_all(self) -> None:
        """Finish and close every listener, then the source; only once."""
        if not self.closing.acquire(blocking=False):
            return
        for worker in self.workers:
            self.attempt(worker.title, self.finish, worker)
        self.attempt(self.title, self.source.close)
        self.over.set()

    def finish(self, worker: ListenerThread) -> None:
        """Let a listener process the messages in its queue, then close it."""
        worker.queue.end()
        waited = 0.0
        while worker.thread.is_alive():
            worker.thread.join(POLL_INTERVAL)
            waited += POLL_INTERVAL if self.stopping else 0.0
            if waited > self.patience:
                raise self.timed_out()
        worker.listener.close()

    def attempt(
        self, title: str, action: Callable[..., None], *arguments: object
    ) -> None:
        """Call a function; if it raises, the stream fails."""
        try:
            action(*arguments)
        except BaseException as error:
            self.fail(title, error)

    def fail(self, title: str, error: BaseException) -> None:
        """Stop because of an error; the first one is raised at the end."""
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        failure = StreamError(
            f"{title} failed and the stream has stopped ({reason}); fix it or leave it "
            "out, and start again"
        )
        failure.__cause__ = error
        logger.error("%s", failure)
        with self.failing:
            self.failure = self.failure or failure
        self.stop()
        for worker in self.workers:
            worker.queue.close()

    def find_blocker(self) -> str:
        """Return the title of what blocks the reader: a full queue, or the source."""
        for worker in self.workers:
            if worker.queue.drop == "never" and worker.queue.count().waiting:
                return worker.title
        return self.title

    def timed_out(self) -> TimeoutError:
        """Return the error for something that does not finish in time."""
        return TimeoutError(f"not finished after {self.patience:g} s")
