"""This module runs the web server of the page, for this computer only."""

import contextlib
import logging
import os
from urllib.parse import urlsplit

from viser import ViserServer
from viser._messages import ShareUrlDisconnect, ShareUrlRequest
from viser.infra import WebsockClientConnection

from eskin.errors import DeviceError
from eskin.page.port import HOST, free_port

LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
"""Names of this computer in the address of a page."""
POLICY_VIOLATION = 1008
"""WebSocket close code for a violation of policy."""


def open_server(port: int) -> ViserServer:
    """Open a server on a port, or on any free one if it is 0.

    Raises:
        DeviceError: the port is taken.
    """
    port = free_port(port)
    # A browser that opens a connection and drops it needs no log entry.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        server = ViserServer(HOST, port, label="eskin", verbose=False)
    if server.get_port() != port:
        server.stop()
        raise DeviceError(
            f"port {port} of {HOST} is already in use; allowed is a free one; "
            "give another with --port"
        )
    # Tunnels to the outside and connections from pages of other sites are refused.
    for message in (ShareUrlRequest, ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)
    refuse_foreign_pages(server)
    return server


def refuse_foreign_pages(server: ViserServer) -> None:
    """Close connections of pages that were not loaded from this computer."""
    sockets = server._websock_server

    async def check(connection: WebsockClientConnection) -> None:
        live = sockets._live_connections[connection.client_id]
        headers = {} if live.request is None else live.request.headers
        if not is_local(headers.get("Origin")):
            await live.close(
                POLICY_VIOLATION, "only pages of this computer may connect"
            )

    sockets.on_client_connect(check)


def is_local(origin: str | None) -> bool:
    """Return whether a page came from this computer.

    A program sends no origin and counts as local.
    """
    return origin is None or urlsplit(origin).hostname in LOCAL_HOSTS
