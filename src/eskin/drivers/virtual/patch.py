"""One patch that is not there, and speaks as if it were."""

import struct
import zlib
from typing import final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.packet import (
    COUNT,
    CRC,
    DATA,
    MAX_COUNTS,
    VERSION,
    Hello,
    Status,
    encode_packet,
)
from eskin.skin import Patch

FIRMWARE = "eskin virtual 1"
TEMPERATURE = 2500
"""That it says it has [0.01 degrees Celsius]."""
WRAP, SCAN_WRAP = 2**32, 2**16

START = struct.Struct("<BBHHIHH")
"""Header and fixed part of a data packet at once."""


@final
class VirtualPatch:
    """A module of skin: its own clock, its own scan numbers, its own serial number.

    Faults change it from outside: everything but its taxels may change as it runs.

    Attributes:
        address: that it speaks under.
        serial_number: of the module that is plugged in.
        away: reasons why it is not there now; it speaks while there is none.
        taxels: what it measures, as indices of the skin.
    """

    def __init__(
        self,
        patch: Patch,
        taxels: Int[np.ndarray, "part"],
        rate: float,
        serial_number: int,
        crystal: float = 0.0,
        offset: float = 0.0,
    ) -> None:
        """Power up.

        Args:
            patch: whose place it has.
            taxels: of that patch, as indices of the skin.
            rate: scans a second [1/s].
            serial_number: of the module.
            crystal: how much too fast its clock runs [ppm].
            offset: how long it has run when the skin starts [s].
        """
        self.patch = patch
        self.taxels = taxels
        whole = slice(int(taxels[0]), int(taxels[-1]) + 1)
        self.where = whole if whole.stop - whole.start == len(taxels) else taxels
        self.rate = rate
        self.address = patch.address
        self.serial_number = serial_number
        self.pace = (1.0 + crystal * 1e-6) / 1000.0
        self.away = 0
        self.power_up(0)
        self.offset = round(offset * 1e6)
        self.scan = round(offset * rate) % SCAN_WRAP

    def power_up(self, at: int) -> None:
        """Begin clock and scan numbers anew, and introduce itself next.

        Args:
            at: since the skin was started [ns].
        """
        self.born = at
        self.offset = 0
        self.scan = 0
        self.is_new = True

    def wrap_in(self, seconds: float, at: int) -> None:
        """Set clock and scan number so that both wrap after some time [s]."""
        self.jump(seconds=(WRAP - self.device_time(at)) / 1e6 - seconds)
        self.scan = round(-seconds * self.rate) % SCAN_WRAP

    def jump(self, seconds: float) -> None:
        """Set the clock forward [s]; back where negative."""
        self.offset += round(seconds * 1e6)

    def device_time(self, at: int) -> int:
        """Its own clock, modulo 2**32 [us].

        Args:
            at: since the skin was started [ns].
        """
        return (int((at - self.born) * self.pace) + self.offset) % WRAP

    def introduce(self, at: int) -> list[bytes]:
        """Hello and status, as once a second."""
        self.is_new = False
        common = (self.address, self.scan, self.device_time(at))
        patch, rate = self.patch, min(round(self.rate), SCAN_WRAP - 1)
        size = (patch.rows, patch.columns, len(self.taxels), rate)
        return [
            encode_packet(Hello(*common, *size, self.serial_number, FIRMWARE)),
            encode_packet(Status(*common, 0, 0, TEMPERATURE)),
        ]

    def measure(
        self,
        counts: Int[np.ndarray, "taxel"],
        received: Bool[np.ndarray, "taxel"],
        at: int,
    ) -> list[bytes]:
        """The data packets of its part of a scan, which then is counted.

        Args:
            counts: of the whole skin, each of 16 bits.
            received: what of it there is; the rest is not sent.
            at: since the skin was started [ns].
        """
        own = counts[self.where].astype(COUNT).tobytes()
        time = self.device_time(at)
        packets = []
        for first, last in runs(received[self.where]):
            start = START.pack(
                *(VERSION, DATA, self.address, self.scan, time, first, last - first)
            )
            body = start + own[2 * first : 2 * last]
            packets.append(body + CRC.pack(zlib.crc32(body)))
        self.scan = (self.scan + 1) % SCAN_WRAP
        return packets


def runs(received: Bool[np.ndarray, "part"]) -> list[tuple[int, int]]:
    """First and behind the last of taxels in a row, each run fitting a packet."""
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
