"""This module is a patch's half of protocol version 2: requests, answers and seals."""

from typing import final

from eskin.drivers.packet import DEVICE_TIME_SPAN, Echo, Request, encode_packet
from eskin.drivers.sessions import NO_CHALLENGE, SessionSeal, is_sealed, read_seal

OPENING = 0
"""Number of the request that opens a session."""
SESSION_TIMEOUT = 2_000_000
"""Time without requests after which a session is over [us]."""


@final
class PatchSession:
    """Holds the session of one module, whose packets it seals with a key.

    A module sends nothing but hellos until the host has opened a session. Only a
    request that opens one, with the number 0, changes the session, and none does while
    the host of the present one goes on: a request that was recorded earlier does not
    interrupt it.

    Attributes:
        seal: seal of its packets, of no session at first.
        is_open: whether it is in a session.
    """

    def __init__(self, key: bytes) -> None:
        """Power up, in no session."""
        self.key = key
        self.unopened = SessionSeal(key, NO_CHALLENGE)
        self.power_up()

    def power_up(self) -> None:
        """Forget the session, and count packets from 0."""
        self.seal = self.unopened
        self.is_open = False
        self.number = self.heard_at = self.counter = 0

    def expire(self, device_time: int) -> None:
        """End the session when no request has come for 2 s."""
        silence = (device_time - self.heard_at) % DEVICE_TIME_SPAN
        if self.is_open and silence > SESSION_TIMEOUT:
            self.is_open, self.seal = False, self.unopened

    def close(self, packet: bytes) -> bytes:
        """Return a packet of version 2 with the seal of the session."""
        sealed = self.seal.close(packet, self.counter)
        self.counter += 1
        return sealed

    def admit(self, request: Request, data: bytes, device_time: int) -> bool:
        """Return whether a request is authentic and new; let it open a session.

        `expire` was called with the same device time.
        """
        if not is_sealed(data):
            return False
        seal = self.seal
        is_another = read_seal(data)[0] != seal.session
        if is_another:
            if self.is_open or request.number != OPENING:
                return False
            seal = SessionSeal(self.key, request.challenge)
        if not seal.is_valid(data) or seal.session == self.unopened.session:
            return False
        if not is_another and 0 < self.number >= request.number:
            return False
        self.seal, self.is_open, self.number = seal, True, request.number
        self.heard_at = device_time
        return True


def build_echo(request: Request, scan: int, device_time: int, held: int) -> bytes:
    """Return the answer to a request, without a seal.

    Args:
        request: the request.
        scan: number of the latest scan.
        device_time: device time when the request arrived [us].
        held: time since then [us].
    """
    echo = Echo(
        request.address, scan, device_time, request.number, request.challenge, held
    )
    return encode_packet(echo, 2)
