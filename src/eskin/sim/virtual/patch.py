"""This module simulates the module of one patch, which sends packets."""

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
    Hello,
    Request,
    Status,
    encode_packet,
)
from eskin.drivers.timeline import index_taxels
from eskin.sim.virtual.session import PatchSession, build_echo
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
        away: number of faults that keep it away; it sends while there is none.
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

        Args:
            patch: patch that it belongs to.
            taxels: taxels of that patch, as indices of the skin.
            rate: scan rate [1/s].
            serial_number: serial number of the module.
            clock_error: relative error of its clock; positive is too fast [ppm].
            offset: time since power-up when the skin starts [s].
            version: version of the protocol, 1 or 2.
            key: key that seals its packets; None sends them without a seal.
        """
        self.patch = patch
        self.taxels = taxels
        self.place = index_taxels(taxels)
        self.rate = rate
        self.address = patch.address
        self.serial_number = serial_number
        self.us_per_ns = (1.0 + clock_error * 1e-6) / 1000.0
        self.away = 0
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
        time, session = self.device_time(at), self.session
        if self.version != VERSION_2:
            return []
        if session is not None:
            session.expire(time)
        opens = session is not None and not session.is_open
        if session is not None and not session.admit(request, data, time):
            return []
        echo = self.seal(build_echo(request, self.scan, time, held=0))
        return [self.build_hello(at), echo] if opens else [echo]

    def measure(
        self,
        counts: Int[np.ndarray, "taxel"],
        received: Bool[np.ndarray, "taxel"],
        at: int,
    ) -> list[bytes]:
        """Return the data packets of its part of a scan, and go to the next scan.

        Args:
            counts: counts of the whole skin, each of 16 bits.
            received: which of them are valid; the rest is not sent.
            at: time of the scan [ns].
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
