"""This module reads row-column matrices that send lines of numbers over serial ports.

A line holds the counts of one scan, separated by commas, semicolons or blanks. It may
begin with the device's time and end with a checksum:

    @1020000,12,13,11,870,15*3C

The time is that of the beginning of the scan [us], modulo 2**32. The checksum is the
exclusive or of all bytes before the star, in two hexadecimal digits.
"""

import re
import select
import zlib
from collections import Counter
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import final

import numpy as np
from jaxtyping import Int

from eskin.drivers.clock import Clock
from eskin.drivers.clock_sync import DeviceClock
from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN, Framing
from eskin.drivers.sampled_source import PatchSample, SampleDevice
from eskin.drivers.serial_transport import SerialPort
from eskin.errors import DeviceError
from eskin.skin import Skin
from eskin.units import NS_PER_S

MAX_LINE_BYTES = 1 << 16
"""Longest line."""
MAX_COUNT = 65_535
STALL = NS_PER_S // 20
"""Time without reading after which lines without a time are of an unknown age [ns]."""
LINE = re.compile(rb"(?:@(\d{1,10})[,; \t])?([\d,; \t]+)(?:\*([0-9A-Fa-f]{2}))?\r?")
SEPARATORS = re.compile(rb"[,; \t]+")


@final
class LineDeframer(Framing):
    """Finds the lines in the bytes of a port; the first may be cut and is left out."""

    def reset(self) -> None:
        """Discard the open line; the rest of it will be left out."""
        self.open = bytearray()
        self.skipping = True

    def push(self, chunk: bytes) -> list[bytes]:
        """Return the lines that end in this chunk, without their ends."""
        self.bytes += len(chunk)
        lines = []
        *ends, start = chunk.split(b"\n")
        for part in ends:
            if not self.skipping:
                lines.append(bytes(self.open + part))
            self.open, self.skipping = bytearray(), False
        if not self.skipping:
            self.open += start
        if len(self.open) > MAX_LINE_BYTES:
            self.broken += 1
            self.reset()
        self.frames += len(lines)
        return lines


@final
class MatrixLine:
    """Reads one port, to which one patch is connected."""

    def __init__(self, path: str, baud: int, skin: Skin, patch: int) -> None:
        """Open the port.

        Raises:
            DeviceError: it is missing, busy or not readable.
        """
        self.deframer = LineDeframer()
        self.port = SerialPort(path, baud, self.deframer)
        self.patch = patch
        taxels = skin.find_taxels(skin.patches[patch].id)
        self.taxels = len(taxels)
        self.cells = skin.patches[patch].rows * skin.patches[patch].columns
        columns = skin.patches[patch].columns
        self.places = skin.rows[taxels] * columns + skin.columns[taxels]
        self.counts: Counter[str] = Counter()
        self.has_checksum = False
        self.begin(0)

    def begin(self, now: int) -> None:
        """Start over, as after the port was opened at a time [ns]."""
        self.device_clock = DeviceClock()
        self.number = 0
        self.read_at = now

    def read(self, now: int) -> list[PatchSample]:
        """Return the samples that have arrived until a time [ns]."""
        previous, self.read_at = self.read_at, now
        lines = self.port.read() or ()
        parsed = [found for line in lines if (found := self.parse(line)) is not None]
        # Lines without a time came since the port was last read, evenly: if that is
        # long ago, nobody knows how old they are.
        if parsed and now - previous > STALL and parsed[0][0] is None:
            self.counts["late"] += len(parsed)
            self.deframer.reset()
            return []
        samples = []
        for index, (time, counts) in enumerate(parsed):
            stamp = previous + (now - previous) * (index + 1) // len(parsed)
            if time is not None:
                stamp = self.time_line(time, counts, now)
            if stamp is not None:
                samples.append(PatchSample(self.patch, stamp, counts))
        return samples

    def time_line(
        self, time: int, counts: Int[np.ndarray, "taxel"], now: int
    ) -> int | None:
        """Return when a line was made by the host's clock; None if not believed."""
        self.number = (self.number + 1) % SCAN_NUMBER_SPAN
        content = zlib.crc32(counts.tobytes())
        found = self.device_clock.push(time, self.number, now, content)
        if found is None or self.device_clock.doubt is not None:
            self.counts["late"] += 1
            return None
        return found.stamp

    def parse(self, line: bytes) -> tuple[int | None, Int[np.ndarray, "taxel"]] | None:
        """Return time [us] and counts of a line; None, counted, if it is damaged."""
        match = LINE.fullmatch(line)
        if match is None:
            self.counts["damaged"] += 1
            return None
        time, numbers, checksum = match.groups()
        if checksum is None:
            wrong = self.has_checksum
        else:
            star = line.rindex(b"*")
            wrong = reduce(xor, line[:star], 0) != int(checksum, 16)
            self.has_checksum |= not wrong
        words = SEPARATORS.split(numbers.strip(b",; \t"))
        if wrong or len(words) not in (self.taxels, self.cells):
            self.counts["damaged"] += 1
            return None
        values = [int(word) if len(word) < 6 else MAX_COUNT + 1 for word in words]
        if max(values) > MAX_COUNT:
            self.counts["damaged"] += 1
            return None
        counts = np.array(values, np.int32)
        self.counts["samples"] += 1
        whole = counts if len(words) == self.taxels else counts[self.places]
        return None if time is None else int(time) % DEVICE_TIME_SPAN, whole


