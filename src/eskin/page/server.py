"""This module runs the web server of the page, for this computer only."""

import contextlib
import logging
import os

from viser import ViserServer
from viser._messages import ShareUrlDisconnect, ShareUrlRequest

from eskin.errors import DeviceError
from eskin.page.access import PageAccess, guard_servers
from eskin.page.link import HOST, free_port


def open_server(port: int, token: str) -> ViserServer:
    """Open a server that only a browser with the page's link can talk to.

    Args:
        port: port of this computer; any free one if it is 0.
        token: token of the link.

    Raises:
        DeviceError: the port is taken.
    """
    port = free_port(port)
    # A browser that opens a connection and drops it needs no log entry.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with (
        open(os.devnull, "w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        guard_servers(PageAccess(port, token)) as guarded,
    ):
        server = ViserServer(HOST, port, label="eskin", verbose=False)
    if not guarded:
        server.stop()
        raise DeviceError(
            "the page cannot check who opens it with this version of viser; allowed is "
            "viser 1.1; pip install 'viser~=1.1.0'"
        )
    if server.get_port() != port:
        server.stop()
        raise DeviceError(
            f"port {port} of {HOST} is already in use; allowed is a free one; "
            "give another with --port"
        )
    # Tunnels to the outside are refused.
    for message in (ShareUrlRequest, ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)
    return server
