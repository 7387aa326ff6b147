"""This module simulates the module of one patch: its packets, answers and seals."""

import struct
import zlib
from typing import final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.packet import (
    COUNT_TYPE,
    CRC,
    DATA,
    DEVICE_TIME_SPAN,
    MAX_COUNTS,
    MAX_SEALED_COUNTS,
    SCAN_NUMBER_SPAN,
    VERSION_2,
    Echo,
    Hello,
    Request,
    Status,
    encode_packet,
)
from eskin.drivers.sessions import NO_CHALLENGE, SessionSeal, is_sealed, read_seal
from eskin.drivers.timeline import index_taxels
from eskin.skin import Patch

FIRMWARE = "eskin virtual 1"
MAX_RATE = 2**16 - 1
"""Largest nominal rate that a hello can hold [1/s]."""
TEMPERATURE = 2500
"""Temperature that it reports [0.01 degrees Celsius]."""
DATA_START = struct.Struct("<BBHHIHH")
"""Header and fixed part of a data packet at once."""


@final
class VirtualPatch:
    """Simulates a skin module with its own clock, scan numbers and serial number.

    Faults may change all of it but its taxels while it runs. Times named `at` are
    counted from the start of the skin [ns].

    Attributes:
        address: address that it sends under.
        serial_number: serial number of the module that is plugged in.
        absences: number of faults that keep it away; it sends while there is none.
    """

    def __init__(
        self,
        patch: Patch,
        taxels: Int[np.ndarray, "part"],
        rate: float,
        serial_number: int,
        clock_error: float = 0.0,
        offset: float = 0.0,
        version: int = VERSION_2,
        key: bytes | None = None,
    ) -> None:
        """Power up.

        `clock_error` is relative, and positive if too fast [ppm]; `offset` is the time
        since power-up when the skin starts [s]; `rate` is in [1/s]. Without a key
        packets have no seal.
        """
        self.patch = patch
        self.taxels = taxels
        self.place = index_taxels(taxels)
        self.rate = rate
        self.address = patch.address
        self.serial_number = serial_number
        self.us_per_ns = (1.0 + clock_error * 1e-6) / 1000.0
        self.absences = 0
        self.version = version
        self.session = None if key is None else PatchSession(key)
        self.max_counts = MAX_COUNTS if key is None else MAX_SEALED_COUNTS
        self.power_up(0)
        self.offset = round(offset * 1e6)
        self.scan = round(offset * rate) % SCAN_NUMBER_SPAN

    def power_up(self, at: int) -> None:
        """Reset clock and scan number; a hello is sent next."""
        self.power_up_at = at
        self.offset = self.scan = 0
        self.is_new = True
        if self.session is not None:
            self.session.power_up()

    def wrap_in(self, seconds: float, at: int) -> None:
        """Set clock and scan number so that both wrap after some time [s]."""
        until_wrap = (DEVICE_TIME_SPAN - self.device_time(at)) / 1e6
        self.shift_clock(until_wrap - seconds)
        self.scan = round(-seconds * self.rate) % SCAN_NUMBER_SPAN

    def shift_clock(self, seconds: float) -> None:
        """Set the clock forward by a time [s], or back where it is negative."""
        self.offset += round(seconds * 1e6)

    def device_time(self, at: int) -> int:
        """Return the time of its own clock, modulo 2**32 [us]."""
        elapsed = int((at - self.power_up_at) * self.us_per_ns)
        return (elapsed + self.offset) % DEVICE_TIME_SPAN

    @property
    def may_send(self) -> bool:
        """Return whether it may send all packets: one with a key needs a session."""
        return self.session is None or self.session.is_open

    def build_hello(self, at: int) -> bytes:
        """Return a hello."""
        self.is_new = False
        time = self.device_time(at)
        if self.session is not None:
            self.session.expire(time)
        hello = Hello(
            self.address,
            self.scan,
            time,
            rows=self.patch.rows,
            columns=self.patch.columns,
            taxels=len(self.taxels),
            rate=min(round(self.rate), MAX_RATE),
            serial_number=self.serial_number,
            firmware=FIRMWARE,
        )
        return self.seal(encode_packet(hello, self.version))

    def build_hello_and_status(self, at: int) -> list[bytes]:
        """Return the packets that are sent once a second."""
        hello = self.build_hello(at)
        if not self.may_send:
            return [hello]
        numbers = self.address, self.scan, self.device_time(at)
        status = Status(*numbers, skipped=0, errors=0, temperature=TEMPERATURE)
        return [hello, self.seal(encode_packet(status, self.version))]

    def seal(self, packet: bytes) -> bytes:
        """Return a packet with a seal where it has a key."""
        return packet if self.session is None else self.session.close(packet)

    def answer(self, request: Request, data: bytes, at: int) -> list[bytes]:
        """Return the answer to a request, and a hello where it opens a session.

        A request that is not authentic or not new is not answered. `data` is its bytes.
        """
        time = self.device_time(at)
        session = self.session
        if self.version != VERSION_2:
            return []
        if session is not None:
            session.expire(time)
        opens = session is not None and not session.is_open
        if session is not None and not session.admit(request, data, time):
            return []
        echo = self.seal(build_echo(request, self.scan, time, delay=0))
        return [self.build_hello(at), echo] if opens else [echo]

    def measure(
        self,
        counts: Int[np.ndarray, "taxel"],
        received: Bool[np.ndarray, "taxel"],
        at: int,
    ) -> list[bytes]:
        """Return the data packets of its part of a scan, and go to the next scan.

        `counts` of 16 bits are those of the whole skin; those that are not `received`
        are not sent. `at` is in [ns].
        """
        own = counts[self.place].astype(COUNT_TYPE).tobytes()
        time = self.device_time(at)
        packets = []
        runs = split_runs(received[self.place], self.max_counts)
        for first, last in runs if self.may_send else ():
            header = (self.version, DATA, self.address, self.scan, time)
            start = DATA_START.pack(*header, first, last - first)
            body = start + own[2 * first : 2 * last]
            packets.append(self.seal(body + CRC.pack(zlib.crc32(body))))
        self.scan = (self.scan + 1) % SCAN_NUMBER_SPAN
        return packets


def split_runs(received: Bool[np.ndarray, "part"], size: int) -> list[tuple[int, int]]:
    """Return start and end of the runs of valid taxels, each of at most a size."""
    if received.all():
        pieces = [(0, len(received))]
    else:
        edges = np.flatnonzero(np.diff(received, prepend=False, append=False))
        pieces = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    return [
        (first, min(first + size, end))
        for begin, end in pieces
        for first in range(begin, end, size)
    ]


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
        self.number = self.last_received = self.counter = 0

    def expire(self, device_time: int) -> None:
        """End the session when no request has come for 2 s."""
        silence = (device_time - self.last_received) % DEVICE_TIME_SPAN
        if self.is_open and silence > SESSION_TIMEOUT:
            self.is_open = False
            self.seal = self.unopened

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
        self.seal = seal
        self.is_open = True
        self.number = request.number
        self.last_received = device_time
        return True


def build_echo(request: Request, scan: int, device_time: int, delay: int) -> bytes:
    """Return the answer to a request, without a seal.

    `device_time` is that when the request arrived, `delay` the time since then [us].
    """
    echo = Echo(
        request.address, scan, device_time, request.number, request.challenge, delay
    )
    return encode_packet(echo, 2)
