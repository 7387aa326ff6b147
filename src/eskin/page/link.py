"""This module finds a free port for the page, and makes the link that opens it."""

import secrets
import socket

from eskin.errors import DeviceError

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
    return f"http://{HOST}:{port}/?token={token}"


def free_port(port: int) -> int:
    """Return the port itself, or a free one where it is 0.

    Raises:
        DeviceError: the port is taken, or out of range.
    """
    if not 0 <= port < 65536:
        raise DeviceError(
            f"port is {port}; allowed are 1 to 65535, or 0 for any; change --port"
        )
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
