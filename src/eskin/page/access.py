"""This module decides who may open the page: only a browser with the page's link.

The link holds a token. The page sets it as a cookie, and only connections that send
the token or the cookie are accepted, from pages of this server alone. All of this is
checked in the handshake, so no message of anyone else reaches a handler.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from secrets import compare_digest
from typing import Any, final
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

LOCAL_NAMES = ("127.0.0.1", "localhost")
"""Names of this computer in the address of the page."""
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

    def __init__(self, port: int, token: str) -> None:
        """Store port and token of the link."""
        self.token = token.encode()
        self.hosts = {f"{name}:{port}" for name in LOCAL_NAMES}
        self.origins = {f"http://{host}" for host in self.hosts}
        # Cookies are shared by all ports of a computer, so the name tells them apart.
        self.cookie = f"eskin-{port}"

    def find_problem(self, request: Request) -> str | None:
        """Return why a request is refused; None where it is accepted."""
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0] not in self.hosts:
            return "the page is served to this computer only"
        origins = request.headers.get_all("Origin")
        if any(origin not in self.origins for origin in origins):
            return "only the page itself may connect"
        if not any(map(self.is_token, self.find_tokens(request))):
            return "open the page by the link that eskin printed, which holds its token"
        return None

    def is_token(self, text: str) -> bool:
        """Return whether a text is the token, in a time that tells nothing about it."""
        return compare_digest(text.encode("utf-8", "replace"), self.token)

    def find_tokens(self, request: Request) -> Iterator[str]:
        """Yield what a request gives as token, in its query or as cookie."""
        yield from parse_qs(urlsplit(request.path).query).get("token", [])
        for header in request.headers.get_all("Cookie"):
            for part in header.split(";"):
                name, _, value = part.strip().partition("=")
                if name == self.cookie:
                    yield value

    def add_headers(self, response: Response) -> None:
        """Add the cookie, and what else a browser is to heed, to an answer."""
        for name, value in HEADERS.items():
            response.headers[name] = value
        response.headers["Set-Cookie"] = (
            f"{self.cookie}={self.token.decode()}; Path=/; HttpOnly; SameSite=Strict"
        )


@contextmanager
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
            response = process_request(connection, request)
            if response is not None:
                access.add_headers(response)
            return response

        guarded.append(serve(*args, process_request=check, **options))
        return guarded[-1]

    setattr(websockets.asyncio.server, "serve", serve_guarded)  # noqa: B010
    try:
        yield guarded
    finally:
        setattr(websockets.asyncio.server, "serve", serve)  # noqa: B010
