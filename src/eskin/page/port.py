"""This module finds a free port for the page."""

import socket

from eskin.errors import DeviceError

HOST = "127.0.0.1"
"""Address of the page, which other computers cannot reach.

By default viser would listen on every address.
"""


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
