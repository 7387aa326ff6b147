"""This module reads row-column matrices that send lines of numbers over serial ports.

A line holds the counts of one scan, separated by commas, semicolons, tabs or blanks. It
may begin with the device's time and end with a checksum:

    @1020000,12,13,11,870,15*3C

The time is that of the beginning of the scan [us]. The checksum is the exclusive or of
all bytes before the star, in two hexadecimal digits. Options in the address of the port
name other forms; where two forms are possible, a line is refused until one is named.
"""

import select
import zlib
from collections import Counter, deque
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.clock import Clock
from eskin.drivers.clock_sync import DeviceClock
from eskin.drivers.csv_lines import (
    UNITS,
    LineDeframer,
    LineError,
    LineForm,
)
from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN
from eskin.drivers.sampled_source import MAX_HELD, PatchSample, SampleDevice
from eskin.drivers.serial_transport import MAX_READ_BYTES, SerialPort
from eskin.errors import DeviceError
from eskin.skin import Skin
from eskin.units import NS_PER_S

MAX_COUNT = 65_535
MAX_WAIT = 0.05
"""Longest wait for bytes [s], much shorter than `MAX_HELD`: a port that was looked at
long ago may hold lines of an unknown age."""
MAX_AGE = MAX_HELD * 4 // 5
"""Largest age of a line without a time [ns], less than that from which it is late."""
PIECE_GAP = NS_PER_S // 200
"""Longest time between the pieces of a burst [ns]."""
MAX_BURSTS = 16
"""Number of bursts by which the interval of lines is estimated."""
MIN_CLOCK_LINES = 6
"""Number of lines by which it is tested whether their first number is a time."""
MIN_FRACTIONS = 100
"""Largest count from which fractions of counts may be rounded."""


@final
class ParsedLine(NamedTuple):
    """What a line, or the lines of the rows of a matrix, say."""

    time: int | None
    """Device time [us], modulo 2**32; None without one."""
    counts: Int[np.ndarray, "taxel"]
    """Counts of the patch's taxels; 0 where missing."""
    received: Bool[np.ndarray, "taxel"]
    """Which are not missing."""


@final
class FirstNumberTest:
    """Tests whether the first number of lines is a time, and in which unit.

    Attributes:
        unit: the unit; empty for none; None while it is not known.
    """

    def __init__(self) -> None:
        """Start without lines."""
        self.unit: str | None = None
        self.numbers: list[float] = []
        self.begun = 0

    def push(self, number: float, arrived: int, is_time: bool) -> None:
        """Add the first number of a line, of which is said whether it is a time."""
        if self.numbers and number < self.numbers[-1]:
            # A device that starts over; or a count.
            self.unit = self.unit if is_time else ""
            self.numbers.clear()
        self.begun = self.begun if self.numbers else arrived
        self.numbers.append(number)
        if len(self.numbers) < MIN_CLOCK_LINES or arrived - self.begun < MAX_HELD:
            return
        rate = (number - self.numbers[0]) * NS_PER_S / (arrived - self.begun)
        # Numbers of lines go on by one, at any rate.
        rises = bool((np.diff(self.numbers) != 1).any())
        near = [u for u, us in UNITS.items() if 2 / 3 < 1e-6 * us * rate < 3 / 2]
        self.unit = near[0] if near and rises else ""
        self.numbers.clear()


