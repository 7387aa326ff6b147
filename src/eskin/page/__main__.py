"""The viewer's own process: `python -m eskin.page FD`, started by `eskin.viewer`.

Over the socket FD come a setup, then pictures; back go the port, a word after each
picture that was shown, and orders. It ends with the other end of the socket.
"""

import os
import signal
import sys
from multiprocessing.connection import Connection
from threading import Lock

from eskin.errors import DeviceError
from eskin.page.messages import ORDER, READY, REFUSED, SHOWN, Order, Word
from eskin.page.page import Page
from eskin.page.server import open_server

TICK = 0.01
"""How often touches that are due are sent [s]."""


def main(descriptor: int) -> None:
    """Serve until the other end is closed."""
    # Ctrl-C reaches the whole terminal; when to end, the other end says.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Connection(descriptor) as connection:
        try:
            serve(connection)
        except (EOFError, OSError):
            pass
    # Threads of the server must not keep the process.
    os._exit(0)


def serve(connection: Connection) -> None:
    """Show what comes."""
    lock = Lock()

    def send(kind: Word, value: object = None) -> None:
        with lock:
            connection.send((kind, value))

    def give(order: Order) -> None:
        send(ORDER, order)

    port, setup = connection.recv()
    try:
        server = open_server(port)
    except DeviceError as error:
        send(REFUSED, str(error))
        return
    page = Page(server, setup, give)
    send(READY, server.get_port())
    while True:
        if connection.poll(TICK):
            page.show(connection.recv())
            send(SHOWN)
        page.tick()


if __name__ == "__main__":
    main(int(sys.argv[1]))
