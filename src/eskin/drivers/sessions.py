"""This module seals packets of version 2 with a pre-shared key, and holds sessions.

A seal stands between the body of a packet and its CRC: the session, a counter, and a
tag, which is the keyed BLAKE2s (RFC 7693) of the session's challenge and all bytes of
the packet before the tag.

In a session the host sends requests, which the patch answers with its clock. With a key
a session also decides which packets are authentic: those with a valid seal under its
challenge and a counter that has not been seen.
"""

import string
import zlib
from collections.abc import Callable, Iterable
from hashlib import blake2s
from hmac import compare_digest
from pathlib import Path
from secrets import token_bytes
from typing import Literal, NamedTuple, final

from eskin.drivers.clock import Clock
from eskin.drivers.module_registry import PacketOutcome, name_authenticated_port
from eskin.drivers.packet import (
    CHALLENGE_BYTES,
    CRC,
    MAX_PACKET_BYTES,
    SEAL,
    SEALED,
    VERSION_2,
    Echo,
    Hello,
    Packet,
    Request,
    encode_packet,
)
from eskin.errors import DeviceError, PacketError
from eskin.files import read_file
from eskin.units import NS_PER_S

KEY_BYTES = 32
"""Size of a key, the largest that BLAKE2s takes."""
MAX_KEY_FILE = 1000
"""Largest size of a file that may hold a key [bytes]."""
TAG_BYTES = 16
"""Size of a tag: a forger who guesses is right once in 2**128 packets."""
NO_CHALLENGE = bytes(CHALLENGE_BYTES)
"""Challenge of a patch that is in no session."""
SESSION_BITS = 16
"""Bits of the session in the number that holds session and counter."""
SEALED_BYTES = SEAL.size + CRC.size
"""Bytes after the body of a packet with a seal."""
TAG_END = -CRC.size
TAG_START = TAG_END - TAG_BYTES
OTHERS_MAY_READ = 0o077
"""Permissions of a key file that nobody but its owner may have."""


@final
class SessionSeal:
    """Seals the packets of one session, and checks the seals of others.

    Attributes:
        session: first two bytes of the challenge, by which packets name the session.
    """

    def __init__(self, key: bytes, challenge: bytes) -> None:
        """Prepare the seals of a key of 32 bytes and a challenge of 16."""
        self.session = read_session(challenge)
        self.start = blake2s(challenge, digest_size=TAG_BYTES, key=key)

    def compute_tag(self, content: bytes) -> bytes:
        """Return the tag of all bytes of a packet before its tag."""
        state = self.start.copy()
        state.update(content)
        return state.digest()

    def close(self, packet: bytes, counter: int) -> bytes:
        """Return a packet of version 2 with a seal.

        Args:
            packet: packet without a seal, as `encode_packet` returns it.
            counter: number that no other packet of this sender has, below 2**48.

        Raises:
            PacketError: the packet is too long with a seal (`length`).
        """
        if len(packet) + SEAL.size > MAX_PACKET_BYTES:
            raise PacketError(
                f"packet has {len(packet)} bytes; allowed with a seal are "
                f"{MAX_PACKET_BYTES - SEAL.size}; send the scan in several packets",
                "length",
            )
        number = self.session | counter << SESSION_BITS
        start = bytes((packet[0], packet[1] | SEALED))
        content = start + packet[2:TAG_END] + number.to_bytes(8, "little")
        content += self.compute_tag(content)
        return content + CRC.pack(zlib.crc32(content))

    def is_valid(self, packet: bytes) -> bool:
        """Return whether a packet with a seal was made with this key and challenge."""
        tag = self.compute_tag(packet[:TAG_START])
        return compare_digest(tag, packet[TAG_START:TAG_END])


def is_sealed(packet: bytes) -> bool:
    """Return whether a decodable packet has a seal, valid or not."""
    return packet[0] == VERSION_2 and packet[1] >= SEALED


