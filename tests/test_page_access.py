"""Tests of who may open the page: only a browser that came by its link."""

import logging
import re
import socket
import time
import urllib.error
import urllib.request

import msgspec
import pytest
import viser
from viser._messages import GuiUpdateMessage
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from eskin.page.process import format_link, make_token
from eskin.page.server import PageAccess, open_server

TOKEN = make_token()
TRIES = 50


@pytest.fixture(scope="module")
def server():
    server = open_server(0, TOKEN)
    yield server
    server.stop()


@pytest.fixture
def clicks(server):
    """Return a message that presses a button, and those that reached its handler."""
    pressed = []

    def handle(client, message):
        pressed.append(message)

    sockets = server._websock_server
    sockets.register_handler(GuiUpdateMessage, handle)
    message = GuiUpdateMessage("button", {"value": True})
    yield msgspec.msgpack.encode(message.as_serializable_dict()), pressed
    sockets.unregister_handler(GuiUpdateMessage, handle)


def open_socket(server, path="", origin=None, headers=None, host=None):
    """Connect to the server, as a tunnel does where another host is given."""
    own = "127.0.0.1", server.get_port()
    return connect(
        f"ws://{host or f'{own[0]}:{own[1]}'}/{path}",
        sock=socket.create_connection(own),
        origin=origin,
        additional_headers=headers,
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
        compression=None,
    )


def own_origin(server, port=None):
    return f"http://127.0.0.1:{port or server.get_port()}"


def press(server, message, **request):
    """Connect and press the button at once; return whether it was connected."""
    try:
        with open_socket(server, **request) as socket:
            socket.send(message)
            socket.recv(timeout=10)
        return True
    except InvalidStatus as error:
        assert error.response.status_code == 403
        return False


def becomes(pressed, count):
    """Wait until a number of messages has been handled, which may be after a close."""
    for _ in range(1000):
        if len(pressed) == count:
            return True
        time.sleep(0.01)
    return False


def list_strangers(server):
    token = f"{TOKEN}/"
    cookie = f"eskin-{server.get_port()}={TOKEN}"
    origin = own_origin(server)
    return {
        "foreign origin": {"path": token, "origin": "http://evil.example"},
        "no origin of a file": {"path": token, "origin": "null"},
        "longer name": {"path": token, "origin": f"{origin}.evil.example"},
        "wrong port": {"path": token, "origin": own_origin(server, 9)},
        "no port": {"path": token, "origin": "http://127.0.0.1"},
        "other name": {
            "path": token,
            "origin": origin.replace("127.0.0.1", "localhost"),
        },
        "page at the port of a tunnel": {
            "path": token,
            "origin": origin,
            "host": "127.0.0.1:9",
        },
        "name that was bound anew": {
            "path": token,
            "origin": "http://evil.example:9",
            "host": "evil.example:9",
        },
        "other scheme": {"path": token, "origin": origin.replace("http", "https")},
        "no token": {"origin": origin},
        "wrong token": {"path": make_token(), "origin": origin},
        "longer token": {"path": f"{TOKEN}x", "origin": origin},
        "token in a query": {"path": f"?token={TOKEN}", "origin": origin},
        "token as a cookie": {"headers": {"Cookie": cookie}},
        "program without token": {},
    }


def test_messages_of_strangers_reach_no_handler(server, clicks):
    message, pressed = clicks
    strangers = list(list_strangers(server).values())
    for number in range(TRIES):
        assert not press(server, message, **strangers[number % len(strangers)])
    assert not pressed
    assert press(server, message, path=TOKEN, origin=own_origin(server))
    assert becomes(pressed, 1)


def load(server, path="", **headers):
    """Load the page; return status, headers and text."""
    request = urllib.request.Request(own_origin(server) + f"/{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def test_page_opened_by_its_link_may_connect_and_reload(server, clicks):
    message, pressed = clicks
    port = server.get_port()
    link = format_link(port, TOKEN)
    status, headers, text = load(server, link.partition(f":{port}/")[2])
    assert status == 200 and b"<html" in text
    # A cookie would be sent to the servers of all ports.
    assert "Set-Cookie" not in headers and "frame-ancestors" in str(headers)
    hosts = [f"{name}:{port}" for name in ("127.0.0.1", "localhost")]
    # Tunnels have another port of this computer, or the usual one.
    hosts += ["127.0.0.1:9", "localhost:9", "[::1]:9", "localhost"]
    for host in hosts:
        assert load(server, f"{TOKEN}/", Host=host)[0] == 200
        origin = f"http://{host}"
        assert press(server, message, path=TOKEN, origin=origin, host=host)
    assert becomes(pressed, len(hosts))


@pytest.mark.parametrize("path", ["", "no/", "index.html", "?a=%ff", "?token={}"])
def test_page_without_token_is_refused_and_says_what_to_do(server, path):
    status, _, text = load(server, path.format(TOKEN))
    assert status == 403
    assert b"link that eskin printed" in text
    assert TOKEN.encode() not in text


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:9",
        "192.168.0.9:9",
        "localhost.evil.example",
        "127.0.0.1.evil.example:9",
        "127.0.0.1:9:9",
        "evil@127.0.0.1",
        "0.0.0.0:9",
    ],
)
def test_name_of_another_computer_is_refused(server, host):
    """As a name that first leads to a site, then to this computer, would be."""
    status, _, text = load(server, f"{TOKEN}/", Host=host)
    assert status == 403 and b"through a tunnel" in text


def test_page_has_the_title_of_eskin_and_works_without_a_scene(server):
    page = load(server, f"{TOKEN}/")[2]
    assert re.findall(rb"<title>(.*?)</title>", page) == [b"eskin"]
    # The browser is looked at before viser's own script runs.
    assert page.index(b"this browser has no WebGL") < page.index(b"<title>")


def test_token_is_long_new_and_in_no_log(caplog):
    assert len(TOKEN) >= 32
    assert TOKEN != make_token()
    with caplog.at_level(logging.DEBUG):
        assert TOKEN not in repr(PageAccess(TOKEN)) + caplog.text
