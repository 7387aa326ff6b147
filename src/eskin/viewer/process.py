"""The page's process, and the bounded ways to it and back."""

import logging
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, Full, Queue
from threading import Condition, Thread
from typing import final

import eskin
from eskin.errors import DeviceError
from eskin.page import Order, PageOrder, SceneDescription, TouchOrder, ViewUpdate
from eskin.page.messages import ORDER, READY, REFUSED, SHOWN
from eskin.page.port import free_port

MAX_IN_FLIGHT = 2
"""Pictures that may be under way; another is sent when one has been shown."""
MAX_ORDERS = 64
"""Orders that wait to be obeyed; what comes while so many do is dropped."""
PATIENCE = 3.0
"""How long the process has to end [s]."""

logger = logging.getLogger(__name__)


@final
class PageProcess:
    """Serves the page in a process of its own; never makes anybody wait.

    Of pictures the latest is kept until the page has shown those before it, so one that
    is stalled sees fewer, and none that is old. The process ends when this one does,
    however that happens.

    Attributes:
        pictures: that were given.
        shown: that the page says it has shown.
        dropped: orders that were not obeyed: too many, or from a page that may not.
    """

    def __init__(
        self,
        setup: SceneDescription,
        port: int,
        on_order: Callable[[Order], None] | None,
    ) -> None:
        """Start the process; it serves a second or two later.

        Args:
            setup: what the page shows.
            port: of 127.0.0.1; 0 for any free one.
            on_order: is called with each order on a thread of its own; None takes none.

        Raises:
            DeviceError: the port cannot be had.
        """
        port = free_port(port)
        self.on_order = on_order if setup.touchable else None
        self.changed = Condition()
        self.latest: ViewUpdate | None = None
        self.on_the_way = self.pictures = self.shown = self.dropped = 0
        self.port: int | None = None
        self.failure: str | None = None
        self.ending = False
        self.orders: Queue[Order | None] = Queue(MAX_ORDERS)
        ours, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "eskin.page", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env=environment(),
                stdin=subprocess.DEVNULL,
            )
        self.connection = Connection(ours.detach())
        self.threads = [
            Thread(target=run, name=f"eskin page {name}", daemon=True)
            for name, run in (
                ("sender", lambda: self.send((port, setup))),
                ("hearer", self.hear),
                ("orders", self.carry_out),
            )
        ]
        for thread in self.threads:
            thread.start()

    def give(self, picture: ViewUpdate) -> None:
        """Show a picture as soon as the page is ready for it, unless a later one is."""
        with self.changed:
            self.pictures += 1
            before = self.latest
            if before is not None and before.log_entries:
                picture = with_sayings(picture, before)
            self.latest = picture
            self.changed.notify_all()

    def wants(self) -> bool:
        """Whether a picture given now would be on its way at once."""
        with self.changed:
            return self.port is not None and self.on_the_way < MAX_IN_FLIGHT

    def wait_ready(self, timeout: float) -> int:
        """Wait until the page is served; its port.

        Args:
            timeout: how long at most [s].

        Raises:
            DeviceError: it cannot be served, or is not in time.
        """
        with self.changed:
            self.changed.wait_for(
                lambda: self.port or self.failure or self.ending, timeout
            )
            if self.port is not None:
                return self.port
        raise DeviceError(
            self.failure
            or f"the page is not served after {timeout:g} s; allowed is less; look at "
            "what its process printed, and try again"
        )

    def send(self, first: object) -> None:
        """Send the setup, then pictures, until the end."""
        try:
            self.connection.send(first)
            while True:
                with self.changed:
                    self.changed.wait_for(self.may_send)
                    picture, self.latest = self.latest, None
                    if self.ending or picture is None:
                        return
                    self.on_the_way += 1
                self.connection.send(picture)
        except OSError:
            self.lost()

    def may_send(self) -> bool:
        """Whether there is something to do for the sender."""
        can = self.latest is not None and self.on_the_way < MAX_IN_FLIGHT
        return self.ending or (can and self.port is not None)

    def hear(self) -> None:
        """LoadedRecording in what the page says, until it ends."""
        try:
            while True:
                word, value = self.connection.recv()
                if word == ORDER:
                    self.take_order(value)
                with self.changed:
                    if word == READY:
                        self.port = value
                    elif word == REFUSED:
                        self.failure = value
                    elif word == SHOWN:
                        self.on_the_way -= 1
                        self.shown += 1
                    self.changed.notify_all()
        except (EOFError, OSError):
            self.lost()

    def take_order(self, order: object) -> None:
        """Pass an order on, if orders are taken and not too many wait."""
        if self.on_order is None or not isinstance(order, TouchOrder | PageOrder):
            self.dropped += 1
            return
        try:
            self.orders.put_nowait(order)
        except Full:
            self.dropped += 1

    def carry_out(self) -> None:
        """Obey orders one after the other."""
        while (order := self.orders.get()) is not None:
            if self.on_order is None:
                continue
            try:
                self.on_order(order)
            except Exception:
                logger.exception("%s cannot be carried out", order)

    def lost(self) -> None:
        """Say once that the page has ended by itself."""
        with self.changed:
            if not self.ending and self.failure is None:
                self.failure = "the page's process has ended; start anew to see it"
                logger.error("%s", self.failure)
            self.changed.notify_all()

    def close(self) -> None:
        """End the process, and come back when it has ended."""
        with self.changed:
            self.ending = True
            self.changed.notify_all()
        self.process.terminate()
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            # One that is stopped cannot end by itself.
            self.process.kill()
            self.process.wait(PATIENCE)
        self.make_room()
        for thread in self.threads:
            thread.join(PATIENCE)
        self.connection.close()

    def make_room(self) -> None:
        """Drop the orders that wait, and end the thread that obeys."""
        try:
            while True:
                self.orders.get_nowait()
        except Empty:
            self.orders.put_nowait(None)


def with_sayings(picture: ViewUpdate, before: ViewUpdate) -> ViewUpdate:
    """A picture that also says what one before it would have said."""
    return replace(
        picture, log_entries=(*before.log_entries, *picture.log_entries)[-MAX_ORDERS:]
    )


def environment() -> dict[str, str]:
    """This process's, so that the same eskin is found."""
    source = str(Path(eskin.__file__).parents[1])
    paths = [source, *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
