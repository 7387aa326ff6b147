"""The port of the page."""

import socket

from eskin.errors import DeviceError

HOST = "127.0.0.1"
"""Nobody else can reach this address: viser would listen on every one."""


def free_port(port: int) -> int:
    """The port itself, or one that is free where it is 0.

    Raises:
        DeviceError: it is taken, or no port.
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
                f"port {port} of {HOST} cannot be had ({error.strerror}); allowed is a "
                "free one; close what uses it or give another with --port"
            ) from error
