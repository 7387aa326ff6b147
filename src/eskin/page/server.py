"""This module runs the web server of the page, for a browser with its link alone.

The path of the link is a token, and so is that of the page's connection, which viser
derives from it. A cookie would be sent to every port of the computer. Only requests
with the token are accepted, from pages of this server alone. All of this is checked in
the handshake, so no message of anyone else reaches a handler.
"""

import contextlib
import logging
import os
import re
from collections.abc import Iterator
from http import HTTPStatus
from secrets import compare_digest
from typing import Any, final
from urllib.parse import urlsplit

import websockets.asyncio.server
from viser import ViserServer
from viser._messages import ShareUrlDisconnect, ShareUrlRequest
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from eskin.errors import DeviceError
from eskin.page.client import adapt
from eskin.page.process import HOST, free_port

LOCAL_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")
"""Names of this computer in the address of the page, with any port: a tunnel to this
one may have another."""
HEADERS = {
    "Cache-Control": "no-store",
    # A page of another site must not show this one, with its own buttons over it.
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
}
"""Headers of the answer to a request for the page."""


@final
class PageAccess:
    """Accepts requests and connections of a page that was opened by its link."""

    def __init__(self, token: str) -> None:
        """Store the token of the link."""
        self.token = token.encode()

    def find_problem(self, request: Request) -> str | None:
        """Return why a request is refused; None where it is accepted."""
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or not LOCAL_HOST.fullmatch(hosts[0]):
            return (
                "the page is served to this computer only; open it at 127.0.0.1 or "
                "localhost, from another computer through a tunnel"
            )
        origins = request.headers.get_all("Origin")
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return "only the page itself may connect"
        path = urlsplit(request.path).path.strip("/")
        # This comparison takes a time that tells nothing about the token.
        if not compare_digest(path.encode("utf-8", "replace"), self.token):
            return "open the page by the link that eskin printed, which holds its token"
        return None


@contextlib.contextmanager
def guard_servers(access: PageAccess) -> Iterator[list[Any]]:
    """Put the check before every websockets server that is opened inside the block.

    Viser opens its server with `websockets.asyncio.server.serve`, in a thread, and
    passes neither `process_request` nor `origins` on from its caller. So that function
    is replaced while viser's server starts; all that is used of websockets is public.

    Yields:
        The servers with the check, of which there is one once viser's has started.
    """
    serve = websockets.asyncio.server.serve
    guarded: list[Any] = []

    def serve_guarded(*args: Any, process_request: Any, **options: Any) -> Any:  # noqa: ANN401
        def check(connection: ServerConnection, request: Request) -> Response | None:
            problem = access.find_problem(request)
            if problem is not None:
                return connection.respond(HTTPStatus.FORBIDDEN, problem + "\n")
            request.path = "/"
            # An answer that is not compressed can be added to.
            request.headers.pop("Accept-Encoding", None)
            response = process_request(connection, request)
            if response is not None:
                response.headers.update(HEADERS)
                response.body = adapt(response.body)
                response.headers.pop("Content-Length", None)
                response.headers["Content-Length"] = str(len(response.body))
            return response

        guarded.append(serve(*args, process_request=check, **options))
        return guarded[-1]

    setattr(websockets.asyncio.server, "serve", serve_guarded)  # noqa: B010
    try:
        yield guarded
    finally:
        setattr(websockets.asyncio.server, "serve", serve)  # noqa: B010


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
        guard_servers(PageAccess(token)) as guarded,
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
