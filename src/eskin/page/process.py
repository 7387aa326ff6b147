"""This module starts the page's process and exchanges messages with it."""

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
from typing import TypeGuard, final

import eskin
from eskin.errors import DeviceError
from eskin.page.link import format_link, free_port, make_token
from eskin.page.messages import (
    ORDER,
    READY,
    REFUSED,
    SHOWN,
    CorrectionOrder,
    Order,
    PageOrder,
    PaintOrder,
    SceneDescription,
    TouchOrder,
    ViewUpdate,
)

MAX_IN_FLIGHT = 2
"""Greatest number of updates that are sent and not yet shown."""
MAX_ORDERS = 64
"""Greatest number of orders that wait for execution; further ones are dropped."""
END_TIMEOUT = 3.0
"""Longest time to wait for the end of the process, or of a thread [s]."""

logger = logging.getLogger(__name__)


@final
class PageProcess:
    """Serves the page in a process of its own, without blocking the caller.

    Only the latest update waits until the page has shown those before it, so a stalled
    page skips updates and never shows an old one. The process ends when this one does,
    however that happens.

    Attributes:
        updates: number of updates given.
        shown: number of updates that the page has confirmed as shown.
        dropped: number of orders not executed, because too many waited or the page may
            not send any.
    """

    def __init__(
        self,
        setup: SceneDescription,
        port: int,
        on_order: Callable[[Order], None] | None,
        token: str | None = None,
    ) -> None:
        """Start the process; it serves a second or two later.

        Args:
            setup: description of the scene.
            port: port of 127.0.0.1; 0 for any free one.
            on_order: function called with each order on a thread of its own; None
                accepts no orders.
            token: token of the link that opens the page; None makes one.

        Raises:
            DeviceError: the port is not available.
        """
        port = free_port(port)
        may_order = (
            setup.touchable or setup.calibrates or setup.corrects or setup.paints
        )
        self.on_order = on_order if may_order else None
        self.setup = setup
        self.changed = Condition()
        self.latest: ViewUpdate | None = None
        self.in_flight = self.updates = self.shown = self.dropped = 0
        self.port: int | None = None
        self.token = token or make_token()
        self.failure: str | None = None
        self.ending = False
        self.orders: Queue[Order | None] = Queue(MAX_ORDERS)
        ours, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "eskin.page", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env=build_environment(),
                stdin=subprocess.DEVNULL,
            )
        self.connection = Connection(ours.detach())
        self.threads = [
            Thread(target=run, name=f"eskin page {name}", daemon=True)
            for name, run in (
                ("sender", lambda: self.send((port, self.token, setup))),
                ("receiver", self.receive),
                ("orders", self.execute_orders),
            )
        ]
        for thread in self.threads:
            thread.start()

    def give(self, update: ViewUpdate) -> None:
        """Show an update when the page is ready, unless a later one replaces it."""
        with self.changed:
            self.updates += 1
            before = self.latest
            if before is not None and before.log_entries:
                update = merge_log_entries(update, before)
            self.latest = update
            self.changed.notify_all()

    def wants(self) -> bool:
        """Return whether an update given now would be sent at once."""
        with self.changed:
            return self.port is not None and self.in_flight < MAX_IN_FLIGHT

    def wait_ready(self, timeout: float) -> str:
        """Wait until the page is served and return its link.

        Args:
            timeout: longest time to wait [s].

        Raises:
            DeviceError: the page cannot be served, or is not served in time.
        """
        with self.changed:
            self.changed.wait_for(
                lambda: self.port or self.failure or self.ending, timeout
            )
            if self.port is not None:
                return format_link(self.port, self.token)
        raise DeviceError(
            self.failure
            or f"the page is not served after {timeout:g} s; read what its process "
            "printed, and try again"
        )

    def send(self, first: object) -> None:
        """Send the setup, then updates, until the process is closed."""
        try:
            self.connection.send(first)
            while True:
                with self.changed:
                    self.changed.wait_for(self.may_send)
                    update, self.latest = self.latest, None
                    if self.ending or update is None:
                        return
                    self.in_flight += 1
                self.connection.send(update)
        except OSError:
            self.report_lost()

    def may_send(self) -> bool:
        """Return whether the sender has an update to send, or has to end."""
        can = self.latest is not None and self.in_flight < MAX_IN_FLIGHT
        return self.ending or (can and self.port is not None)

    def receive(self) -> None:
        """Receive the messages of the page until it ends."""
        try:
            while True:
                kind, value = self.connection.recv()
                if kind == ORDER:
                    self.queue_order(value)
                with self.changed:
                    if kind == READY:
                        self.port = value
                    elif kind == REFUSED:
                        self.failure = value
                    elif kind == SHOWN:
                        self.in_flight -= 1
                        self.shown += 1
                    self.changed.notify_all()
        except (EOFError, OSError):
            self.report_lost()

    def queue_order(self, order: object) -> None:
        """Queue an order, if orders are accepted and the queue is not full."""
        if self.on_order is None or not self.is_allowed(order):
            self.dropped += 1
            return
        try:
            self.orders.put_nowait(order)
        except Full:
            self.dropped += 1

    def is_allowed(self, order: object) -> TypeGuard[Order]:
        """Return whether the page may send an order."""
        if isinstance(order, CorrectionOrder):
            return self.setup.corrects
        if isinstance(order, PaintOrder):
            return self.setup.paints
        if isinstance(order, PageOrder):
            return self.setup.touchable or self.setup.calibrates or self.setup.paints
        is_touch = isinstance(order, TouchOrder)
        return is_touch and (self.setup.touchable or self.setup.calibrates)

    def execute_orders(self) -> None:
        """Execute orders one after the other."""
        while (order := self.orders.get()) is not None:
            if self.on_order is None:
                continue
            try:
                self.on_order(order)
            except Exception:
                logger.exception("%s failed", order)

    def report_lost(self) -> None:
        """Log once that the page's process has ended by itself."""
        with self.changed:
            if not self.ending and self.failure is None:
                self.failure = "the page's process has ended; restart to serve it again"
                logger.error("%s", self.failure)
            self.changed.notify_all()

    def close(self) -> None:
        """End the process and wait until it has ended."""
        with self.changed:
            self.ending = True
            self.changed.notify_all()
        self.process.terminate()
        try:
            self.process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            # A process that is stopped by a signal cannot end by itself.
            self.process.kill()
            self.process.wait(END_TIMEOUT)
        self.drop_orders()
        for thread in self.threads:
            thread.join(END_TIMEOUT)
        self.connection.close()

    def drop_orders(self) -> None:
        """Drop the orders that wait, and end the thread that executes them."""
        try:
            while True:
                self.orders.get_nowait()
        except Empty:
            self.orders.put_nowait(None)


def merge_log_entries(update: ViewUpdate, before: ViewUpdate) -> ViewUpdate:
    """Return an update with the log entries of one before it as well."""
    return replace(
        update, log_entries=(*before.log_entries, *update.log_entries)[-MAX_ORDERS:]
    )


def build_environment() -> dict[str, str]:
    """Return the environment of this process, with a path to the same eskin."""
    source = str(Path(eskin.__file__).parents[1])
    paths = [source, *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