@final
class CsvMatrix(SampleDevice):
    """Reads matrices at serial ports, each of which is one patch of the skin."""

    def __init__(
        self, clock: Clock, paths: Sequence[str], skin: Skin, baud: int
    ) -> None:
        """Name the ports.

        Args:
            clock: clock that stamps arrivals.
            paths: paths of the device files, in the order of the skin's patches.
            skin: skin whose patches they are.
            baud: baud rate [bit/s]; has no effect on a pure USB port.

        Raises:
            DeviceError: there is not one port a patch.
        """
        if len(paths) != len(skin.patches) or len(set(paths)) != len(paths):
            raise DeviceError(
                f"csv: ports are {', '.join(paths)}, skin '{skin.name}' has "
                f"{len(skin.patches)} patches; allowed is one port a patch, in the "
                "order of skin.yaml; name as many"
            )
        self.clock, self.paths, self.skin, self.baud = clock, paths, skin, baud
        self.lines: list[MatrixLine] = []

    def connect(self) -> None:
        """Open the ports.

        Raises:
            DeviceError: one of them cannot be opened.
        """
        for patch, path in enumerate(self.paths):
            self.lines.append(MatrixLine(path, self.baud, self.skin, patch))
        for line in self.lines:
            line.begin(self.clock.now())

    def receive(self, timeout: float) -> list[PatchSample]:
        """Return the samples of all ports; a port that is gone is opened again."""
        now = self.clock.now()
        for line in self.lines:
            if line.port.retry(now):
                line.begin(now)
        files = {line.port.line.fileno(): line for line in self.lines if line.port.line}
        if not files:
            self.clock.sleep(timeout)
            return []
        readable = select.select(list(files), [], [], timeout)[0]
        now = self.clock.now()
        samples = []
        for file, line in files.items():
            if file in readable:
                samples += line.read(now)
            else:
                line.read_at = now
        return samples

    def disconnect(self) -> None:
        """Close the ports."""
        for line in self.lines:
            line.port.close()

    def counters(self) -> dict[str, int]:
        """Return lines by what became of them: samples, damaged, late; and bytes."""
        whole = sum((line.counts for line in self.lines), Counter())
        whole["bytes"] = sum(line.deframer.bytes for line in self.lines)
        whole["damaged"] += sum(line.deframer.broken for line in self.lines)
        return dict(whole)
