"""This module reads row-column matrices that send lines of numbers over serial ports.

A line holds the counts of one scan, separated by commas, semicolons, tabs or blanks. It
may begin with the device's time and end with a checksum:

    @1020000,12,13,11,870,15*3C

The time tells when the scan began [us]. The checksum is the exclusive or of
all bytes before the star, in two hexadecimal digits. Options in the address of the port
name other forms; where two forms are possible, a line is refused until one is named.
"""

import math
import select
import zlib
from collections import Counter, deque
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.drivers.clock import Clock
from eskin.drivers.clock_sync import DeviceClock
from eskin.drivers.csv_hints import describe_forms, find_readable, list_labels
from eskin.drivers.csv_lines import (
    ANY_NUMBER,
    BRACKETS,
    UNITS,
    LineDeframer,
    LineForm,
    clean_line,
    read_json,
)
from eskin.drivers.csv_meaning import (
    BaseTest,
    EndTest,
    NumberTest,
    check_powers,
)
from eskin.drivers.csv_problems import LineError, LineProblem, OptionChange
from eskin.drivers.events import REPORT_INTERVAL
from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN
from eskin.drivers.sampled_source import MAX_HELD, PatchSample, SampleDevice
from eskin.drivers.serial_transport import MAX_READ_BYTES, SerialPort
from eskin.errors import DeviceError
from eskin.reasons import Reason
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
MIN_FRACTIONS = 100
"""Largest count from which fractions of counts may be rounded."""
MIN_KEPT = 24
"""Number of the latest lines that are kept for trying options, and those of the latest
second."""
MAX_KEPT_BYTES = 1 << 17
"""Largest size of all lines that are kept."""
MIN_ROWS = 4
"""Number of rows from which it is tested whether they hold their numbers."""
RISE_SPAN = 2 * NS_PER_S
"""Time for which a number rises by the same step before it is known to be no count."""


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

    def estimate_stamps(self, count: int, now: int) -> list[int]:
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
        first = self.count + 1
        self.count += count
        made = (self.begin + n * spans // counts for n in range(first, self.count + 1))
        return [min(max(stamp, now - MAX_AGE), now) for stamp in made]


@final
class MatrixLine:
    """Reads the lines of one port, to which one patch is connected.

    Attributes:
        deframer: finds the lines in the bytes of the port.
        empty_at: latest time at which the port was known to be empty [ns].
        refused: number of lines that were refused and not yet reported.
        unread: the last line that was not read and not yet reported, and why.
        is_running: whether more lines were read than refused when that was reported.
            From then on, what lines mean is no longer doubted, and no options are
            searched for, which takes time.
    """

    def __init__(
        self, form: LineForm, skin: Skin, patch: int, rise_span: int = RISE_SPAN
    ) -> None:
        """Start without lines.

        Args:
            form: how the lines are read.
            skin: the skin.
            patch: index of the patch in the skin.
            rise_span: time for which the number at an end of lines rises before lines
                are refused for it [ns].
        """
        self.form = form
        self.skin = skin
        self.patch = patch
        self.deframer = LineDeframer()
        self.unit = "us" if form.time in ("", "none") else form.time
        self.scale = 1.0 if form.scale is None else form.scale
        self.offset = 0.0 if form.offset is None else form.offset
        self.missing = math.nan if form.missing is None else form.missing
        self.place = skin.patches[patch]
        taxels = skin.find_taxels(self.place.id)
        self.taxels = len(taxels)
        self.cells = self.place.rows * self.place.columns
        self.places = skin.rows[taxels] * self.place.columns + skin.columns[taxels]
        self.counts: Counter[str] = Counter()
        self.refused = 0
        self.reported = 0
        self.unread: tuple[bytes, LineError] | None = None
        self.is_running = False
        self.bytes = 0
        self.has_checksum = False
        self.first_number = NumberTest()
        self.end_test = EndTest(rise_span)
        self.base_test = BaseTest()
        self.begin(0)

    def begin(self, now: int) -> None:
        """Start over, as after the port was opened at a time [ns].

        What the numbers in lines mean stays known.
        """
        self.device_clock = DeviceClock()
        self.first_number.clear()
        self.number = 0
        self.unbelieved_at: int | None = None
        self.empty_at = now
        self.late_at: int | None = None
        self.burst = LineBurst(now)
        self.size = 0
        self.last_size = 0
        self.rows: list[float] = []
        self.is_first_scan = True
        self.labelled_at = now
        self.kept: deque[tuple[int, bytes]] = deque()
        self.kept_bytes = 0
        self.searched_at: int | None = None
        self.advised: Reason | None = None
        self.advice = ""

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of counts that a scan may have: taxels, or cells."""
        return self.taxels, self.cells

    def push_lines(self, lines: Sequence[bytes], now: int) -> list[PatchSample]:
        """Return the samples of the lines that were read at a time [ns].

        Where the age of a line is not known, since this computer was busy, its sample
        has the stamp of the latest time at which the port was known to be empty.
        """
        empty_at = self.empty_at
        before = self.bytes
        self.bytes = self.deframer.bytes
        if self.bytes - before < MAX_READ_BYTES:
            self.empty_at = now
        is_old = now - empty_at > MAX_HELD
        refused = self.refused
        found = [(line, self.parse(line, now)) for line in lines]
        parsed = [(line, one) for line, one in found if one is not None]
        samples = []
        stamps = self.burst.estimate_stamps(len(parsed), now)
        for stamp, (line, (time, counts, received)) in zip(stamps, parsed, strict=True):
            if time is not None:
                stamp = self.time_line(line, time, counts, now)
            elif is_old:
                stamp = empty_at
            if stamp is not None:
                self.counts["samples"] += 1
                samples.append(PatchSample(self.patch, stamp, counts, None, received))
        if is_old:
            self.deframer.reset()
            self.late_at = now
        if self.late_at is not None and now - self.late_at < MAX_HELD:
            # What no longer fitted into the buffer of the port has cut some lines.
            self.refused = refused
        return samples

    def time_line(
        self, line: bytes, time: int, counts: Int[np.ndarray, "taxel"], now: int
    ) -> int | None:
        """Return when a line was made by the host's clock; None if not believed."""
        self.number = (self.number + 1) % SCAN_NUMBER_SPAN
        content = zlib.crc32(counts.tobytes())
        found = self.device_clock.find_scan_time(time, self.number, now, content)
        if found is not None and self.device_clock.doubt is None:
            self.unbelieved_at = None
            return found.stamp
        self.counts["late"] += 1
        if self.unbelieved_at is None:
            self.unbelieved_at = now
        # The first lines of every clock are not believed.
        if now - self.unbelieved_at > MAX_HELD:
            change = OptionChange({"time": "ignore"}, "")
            self.refuse(line, LineError(LineProblem.TIME_LEAPS.reason(), [change]))
        return None

    def parse(self, line: bytes, now: int = 0) -> ParsedLine | None:
        """Return what a line says; None if it is damaged, or not the end of a scan."""
        self.keep(line, now)
        try:
            return self.parse_body(line, now)
        except LineError as error:
            self.counts["damaged"] += 1
            self.rows.clear()
            self.refuse(line, error)
        return None

    def keep(self, line: bytes, now: int) -> None:
        """Keep a line, by which options are tried."""
        self.kept.append((now, line))
        self.kept_bytes += len(line)
        while self.kept_bytes > MAX_KEPT_BYTES or (
            len(self.kept) > MIN_KEPT and now - self.kept[0][0] > NS_PER_S
        ):
            self.kept_bytes -= len(self.kept.popleft()[1])

    def parse_body(self, line: bytes, now: int) -> ParsedLine | None:
        """Return what a line says; None if it is not the end of a scan.

        Raises:
            LineError: it cannot be read.
        """
        body = clean_line(line)
        is_object = is_timed = False
        numbers: list[float] = []
        ends_rows = True
        if ANY_NUMBER.search(body) is not None:
            label_end = self.form.find_label_end(body)
            if label_end is None:
                self.leave_out(line, now)
                return None
            self.labelled_at = now
            body = self.take_checksum(line, body[label_end:].strip())
            is_object = body.startswith(b"{")
            ends_rows = body.endswith(b"]]")
            numbers, is_timed = self.read_numbers(body)
        if numbers and (is_timed or not is_object):
            self.test_ends(numbers, is_timed, now)
        if self.form.last and numbers:
            numbers.pop()
        if self.form.time == "ignore" and is_timed and numbers:
            numbers.pop(0)
            is_timed = False
        if not is_timed and len(numbers) not in self.sizes:
            numbers = self.join_rows(numbers, ends_rows)
        if not numbers:
            return None
        time = self.take_time(numbers) if is_timed else None
        self.check_size(len(numbers), is_timed, is_object)
        counts, received = self.count(numbers)
        return ParsedLine(time, counts, received)

    def leave_out(self, line: bytes, now: int) -> None:
        """Leave out a line that does not begin with the label.

        It is of another device, unless no line begins with the label for a second: then
        one line a second is refused.
        """
        error = LineError(
            LineProblem.OTHER_LABEL.reason(label=self.form.label),
            [OptionChange({"label": ""}, "")],
        )
        if now - self.labelled_at > NS_PER_S:
            self.labelled_at = now
            self.refuse(line, error)
        elif not self.counts["samples"]:
            self.unread = line, error

    def take_checksum(self, line: bytes, body: bytes) -> bytes:
        """Return the text before the checksum in the part of a line after its label.

        The checksum is that of all bytes before the star, or of those after the label.

        Raises:
            LineError: it is wrong, or missing where others had one.
        """
        content, star, digits = body.rpartition(b"*")
        # A star in a JSON object is part of a text.
        if not star or b"}" in digits:
            if self.has_checksum:
                raise LineError(LineProblem.WITHOUT_CHECKSUM.reason())
            return body
        whole = line[: line.rindex(b"*")]
        sums = {f"{reduce(xor, text, 0):02X}".encode() for text in (whole, content)}
        if digits.upper() not in sums:
            raise LineError(LineProblem.WRONG_CHECKSUM.reason())
        self.has_checksum = True
        return content

    def read_numbers(self, body: bytes) -> tuple[list[float], bool]:
        """Return the numbers of a line, and whether the first is a time.

        Raises:
            LineError: something in it is no number.
        """
        takes_time = self.form.time not in ("", "none")
        if body.startswith(b"{"):
            unit = self.unit if takes_time and self.form.time != "ignore" else ""
            return read_json(body, unit, self.sizes), bool(unit)
        body = body.replace(b"null", b"nan").translate(None, BRACKETS).strip()
        is_timed = body.startswith(b"@") or takes_time
        sizes = (*self.sizes, self.place.columns)
        try:
            words = self.form.split(body.removeprefix(b"@"))
        except LineError:
            self.base_test.note_unread(body, sizes)
            raise
        self.drop_ends(words, is_timed)
        if not self.form.base:
            check_powers(words[is_timed:])
            if not self.is_running:
                self.base_test.add_words(words[is_timed:])
        return self.form.convert(words), is_timed

    def drop_ends(self, words: list[bytes], is_timed: bool) -> None:
        """Drop the empty words at the ends of a line that are no missing cells.

        A separator may end the label, and another the line, where the line has a number
        more than a scan or a row.

        Raises:
            LineError: either the first or the last word is no cell.
        """
        allowed = (*self.sizes, self.place.columns)
        size = len(words) - is_timed - bool(self.form.last)
        begins = bool(self.form.label and words and not words[0])
        ends = bool(words and not words[-1])
        if begins and ends and size - 1 in allowed:
            raise LineError(LineProblem.WITHOUT_END_CELL.reason())
        if begins and ends and size - 2 in allowed:
            del words[0], words[-1]
        elif begins and size - 1 in allowed and size not in allowed:
            del words[0]
        elif ends and size - 1 in allowed:
            del words[-1]

    def test_ends(self, numbers: Sequence[float], is_timed: bool, now: int) -> None:
        """Test whether the first and the last number of a whole scan are counts.

        Raises:
            LineError: the options leave out one of them, and the other is no count.
        """
        if len(numbers) < max(min(self.sizes), 2):
            return
        first = self.first_number
        if first.unit is None or (is_timed and first.unit != self.unit):
            first.add_number(numbers[0], now, is_timed)
        self.end_test.add_numbers(numbers, now)
        rising = self.end_test.rising
        if rising == "last" and self.form.time == "ignore" and not self.form.last:
            raise LineError(
                LineProblem.LAST_RISES.reason(),
                [OptionChange({"time": "", "last": "ignore"}, "")],
            )
        if rising == "first" and self.form.last and not is_timed:
            raise LineError(
                LineProblem.FIRST_RISES.reason(),
                [OptionChange({**one.options, "last": ""}, "") for one in TIME_CHANGES],
            )

    def join_rows(self, numbers: list[float], ends: bool) -> list[float]:
        """Add a row of the matrix; return the numbers of all rows when they end.

        Raises:
            LineError: there are too few rows, too many, or they have numbers.
        """
        rows = self.place.rows
        if len(numbers) not in (0, self.place.columns):
            return numbers
        self.rows += numbers
        if not ends and len(self.rows) <= self.cells:
            return []
        numbers = self.rows
        self.rows = []
        is_first = self.is_first_scan
        self.is_first_scan = False
        if is_first and len(numbers) < self.cells:
            return []
        if numbers and (not ends or len(numbers) != self.cells):
            raise LineError(LineProblem.ROWS_WITHOUT_END.reason(rows=rows))
        if self.form.last and self.form.time != "ignore":
            self.check_row_numbers(numbers, 0, {"time": "ignore", "last": ""})
        elif self.form.time == "ignore" and not self.form.last:
            self.check_row_numbers(numbers, -1, {"time": "", "last": "ignore"})
        return numbers

    def check_row_numbers(
        self, numbers: list[float], end: int, options: dict[str, str]
    ) -> None:
        """Refuse rows that hold their own numbers at the other end than is left out.

        Args:
            numbers: numbers of all rows.
            end: column at that end, 0 or -1.
            options: options that leave it out.

        Raises:
            LineError: they do.
        """
        column = numbers[end % self.place.columns :: self.place.columns]
        counted = [[*range(n, n + self.place.rows)] for n in (0, 1)]
        if self.place.rows >= MIN_ROWS and column in counted:
            reason = LineProblem.NUMBERED_ROWS.reason()
            raise LineError(reason, [OptionChange(options, "")])

    def take_time(self, numbers: list[float]) -> int | None:
        """Take the time from the numbers of a line; return it [us], modulo 2**32."""
        time = numbers.pop(0)
        found = self.first_number.unit
        if not np.isfinite(time):
            raise LineError(LineProblem.WITHOUT_TIME.reason())
        if found not in (None, self.unit):
            if not found:
                reason = LineProblem.TIME_OF_NO_UNIT.reason(unit=self.unit)
                changes = [TIME_CHANGES[-1], OptionChange({"time": ""}, "")]
                raise LineError(reason, changes)
            reason = LineProblem.TIME_OF_OTHER_UNIT.reason(found=found, unit=self.unit)
            raise LineError(reason, [OptionChange({"time": found}, "")])
        return round(time * UNITS[self.unit]) % DEVICE_TIME_SPAN

    def check_size(self, size: int, is_timed: bool, is_object: bool) -> None:
        """Raise a LineError unless a line of so many counts has one meaning."""
        found = self.first_number.unit
        if size not in self.sizes:
            counts = (*self.sizes, self.place.columns)
            is_more = size - 1 in counts or size - 2 in counts
            changes = self.list_ends(is_timed) if is_more else ()
            raise LineError(LineProblem.WRONG_COUNT.reason(count=size), changes)
        is_either = size == self.cells == self.taxels + 1 and not self.form.last
        is_known = is_timed or is_object or self.form.time
        if not is_known and (is_either or found):
            reason = LineProblem.MAY_BE_TIME.reason(count=size - 1)
            if found:
                reason = LineProblem.MAY_BE_TIME_OF_UNIT.reason(
                    unit=found, count=size - 1
                )
            none = OptionChange({"time": "none"}, "if all are counts of cells")
            raise LineError(reason, [*self.list_ends(is_timed), none])
        # A line that has lost a separator may have the number of the other form.
        known = self.size == self.last_size == 0 or size in (self.size, self.last_size)
        self.last_size = size
        if not known:
            reason = LineProblem.OTHER_COUNT.reason(count=size, others=self.size)
            raise LineError(reason)
        self.size = size

    def list_ends(self, is_timed: bool) -> list[OptionChange]:
        """Return the changes by which a number at an end of a line is no count."""
        changes: list[OptionChange] = []
        rising = self.end_test.rising
        if not is_timed and not self.form.time and rising != "last":
            changes += TIME_CHANGES
        if not self.form.last and rising != "first":
            changes.append(OptionChange({"last": "ignore"}, "if the last is no count"))
        return changes

    def count(
        self, numbers: list[float]
    ) -> tuple[Int[np.ndarray, "taxel"], Bool[np.ndarray, "taxel"]]:
        """Return the counts of numbers, and which are not missing."""
        values = np.array(numbers)
        if np.isinf(values).any():
            raise LineError(LineProblem.NOT_NUMBERS.reason())
        if len(values) > 2 and (values == values[0] + np.arange(len(values))).all():
            if values[0] in (0, 1):
                raise LineError(LineProblem.CELL_NUMBERS.reason())
        received = ~(np.isnan(values) | (values == self.missing))
        values = np.where(received, values, 0)
        if self.form.scale is None and values.max() < MIN_FRACTIONS:
            if (values % 1).any():
                raise LineError(
                    LineProblem.FRACTIONS.reason(limit=MIN_FRACTIONS),
                    [
                        OptionChange({"scale": "1000"}, "to keep three decimals"),
                        OptionChange({"scale": "1"}, "to round them"),
                    ],
                )
        scaled = np.where(received, np.rint(values * self.scale + self.offset), 0)
        if scaled.min() < 0 or scaled.max() > MAX_COUNT:
            worst = scaled.min() if scaled.min() < 0 else scaled.max()
            changes: list[OptionChange] = []
            if worst < 0:
                changes = list_negative(values)
            elif (scaled > MAX_COUNT).sum() > 1:
                changes = [OptionChange({"scale": "0.01"}, "or with another scale")]
            raise LineError(LineProblem.OUT_OF_RANGE.reason(count=worst), changes)
        if len(values) != self.taxels:
            scaled = scaled[self.places]
            received = received[self.places]
        return scaled.astype(np.int32), received

    def refuse(self, line: bytes, error: LineError) -> None:
        """Note why a line is refused."""
        self.refused += 1
        self.unread = line, error

    def note_reported(self) -> None:
        """Note that what was refused is reported."""
        self.reported += self.refused
        self.refused = 0
        self.unread = None
        self.is_running |= self.counts["samples"] > self.reported

    @property
    def why(self) -> str:
        """Why the last line was not read, the allowed form, and the remedy."""
        if self.unread is None:
            return ""
        line, error = self.unread
        text = line[:48].decode("ascii", "replace")
        sizes = " or ".join(map(str, sorted(set(self.sizes))))
        return (
            f"'{text if text.isprintable() else ascii(text)[1:-1]}"
            f"{'...' if len(line) > 48 else ''}' at {self.form.path}: "
            f"{error.reason.what}; "
            f"allowed are {sizes} counts a line of patch '{self.place.id}' from 0 to "
            f"{MAX_COUNT}; {self.find_remedy(error)}"
        )

    def find_remedy(self, error: LineError) -> str:
        """Return what to do about a line that is refused.

        It is options that read all lines that have come, if there are some. They are
        searched for where most lines are refused from the start.
        """
        is_read = self.counts["samples"] > self.reported + self.refused
        if self.is_running or is_read:
            return error.reason.remedy
        now = self.kept[-1][0] if self.kept else 0
        if self.searched_at is None or now - self.searched_at >= REPORT_INTERVAL:
            self.searched_at = now
            lines = [line for _, line in self.kept]
            labels = list_labels(lines, self.place.columns, min(self.sizes))
            found = find_readable(self.form, self.try_form, labels)
            self.advised = error.reason
            self.advice = describe_forms(found)
        if self.advice and self.advised == error.reason:
            return self.advice
        return error.reason.remedy

    def try_form(self, form: LineForm) -> list[LineError]:
        """Read the lines that have come by another form; return why some are refused.

        The first lines with times are not used, as the clock of the device is learned.
        """
        trial = MatrixLine(form, self.skin, self.patch, MAX_HELD)
        errors: list[LineError] = []
        for now, line in self.kept:
            trial.empty_at = now
            trial.push_lines([line], now)
            if trial.refused and trial.unread is not None:
                errors.append(trial.unread[1])
            trial.refused = 0
        if not errors and not trial.counts["samples"]:
            _, error = trial.unread or (b"", LineError(LineProblem.NO_SCAN.reason()))
            errors.append(error)
        return errors


TIME_CHANGES = (
    *(OptionChange({"time": unit}, "if the first number is a time") for unit in UNITS),
    OptionChange({"time": "ignore"}, "if the first number is no count"),
)


def list_negative(values: Float[np.ndarray, "number"]) -> list[OptionChange]:
    """Return the changes by which numbers are read of which some are below zero."""
    found = np.unique(values[values < 0])
    changes = [OptionChange({"offset": "1000"}, "if numbers may be below 0")]
    if len(found) == 1:
        word = f"{found[0]:g}"
        missing = OptionChange(
            {"missing": word}, f"if {word} stands for a missing cell"
        )
        changes.insert(0, missing)
    return changes


@final
class CsvMatrix(SampleDevice):
    """Reads matrices at serial ports, each of which is one patch of the skin."""

    noun = "line"

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
                "order of skin.yaml"
            )
        self.clock = clock
        self.baud = baud
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
                samples += line.push_lines(port.read() or (), now)
            else:
                line.empty_at = now
        return samples

    def take_refused(self) -> tuple[int, str]:
        """Return how many lines were refused since the last call, and why the last."""
        count = sum(line.refused for line in self.lines)
        why = next((line.why for line in self.lines if line.unread is not None), "")
        for line in self.lines:
            line.note_reported()
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
