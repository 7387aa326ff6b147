"""This module runs the page's process: `python -m eskin.page FD`.

`eskin.page` starts it. Over the socket FD it receives a scene description, then
updates; it sends back the port, a message after each update shown, and orders. It
ends when the other end of the socket is closed.
"""

import os
import signal
import sys
from multiprocessing.connection import Connection
from threading import Lock

from eskin.errors import DeviceError
from eskin.page.messages import ORDER, READY, REFUSED, SHOWN, MessageKind, Order
from eskin.page.page import Page
from eskin.page.server import open_server

TICK = 0.01
"""Interval between checks for scheduled touches [s]."""


def main(descriptor: int) -> None:
    """Serve the page until the other end of the socket is closed."""
    # Ctrl-C reaches every process of the terminal; the viewer decides when to end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Connection(descriptor) as connection:
        try:
            serve(connection)
        except (EOFError, OSError):
            pass
    # Threads of the server must not keep the process alive.
    os._exit(0)


def serve(connection: Connection) -> None:
    """Serve the page and show each update received over a connection."""
    lock = Lock()

    def send(kind: MessageKind, value: object = None) -> None:
        with lock:
            connection.send((kind, value))

    def send_order(order: Order) -> None:
        send(ORDER, order)

    port, token, setup = connection.recv()
    try:
        server = open_server(port, token)
    except DeviceError as error:
        send(REFUSED, str(error))
        return
    page = Page(server, setup, send_order)
    send(READY, server.get_port())
    while True:
        if connection.poll(TICK):
            page.show(connection.recv())
            send(SHOWN)
        page.tick()


if __name__ == "__main__":
    main(int(sys.argv[1]))
