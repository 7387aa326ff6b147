"""This module starts the page's process, makes its link, and talks to it."""

import logging
import os
import secrets
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, Queue
from threading import Condition, Event, Thread
from typing import final

from eskin.errors import DeviceError
from eskin.page.messages import (
    CorrectionOrder,
    Order,
    PageOrder,
    PaintOrder,
    SceneDescription,
    TouchOrder,
    ViewUpdate,
)

HOST = "127.0.0.1"
"""Address of the page, which other computers cannot reach.

By default viser would listen on every address.
"""

DEFAULT_PORT = 8080
"""TCP port of the page where no other is asked for."""
TOKEN_BYTES = 24
"""Size of a token, which nobody can guess [bytes]."""


def make_token() -> str:
    """Make a token: who has it may open the page, so it is printed and never kept."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def format_link(port: int, token: str) -> str:
    """Return the link that opens the page at a port of this computer."""
    return f"http://{HOST}:{port}/{token}/"


def describe_link(link: str) -> str:
    """Return what a person does with a link, which stands alone on the last line."""
    return f"open this page in a browser on this computer:\n{link}"


def free_port(port: int) -> int:
    """Return the port itself, or a free one where it is 0.

    Raises:
        DeviceError: the port is taken, or out of range.
    """
    if not 0 <= port < 65536:
        raise DeviceError(f"port is {port}; allowed are 1 to 65535, or 0 for any")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
            return probe.getsockname()[1]
        except OSError as error:
            raise DeviceError(
                f"port {port} of {HOST} is not available ({error.strerror}); allowed "
                "is a free one; close what uses it or give another with --port"
            ) from error


MAX_IN_FLIGHT = 2
"""Greatest number of updates that are sent and not yet shown."""
MAX_ORDERS = 64
"""Greatest number of orders that wait for execution; further ones are dropped."""
END_TIMEOUT = 3.0
"""Longest time to wait for the end of the process, or of a thread [s]."""
FLAG_TICK = 0.1
"""Interval between checks for the end of the process [s]."""

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
        self.on_order = on_order
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
                # Ctrl-C is for this process, which decides when the page ends.
                process_group=0,
            )
        self.connection = Connection(ours.detach())
        first = port, self.token, setup
        self.threads = []
        for run in (lambda: self.send(first), self.receive, self.execute_orders):
            self.threads.append(Thread(target=run, name="eskin page", daemon=True))
            self.threads[-1].start()

    def give(self, update: ViewUpdate) -> None:
        """Show an update when the page is ready, unless a later one replaces it."""
        with self.changed:
            self.updates += 1
            if self.latest is not None:
                entries = (*self.latest.log_entries, *update.log_entries)
                update = replace(update, log_entries=entries[-MAX_ORDERS:])
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
                    update = self.latest
                    self.latest = None
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
                if kind == "order":
                    self.queue_order(value)
                with self.changed:
                    if kind == "ready":
                        self.port = value
                    elif kind == "refused":
                        self.failure = value
                    elif kind == "shown":
                        self.in_flight -= 1
                        self.shown += 1
                    self.changed.notify_all()
        except (EOFError, OSError):
            self.report_lost()

    def queue_order(self, order: Order) -> None:
        """Queue an order, if orders are accepted and the queue is not full."""
        setup = self.setup
        touches = setup.touchable or setup.calibrates
        allowed = {
            CorrectionOrder: setup.corrects,
            PaintOrder: setup.paints,
            PageOrder: touches or setup.paints,
            TouchOrder: touches,
        }
        may_send = self.on_order is not None and allowed.get(type(order), False)
        if may_send and not self.orders.full():
            self.orders.put_nowait(order)
        else:
            self.dropped += 1

    def execute_orders(self) -> None:
        """Execute orders one after the other."""
        while (order := self.orders.get()) is not None and self.on_order is not None:
            try:
                self.on_order(order)
            except Exception:
                logger.exception("%s failed", order)

    def wait_for(self, flag: Event) -> None:
        """Wait until a flag is set, or the process has ended by itself."""
        while self.failure is None and not flag.wait(FLAG_TICK):
            pass

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
        # Orders that wait are dropped; None ends the thread that executes them.
        with suppress(Empty):
            while True:
                self.orders.get_nowait()
        self.orders.put_nowait(None)
        for thread in self.threads:
            thread.join(END_TIMEOUT)
        self.connection.close()


def build_environment() -> dict[str, str]:
    """Return the environment of this process, with a path to the same eskin."""
    source = str(Path(__file__).parents[2])
    paths = [source, *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
