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
    SCAN_NUMBER_SPAN,
    VERSION,
    Hello,
    Status,
    encode_packet,
)
from eskin.drivers.patch_stream import index_taxels
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
    ) -> None:
        """Power up.

        Args:
            patch: patch that it belongs to.
            taxels: taxels of that patch, as indices of the skin.
            rate: scan rate [1/s].
            serial_number: serial number of the module.
            clock_error: relative error of its clock; positive is too fast [ppm].
            offset: time since power-up when the skin starts [s].
        """
        self.patch = patch
        self.taxels = taxels
        self.place = index_taxels(taxels)
        self.rate = rate
        self.address = patch.address
        self.serial_number = serial_number
        self.us_per_ns = (1.0 + clock_error * 1e-6) / 1000.0
        self.away = 0
        self.power_up(0)
        self.offset = round(offset * 1e6)
        self.scan = round(offset * rate) % SCAN_NUMBER_SPAN

    def power_up(self, at: int) -> None:
        """Reset clock and scan number; a hello is sent next."""
        self.power_up_at = at
        self.offset = self.scan = 0
        self.is_new = True

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

    def build_hello_and_status(self, at: int) -> list[bytes]:
        """Return the two packets that are sent once a second."""
        self.is_new = False
        common = (self.address, self.scan, self.device_time(at))
        hello = Hello(
            *common,
            rows=self.patch.rows,
            columns=self.patch.columns,
            taxels=len(self.taxels),
            rate=min(round(self.rate), MAX_RATE),
            serial_number=self.serial_number,
            firmware=FIRMWARE,
        )
        status = Status(*common, skipped=0, errors=0, temperature=TEMPERATURE)
        return [encode_packet(hello), encode_packet(status)]

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
        for first, last in split_runs(received[self.place]):
            header = (VERSION, DATA, self.address, self.scan, time)
            start = DATA_START.pack(*header, first, last - first)
            body = start + own[2 * first : 2 * last]
            packets.append(body + CRC.pack(zlib.crc32(body)))
        self.scan = (self.scan + 1) % SCAN_NUMBER_SPAN
        return packets


def split_runs(received: Bool[np.ndarray, "part"]) -> list[tuple[int, int]]:
    """Return start and end of the runs of valid taxels, each fitting a packet."""
    if received.all():
        pieces = [(0, len(received))]
    else:
        edges = np.flatnonzero(np.diff(received, prepend=False, append=False))
        pieces = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    return [
        (first, min(first + MAX_COUNTS, end))
        for begin, end in pieces
        for first in range(begin, end, MAX_COUNTS)
    ]