def read_session(challenge: bytes) -> int:
    """Return the number by which packets name the session of a challenge."""
    return int.from_bytes(challenge[: SESSION_BITS // 8], "little")


def read_seal(packet: bytes) -> tuple[int, int]:
    """Return session and counter of a packet with a seal, which is not checked."""
    number, _ = SEAL.unpack_from(packet, len(packet) - SEALED_BYTES)
    return number & ((1 << SESSION_BITS) - 1), number >> SESSION_BITS


def read_key(path: Path) -> bytes:
    """Read a key file: 64 hexadecimal digits that only their owner may read.

    Raises:
        DeviceError: the file cannot be read, is open to others or holds no key.
    """
    try:
        mode = path.stat().st_mode
        text = read_file(path, MAX_KEY_FILE).strip()
    except OSError as error:
        raise DeviceError(
            f"key {path} cannot be read ({error.strerror}); allowed is a file of 64 "
            "hexadecimal digits"
        ) from error
    if mode & OTHERS_MAY_READ:
        raise DeviceError(
            f"key {path} has mode {mode & 0o777:03o}, so others may use it; allowed is "
            f"600; run chmod 600 {path}, and make a new key if others have read it"
        )
    digits = string.hexdigits.encode()
    if len(text) != 2 * KEY_BYTES or any(digit not in digits for digit in text):
        raise DeviceError(
            f"key {path} holds {len(text)} bytes that are no key; allowed are 64 "
            "hexadecimal digits; make one with openssl rand -hex 32"
        )
    return bytes.fromhex(text.decode())


REQUEST_INTERVAL = NS_PER_S // 4
"""Time between two requests of a session [ns]."""
CHECK_INTERVAL = NS_PER_S // 50
"""How often it is checked whether requests are due [ns]."""
OPENING_TIMEOUT = 3 * NS_PER_S
"""Time for which an answer to the first request is expected [ns]."""
SESSION_TIMEOUT = 10 * NS_PER_S
"""Silence after which a session is over [ns]."""
MAX_SESSIONS = 8
"""Largest number of sessions with one patch address."""
MAX_AWAITED = 8
"""Largest number of requests of a session whose answer is expected."""
COUNTER_WINDOW = 1024
"""Number of counters that are tracked one by one; packets further back are refused."""
ALL_COUNTERS = (1 << COUNTER_WINDOW) - 1
OPENING = 0
"""Number of the request that opens a session."""

Freshness = Literal["new", "duplicate", "late"]
RandomBytes = Callable[[int], bytes]


@final
class CounterWindow:
    """Tracks which counters of a session were seen, so that no packet counts twice."""

    def __init__(self) -> None:
        """Start without counters."""
        self.highest = -1
        self.seen = 0

    def add_counter(self, counter: int) -> Freshness:
        """Add the counter of an authentic packet; return whether it is new."""
        ahead = counter - self.highest
        if ahead > 0:
            shifted = self.seen << min(ahead, COUNTER_WINDOW)
            self.seen = (shifted | 1) & ALL_COUNTERS
            self.highest = counter
            return "new"
        if -ahead >= COUNTER_WINDOW:
            return "late"
        bit = 1 << -ahead
        if self.seen & bit:
            return "duplicate"
        self.seen |= bit
        return "new"


@final
class Session:
    """Holds one session with a module at a port.

    Attributes:
        port: port or network address that requests are sent to.
        is_open: whether the module has answered.
        is_due: whether the request that opens it is to be sent.
        last_received_at: when a packet of the module was last received [ns].
        trusted_port: port as which authentic packets are assembled; empty before the
            module's first authentic hello.
    """

    def __init__(
        self, address: int, port: str, challenge: bytes, key: bytes | None, now: int
    ) -> None:
        """Prepare a session; the request that opens it is due."""
        self.address = address
        self.port = port
        self.challenge = challenge
        self.seal = None if key is None else SessionSeal(key, challenge)
        self.window = CounterWindow()
        self.is_open = False
        self.is_due = True
        self.last_received_at = self.requested_at = now
        self.number = OPENING
        self.awaited: dict[int, int] = {}
        self.trusted_port = ""

    def is_over(self, now: int) -> bool:
        """Return whether the module has been silent for too long."""
        timeout = SESSION_TIMEOUT if self.is_open else OPENING_TIMEOUT
        return now - self.last_received_at > timeout

    def wants_request(self, now: int) -> bool:
        """Return whether a request is due."""
        if not self.is_open:
            return self.is_due
        return now - self.requested_at >= REQUEST_INTERVAL

    def build_request(self, sent: int) -> bytes:
        """Return the next request, which is sent at a time [ns]."""
        if self.is_open:
            self.number += 1
            self.awaited[self.number] = sent
            if len(self.awaited) > MAX_AWAITED:
                del self.awaited[min(self.awaited)]
        self.is_due = False
        self.requested_at = sent
        request = Request(self.address, self.number, self.challenge)
        packet = encode_packet(request, VERSION_2)
        return packet if self.seal is None else self.seal.close(packet, self.number)


class AuthResult(NamedTuple):
    """A result says whether a packet may be assembled, and as whose."""

    refused: PacketOutcome | None
    """Outcome of a packet that is not assembled; None for one that is."""
    port: str = ""
    """Port as which it is assembled."""
    reason: str = ""
    """Why it is not authentic, as an event tells it; empty for other outcomes."""
    sent: int | None = None
    """When the request was sent that an echo answers [ns]; None for other packets and
    for the answer to the first request, which may have been sent several times."""


@final
class HostSessions:
    """Holds all sessions of a host, and refuses packets that are not authentic.

    Sessions are opened by hellos: one request is sent for each until the module
    answers, so that a forged hello does not make the host send more than it received.

    Attributes:
        key: key that packets must be sealed with; None accepts packets without a seal.
    """

    def __init__(
        self,
        addresses: Iterable[int],
        clock: Clock,
        key: bytes | None = None,
        random: RandomBytes = token_bytes,
    ) -> None:
        """Start without sessions.

        Args:
            addresses: addresses of the skin's patches.
            clock: clock that stamps requests.
            key: key of 32 bytes; None where packets are not authenticated.
            random: returns as many random bytes as asked for.
        """
        self.clock = clock
        self.key = key
        self.random = random
        self.unopened = None if key is None else SessionSeal(key, NO_CHALLENGE)
        self.sessions: dict[int, list[Session]] = {number: [] for number in addresses}
        self.checked_at = 0

    def authenticate(
        self, packet: Packet, data: bytes, arrived: int, port: str
    ) -> AuthResult:
        """Return whether a packet may be assembled.

        Args:
            packet: packet that was decoded.
            data: its bytes.
            arrived: when it arrived [ns].
            port: port or network address that it came from.
        """
        if self.unopened is not None:
            return self.authenticate_sealed(packet, data, arrived, port, self.unopened)
        if is_sealed(data):
            return refuse(port, "sealed with a key; give the host the same key")
        if data[0] == VERSION_2:
            return self.accept_without_key(packet, arrived, port)
        return AuthResult(None, port)

    def accept_without_key(self, packet: Packet, arrived: int, port: str) -> AuthResult:
        """Return the result for a packet of version 2 where there is no key."""
        if isinstance(packet, Hello):
            self.open(packet.address, port, arrived)
        if not isinstance(packet, Echo):
            return AuthResult(None, port)
        session = self.find_place(packet.address, port)
        if session is None or not compare_digest(packet.challenge, session.challenge):
            return AuthResult("late")
        self.confirm(session, arrived)
        return take_echo(session, packet, port)

    def authenticate_sealed(
        self,
        packet: Packet,
        data: bytes,
        arrived: int,
        port: str,
        unopened: SessionSeal,
    ) -> AuthResult:
        """Return the result for a packet where there is a key."""
        if not is_sealed(data):
            return refuse(port, "without a seal; give the patch the key of the host")
        number, counter = read_seal(data)
        if number == unopened.session:
            return self.authenticate_unopened(packet, data, arrived, port, unopened)
        session = self.find_session(packet.address, number)
        if session is None or session.seal is None:
            return refuse(port, "of no open session, which is old, or replayed")
        if not session.seal.is_valid(data):
            return refuse(port, "with a wrong seal; compare the key of patch and host")
        if isinstance(packet, Request):
            return AuthResult("foreign")
        freshness = session.window.add_counter(counter)
        if freshness != "new":
            return AuthResult(freshness)
        return self.take_authentic(session, packet, arrived)

    def authenticate_unopened(
        self,
        packet: Packet,
        data: bytes,
        arrived: int,
        port: str,
        unopened: SessionSeal,
    ) -> AuthResult:
        """Return the result for a packet of a patch that is in no session.

        It may be a replay, so it has no effect but a request to its port.
        """
        if not isinstance(packet, Hello) or not unopened.is_valid(data):
            return refuse(port, "with a wrong seal; compare the key of patch and host")
        if packet.address not in self.sessions:
            return AuthResult(None, port)
        self.open(packet.address, port, arrived)
        return AuthResult("held")

    def take_authentic(
        self, session: Session, packet: Packet, arrived: int
    ) -> AuthResult:
        """Note an authentic packet; return as whose it is assembled."""
        if isinstance(packet, Hello):
            session.trusted_port = name_authenticated_port(packet.serial_number)
        self.confirm(session, arrived)
        if not session.trusted_port:
            return AuthResult("held")
        if isinstance(packet, Echo):
            return take_echo(session, packet, session.trusted_port)
        return AuthResult(None, session.trusted_port)

    def open(self, address: int, port: str, arrived: int) -> None:
        """Let a hello open a session, or ask for the request that opens it again.

        With a key the patch says by the hello that it is in no session: an open one
        goes on beside the new one until that is confirmed, since the hello may be old.
        """
        sessions = self.sessions.get(address)
        if sessions is None:
            return
        for session in sessions:
            if session.port == port and (self.key is None or not session.is_open):
                session.is_due = True
                return
        if len(sessions) >= MAX_SESSIONS:
            sessions.remove(
                min(sessions, key=lambda s: (s.is_open, s.last_received_at))
            )
        challenge = self.draw_challenge(address)
        sessions.append(Session(address, port, challenge, self.key, arrived))

    def draw_challenge(self, address: int) -> bytes:
        """Return a random challenge whose session no other of the address has."""
        taken = {read_session(session.challenge) for session in self.sessions[address]}
        taken.add(read_session(NO_CHALLENGE))
        while True:
            challenge = self.random(CHALLENGE_BYTES)
            if read_session(challenge) not in taken:
                return challenge

    def confirm(self, session: Session, arrived: int) -> None:
        """Note a packet of a session, which ends the previous one of its module."""
        session.last_received_at = arrived
        if session.is_open:
            return
        session.is_open = True
        kept = [
            other
            for other in self.sessions[session.address]
            if other is session or not other.is_open or other.port != session.port
        ]
        self.sessions[session.address] = kept

    def find_place(self, address: int, port: str) -> Session | None:
        """Return the session with the patch of an address at a port."""
        found = self.sessions.get(address, ())
        return next((session for session in found if session.port == port), None)

    def find_session(self, address: int, number: int) -> Session | None:
        """Return the session of an address that packets name by a number."""
        for session in self.sessions.get(address, ()):
            if session.seal is not None and session.seal.session == number:
                return session
        return None

    def take_requests(self, now: int) -> list[tuple[str, bytes]]:
        """Return the requests that are due at a time [ns], with their ports."""
        requests: list[tuple[str, bytes]] = []
        if now - self.checked_at < CHECK_INTERVAL:
            return requests
        self.checked_at = now
        for address, sessions in self.sessions.items():
            for session in sessions:
                if session.wants_request(now):
                    packet = session.build_request(self.clock.now())
                    requests.append((session.port, packet))
            if any(session.is_over(now) for session in sessions):
                kept = [session for session in sessions if not session.is_over(now)]
                self.sessions[address] = kept
        return requests


def take_echo(session: Session, echo: Echo, port: str) -> AuthResult:
    """Return the result for the answer to a request, which is answered only once."""
    sent = session.awaited.pop(echo.number, None)
    if sent is None and echo.number != OPENING:
        return AuthResult("late")
    return AuthResult(None, port, sent=sent)


def refuse(port: str, reason: str) -> AuthResult:
    """Return the result for a packet that is not authentic."""
    return AuthResult("unauthenticated", reason=f"at {port} {reason}")
