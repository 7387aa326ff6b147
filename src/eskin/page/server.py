"""This module runs the web server of the page, for a browser with its link alone.

The path of the link is a token, and so is that of the page's connection, which viser
derives from it. A cookie would be sent to every port of the computer. Only requests
with the token are accepted, from pages of this server alone. All of this is checked in
the handshake, so no message of anyone else reaches a handler.
"""

import contextlib
import logging
import os
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
from eskin.page.process import HOST, free_port

LOCAL_NAMES = ("127.0.0.1", "localhost")
"""Names of this computer in the address of the page."""
HEADERS = {
    "Cache-Control": "no-store",
    # A page of another site must not show this one, with its own buttons over it.
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
}
"""Headers of the answer to a request for the page."""


LOOK = b"""<script>
  if (matchMedia("(prefers-color-scheme: dark)").matches && !location.search)
    history.replaceState(null, "", "?darkMode");
  let at = null, told = 0;
  addEventListener("pointerdown", (event) => {
    const isScene = event.button === 0 && event.target.dataset?.engine;
    at = isScene ? [event.clientX, event.clientY] : null;
  }, true);
  addEventListener("pointerup", (event) => {
    if (at === null) return;
    const moved = Math.hypot(event.clientX - at[0], event.clientY - at[1]) > 4;
    const key = moved ? "T" : "M";
    clearTimeout(told);
    told = setTimeout(() => document.documentElement.dispatchEvent(
      new KeyboardEvent("keydown", {key, code: "Key" + key, bubbles: true})), 60);
    at = null;
  }, true);
  let audio = null, banner = null, hasArm = false;
  const wake = () => {
    try { (audio ??= new AudioContext()).resume(); } catch { audio = null; }
  };
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, wake, true);
  const sound = () => {
    if (audio?.state !== "running") return;
    [660, 880].forEach((pitch, number) => {
      const tone = audio.createOscillator(), loudness = audio.createGain();
      const begin = audio.currentTime + 0.12 * number;
      tone.frequency.value = pitch;
      loudness.gain.setValueAtTime(0.25, begin);
      loudness.gain.exponentialRampToValueAtTime(0.001, begin + 0.12);
      tone.connect(loudness).connect(audio.destination);
      tone.start(begin);
      tone.stop(begin + 0.12);
    });
  };
  const CLOSED = {
    question: "", hint: "Open the panel to see what the arm asks", left: 0};
  const write = (part, text) => {
    if (part.textContent !== text) part.textContent = text;
  };
  new MutationObserver(() => {
    const asked = document.querySelector("[data-question]");
    const {question, hint, left} = asked?.dataset ?? CLOSED;
    hasArm ||= asked !== null;
    if (!hasArm || !hint) {
      banner?.remove();
      banner = null;
      return;
    }
    if (!banner) {
      banner = document.createElement("div");
      banner.id = "question";
      banner.setAttribute("role", "alert");
      banner.innerHTML = "<b></b><span></span><i></i>";
      document.body.append(banner);
    }
    const [title, text, bar] = banner.children;
    if (question && !title.textContent) sound();
    write(title, question);
    write(text, hint);
    bar.style.width = `${100 * left}%`;
    const box = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
    if (box) Object.assign(banner.style, {left: `${box.x}px`, width: `${box.width}px`});
  }).observe(document, {childList: true, subtree: true});
</script>
<style>
  #question {
    position: fixed; top: 0; left: 0; width: 100%; z-index: 90;
    pointer-events: none;
    box-sizing: border-box; padding: 14px 20px; overflow: hidden;
    font: 600 clamp(20px, 3.2vw, 44px)/1.25 system-ui, sans-serif;
    text-align: center; color: #fff; background: #14405ae6; }
  #question span { display: block; font-size: 0.7em; }
  #question i {
    display: block; height: 12px; margin: 10px auto 0; border-radius: 6px;
    background: #ffc94d; transition: width 0.1s linear; }
  :root { color-scheme: light dark; }
  [data-mantine-color-scheme="light"] { color-scheme: light; }
  [data-mantine-color-scheme="dark"] { color-scheme: dark; }
  canvas[data-engine] {
    background: linear-gradient(
      light-dark(#e0e7f0, #2a313b), light-dark(#fafbfd, #14181d));
  }
  .mantine-Button-root { min-height: 28px; }
  [role="tab"][aria-selected="true"] {
    color: light-dark(#14677a, #5fd0e3) !important; }
  @media (pointer: coarse) { .mantine-Button-root { min-height: 40px; } }
  @media (max-width: 36em) {
    [style*="max-height: 60%"] { width: 100% !important;
      max-height: 44% !important; }
    [style*="max-height: 60%"] [style="width: 20em;"] { width: 100% !important; }
  }
</style>"""
"""What is added to viser's page: it is dark where the browser prefers that; each click
and drag in the scene is told by a key, M or T, so that those beside the skin are
answered too, after 60 ms, because what it hit is told within 50 ms; what the arm asks
is shown across the scene, with a sound where the browser allows one, which is after the
first click or key; the sky is pale or dark; and on a phone the panel is as wide as the
window, and lower."""


@final
class PageAccess:
    """Accepts requests and connections of a page that was opened by its link."""

    def __init__(self, port: int, token: str) -> None:
        """Store port and token of the link."""
        self.token = token.encode()
        self.hosts = {f"{name}:{port}" for name in LOCAL_NAMES}
        self.origins = {f"http://{host}" for host in self.hosts}

    def find_problem(self, request: Request) -> str | None:
        """Return why a request is refused; None where it is accepted."""
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0] not in self.hosts:
            return "the page is served to this computer only"
        origins = request.headers.get_all("Origin")
        if any(origin not in self.origins for origin in origins):
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
                response.body = response.body.replace(b"<head>", b"<head>" + LOOK, 1)
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