@final
class LineBurst:
    """Tells when lines without a time were made: evenly, though they come in bursts.

    A driver may hold lines back and deliver them at once, in pieces. Then the first of
    them was made one interval after the last of those before.
    """

    def __init__(self, now: int) -> None:
        """Start without lines at a time [ns]."""
        self.begin = self.arrived = now
        self.count = 0
        self.past: deque[tuple[int, int]] = deque(maxlen=MAX_BURSTS)

    def push(self, count: int, now: int) -> list[int]:
        """Return when some lines that arrive now were made [ns]."""
        if not count:
            return []
        gap = now - self.arrived
        if gap > PIECE_GAP or now - self.begin > MAX_AGE:
            span = self.arrived - self.begin
            if self.count and span < NS_PER_S:
                self.past.append((span, self.count))
            self.begin = self.arrived if gap < NS_PER_S else now
            self.count = 0
        self.arrived = now
        past = self.past or [(max(now - self.begin, 1), count)]
        spans, counts = (sum(column) for column in zip(*past, strict=True))
        first, self.count = self.count + 1, self.count + count
        made = (self.begin + n * spans // counts for n in range(first, self.count + 1))
        return [min(max(stamp, now - MAX_AGE), now) for stamp in made]


@final
class MatrixLine:
    """Reads the lines of one port, to which one patch is connected.

    Attributes:
        deframer: finds the lines in the bytes of the port.
        empty_at: latest time at which the port was known to be empty [ns].
        refused: number of lines that were refused and not yet reported.
        why: why the last of them was.
    """

    def __init__(self, form: LineForm, skin: Skin, patch: int) -> None:
        """Start without lines."""
        self.form, self.deframer = form, LineDeframer()
        self.unit = "us" if form.time in ("", "none") else form.time
        self.scale, self.offset = float(form.scale or 1), float(form.offset or 0)
        self.patch, self.place = patch, skin.patches[patch]
        taxels = skin.find_taxels(self.place.id)
        self.taxels = len(taxels)
        self.cells = self.place.rows * self.place.columns
        self.places = skin.rows[taxels] * self.place.columns + skin.columns[taxels]
        self.counts: Counter[str] = Counter()
        self.refused, self.why = 0, ""
        self.bytes = 0
        self.has_checksum = False
        self.begin(0)

    def begin(self, now: int) -> None:
        """Start over, as after the port was opened at a time [ns]."""
        self.device_clock = DeviceClock()
        self.first_number = FirstNumberTest()
        self.number = self.unknown = 0
        self.empty_at = now
        self.burst = LineBurst(now)
        self.size = self.last_size = 0
        self.rows: list[float] = []

    def push(self, lines: Sequence[bytes], now: int) -> list[PatchSample]:
        """Return the samples of the lines that were read at a time [ns]."""
        empty_at, before = self.empty_at, self.bytes
        self.bytes = self.deframer.bytes
        if self.bytes - before < MAX_READ_BYTES:
            self.empty_at = now
        found = [(line, self.parse(line, now)) for line in lines]
        parsed = [(line, one) for line, one in found if one is not None]
        is_old = now - empty_at > MAX_HELD
        samples = []
        stamps = self.burst.push(len(parsed), now)
        for stamp, (line, (time, counts, received)) in zip(stamps, parsed, strict=True):
            if time is not None:
                stamp = self.time_line(line, time, counts, now)
            elif is_old:
                self.counts["late"] += 1
                self.refuse(line, "it lay unread for a time that is not known", "")
                continue
            if stamp is not None:
                self.counts["samples"] += 1
                samples.append(PatchSample(self.patch, stamp, counts, None, received))
        if is_old:
            self.deframer.reset()
        return samples

    def time_line(
        self, line: bytes, time: int, counts: Int[np.ndarray, "taxel"], now: int
    ) -> int | None:
        """Return when a line was made by the host's clock; None if not believed."""
        self.number = (self.number + 1) % SCAN_NUMBER_SPAN
        content = zlib.crc32(counts.tobytes())
        found = self.device_clock.push(time, self.number, now, content)
        if found is not None and self.device_clock.doubt is None:
            self.unknown = 0
            return found.stamp
        self.counts["late"] += 1
        self.unknown += 1
        # The first lines of every clock are not believed.
        if self.unknown >= MIN_CLOCK_LINES:
            why = "its time does not go on as the clock of this computer does"
            self.refuse(line, why, f"give {self.form.format(time='ignore')}")
        return None

    def parse(self, line: bytes, now: int = 0) -> ParsedLine | None:
        """Return what a line says; None if it is damaged, or not the end of a scan."""
        try:
            return self.parse_body(line, now)
        except ValueError:
            why, remedy = "not all of it is numbers", self.form.find_label(line)
        except LineError as error:
            why, remedy = error.why, error.remedy
        self.counts["damaged"] += 1
        self.rows.clear()
        self.refuse(line, why, remedy)
        return None

    def parse_body(self, line: bytes, now: int) -> ParsedLine | None:
        """Return what a line says; None if it is not the end of a scan.

        Raises:
            LineError: it cannot be read.
            ValueError: something in it is not a number.
        """
        body = line.strip(b"\xef\xbb\xbf \t")
        label = self.form.label.encode()
        if not body.startswith(label):
            return None
        body, star, digits = body[len(label) :].partition(b"*")
        if star:
            whole = line[: line.index(b"*")]
            if f"{reduce(xor, whole, 0):02X}".encode() != digits.upper():
                raise LineError(
                    "its checksum is wrong", "send the exclusive or of all bytes before"
                )
            self.has_checksum = True
        elif self.has_checksum and body:
            raise LineError("it has no checksum, as others had", "send it with all")
        ends_rows = not body or body.endswith(b"]]")
        body = body.translate(None, b"[](){}").strip()
        is_timed = body.startswith(b"@") or self.form.time not in ("", "none")
        numbers = self.form.split(body.removeprefix(b"@")) if body else []
        if not is_timed and len(numbers) not in (self.taxels, self.cells):
            numbers = self.join_rows(numbers, ends_rows)
        if not numbers:
            return None
        test = self.first_number
        if test.unit is None or (is_timed and test.unit != self.unit):
            test.push(numbers[0], now, is_timed)
        time = self.take_time(numbers) if is_timed else None
        self.check_size(len(numbers), is_timed)
        counts, received = self.count(numbers)
        return ParsedLine(time, counts, received)

    def join_rows(self, numbers: list[float], ends: bool) -> list[float]:
        """Add a row of the matrix; return the numbers of all rows when they end."""
        if len(numbers) in (0, self.place.columns):
            self.rows += numbers
            if not ends and len(self.rows) <= self.cells:
                return []
            numbers, self.rows = self.rows, []
            if numbers and (not ends or len(numbers) != self.cells):
                rows = self.place.rows
                raise LineError(
                    "it is one of rows, without an empty line after each "
                    f"{rows} of them",
                    "send one",
                )
        return numbers

    def take_time(self, numbers: list[float]) -> int | None:
        """Take the time from the numbers of a line; return it [us], modulo 2**32."""
        time, found = numbers.pop(0), self.first_number.unit
        if self.unit == "ignore":
            return None
        if not np.isfinite(time):
            raise LineError("its time is missing", "send it with all lines")
        if found not in (None, self.unit):
            why = f"is in {found}, not" if found else "does not go on in"
            other = self.form.format(time=found or "ignore")
            raise LineError(f"its time {why} {self.unit}", f"give {other}")
        return round(time * UNITS[self.unit]) % DEVICE_TIME_SPAN

    def check_size(self, size: int, is_timed: bool) -> None:
        """Raise a LineError unless a line of so many counts has one meaning."""
        found = self.first_number.unit
        unit = "ms" if found is None else found or "ignore"
        time, none = (self.form.format(time=word) for word in (unit, "none"))
        if size not in (self.taxels, self.cells):
            is_more = not is_timed and size - 1 in (self.taxels, self.cells)
            remedy = f"give {time} if the first is a time"
            if not is_more:
                remedy = "send a line a scan, or an empty line after all rows"
            raise LineError(f"it has {size} numbers", remedy)
        is_either = size == self.cells == self.taxels + 1
        if not (is_timed or self.form.time) and (is_either or found):
            raise LineError(
                f"its first number may be a time{f' in {found}' if found else ''}",
                f"give {time} if it is one, or {none} if it is the count of a cell",
            )
        # A line that has lost a separator may have the number of the other form.
        known = self.size == self.last_size == 0 or size in (self.size, self.last_size)
        self.last_size = size
        if not known:
            raise LineError(f"it has {size} numbers, others had {self.size}", "")
        self.size = size

    def count(
        self, numbers: list[float]
    ) -> tuple[Int[np.ndarray, "taxel"], Bool[np.ndarray, "taxel"]]:
        """Return the counts of numbers, and which are not missing."""
        values = np.array(numbers)
        if np.isinf(values).any():
            raise ValueError
        if len(values) > 2 and (values == values[0] + np.arange(len(values))).all():
            if values[0] in (0, 1):
                raise LineError("its numbers are those of the cells", "send counts")
        received = ~np.isnan(values)
        values = np.where(received, values, 0)
        if not self.form.scale and values.max() < MIN_FRACTIONS:
            if (values % 1).any():
                large, one = (self.form.format(scale=s) for s in ("1000", "1"))
                raise LineError(
                    f"its numbers are fractions below {MIN_FRACTIONS}",
                    f"give {large}, or {one} to round them",
                )
        values = np.where(received, np.rint(values * self.scale + self.offset), 0)
        if values.min() < 0 or values.max() > MAX_COUNT:
            worst = values.min() if values.min() < 0 else values.max()
            way = {"offset": "1000"} if worst < 0 else {"scale": "0.01"}
            raise LineError(
                f"count {worst:g} is out of range",
                f"give {self.form.format(**way)} or another",
            )
        if len(values) != self.taxels:
            values, received = values[self.places], received[self.places]
        return values.astype(np.int32), received

    def refuse(self, line: bytes, why: str, remedy: str) -> None:
        """Note why a line is refused."""
        text = line[:48].decode("ascii", "replace")
        sizes = " or ".join(map(str, sorted({self.taxels, self.cells})))
        self.refused += 1
        self.why = (
            f"'{text if text.isprintable() else ascii(text)[1:-1]}"
            f"{'...' if len(line) > 48 else ''}' at {self.form.path}: {why}; "
            f"allowed are {sizes} counts a line of patch '{self.place.id}' from 0 "
            f"to {MAX_COUNT}; {remedy or 'check cable, baud rate and what is sent'}"
        )


@final
class CsvMatrix(SampleDevice):
    """Reads matrices at serial ports, each of which is one patch of the skin."""

    def __init__(
        self, clock: Clock, paths: Sequence[str], skin: Skin, baud: int
    ) -> None:
        """Name the ports.

        Args:
            clock: clock that stamps arrivals.
            paths: paths of the device files, in the order of the skin's patches, with
                options that say how lines are read, as in `/dev/ttyACM0,time=ms`.
            skin: skin whose patches they are.
            baud: baud rate [bit/s]; has no effect on a pure USB port.

        Raises:
            DeviceError: there is not one port a patch, or no such option.
        """
        forms = [LineForm.parse(path) for path in paths]
        paths = [form.path for form in forms]
        if len(paths) != len(skin.patches) or len(set(paths)) != len(paths):
            raise DeviceError(
                f"csv: ports are {', '.join(paths)}, skin '{skin.name}' has "
                f"{len(skin.patches)} patches; allowed is one port a patch, in the "
                "order of skin.yaml; name as many"
            )
        self.clock, self.baud = clock, baud
        self.ports: list[SerialPort] = []
        self.lines = [MatrixLine(form, skin, n) for n, form in enumerate(forms)]

    def connect(self) -> None:
        """Open the ports.

        Raises:
            DeviceError: one of them cannot be opened.
        """
        for line in self.lines:
            self.ports.append(SerialPort(line.form.path, self.baud, line.deframer))
        for line in self.lines:
            line.begin(self.clock.now())

    def receive(self, timeout: float) -> list[PatchSample]:
        """Return the samples of all ports; a port that is gone is opened again."""
        now = self.clock.now()
        pairs = list(zip(self.ports, self.lines, strict=True))
        for port, line in pairs:
            if port.retry(now):
                line.begin(now)
        files = {port.line.fileno(): (port, line) for port, line in pairs if port.line}
        if not files:
            self.clock.sleep(timeout)
            return []
        readable = select.select(list(files), [], [], min(timeout, MAX_WAIT))[0]
        now = self.clock.now()
        samples = []
        for file, (port, line) in files.items():
            if file in readable:
                samples += line.push(port.read() or (), now)
            else:
                line.empty_at = now
        return samples

    def take_refused(self) -> tuple[int, str]:
        """Return how many lines were refused since the last call, and why the last."""
        count = sum(line.refused for line in self.lines)
        why = next((line.why for line in self.lines if line.refused), "")
        for line in self.lines:
            line.refused = 0
        return count, why

    def disconnect(self) -> None:
        """Close the ports."""
        for port in self.ports:
            port.close()

    def counters(self) -> dict[str, int]:
        """Return lines by what became of them: samples, damaged, late; and bytes."""
        whole = sum((line.counts for line in self.lines), Counter())
        whole["bytes"] = sum(line.deframer.bytes for line in self.lines)
        whole["damaged"] += sum(line.deframer.broken for line in self.lines)
        return dict(whole)
